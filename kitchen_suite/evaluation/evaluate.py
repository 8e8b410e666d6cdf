"""Evaluates policies under the protocols of publications."""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import contextlib
from collections.abc import Callable, Generator, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from kitchen_suite import checks, files
from kitchen_suite.episodes.cluster import Cluster
from kitchen_suite.episodes.episode import Waiting
from kitchen_suite.episodes.play import make_controller
from kitchen_suite.episodes.spec import even_count, merged_kwargs
from kitchen_suite.evaluation.evaluation import Evaluation, check_can_be_receipt, problem_of_episode, problem_of_trace
from kitchen_suite.evaluation.folder import DESCRIPTION_FILE, EPISODES_FILE, TRACES_FOLDER, EvaluationFolder
from kitchen_suite.evaluation.plan import EvaluationPlan, Replaced, make_plan
from kitchen_suite.evaluation.rollout import PlayedEpisode, play_condition
from kitchen_suite.evaluation.scores import EpisodeResult
from kitchen_suite.policies import TIMESTEP, PolicyError, PolicyRef


def evaluate(
    policy: str | Path | PolicyRef | Callable[..., Any],
    *,
    protocol: str = "default",
    takes: str = TIMESTEP,
    domain_name: str = "kitchen",
    task_name: str | None = None,
    task_kwargs: Mapping[str, Any] | None = None,
    quality: bool = False,
    seed: int | None = None,
    num_episodes: int | None = None,
    max_episode_steps: int | None = None,
    dataset: str | Path | None = None,
    num_envs: int = 16,
    num_threads: int | None = None,
    cluster: Cluster | None = None,
    output: str | Path | None = None,
    resume: bool = False,
    receipt: str | Path | None = None,
    announce: Callable[[EvaluationPlan], object] = lambda plan: None,
    progress: Callable[[EpisodeResult], object] = lambda result: None,
) -> Evaluation:
    """Evaluates a policy under a protocol.

    The same evaluation has the same results, whatever `num_envs`, `num_threads` and `cluster`. Nothing is printed: see
    `announce` and `progress`.

    Args:
      policy: a name such as `expert`, the path of a trained policy, the address of a server, or a callable: a policy,
        whose memory of an episode its method `reset` clears, or a factory of policies; see `policies.memory`.
      protocol: name of the protocol, a key of `PROTOCOLS`.
      takes: what a callable is called with: `timestep`, `observation` or `batch`.
      domain_name: of the environments.
      task_name: replaces the protocol's task.
      task_kwargs: arguments of the environments, which replace those of the protocol.
      quality: whether to measure how well episodes are done, `clean_success` among others; see docs/guide/quality.md.
      seed: of the first episode of each condition; the protocol's when None.
      num_episodes: of each condition; the protocol's when None.
      max_episode_steps: control steps after which an episode ends; the protocol's when None.
      dataset: folder of a recording, from whose episodes some protocols take their goals.
      num_envs: as in `kitchen_suite.play`.
      num_threads: as in `kitchen_suite.play`.
      cluster: as in `kitchen_suite.play`.
      output: folder that keeps each episode, so that an interrupted evaluation can go on.
      resume: whether to continue the evaluation in `output`.
      receipt: file to write a receipt to, which `kitchen_suite.replay` checks without the policy.
      announce: is called with the plan of the evaluation before the first episode.
      progress: is called with the result of each episode as it ends, first with those that `output` has already.

    Raises:
      OSError: a file or folder cannot be read or written.
      PolicyError: the policy cannot be built, raises an exception, or returns a bad action.
      ValueError: an argument is not valid.
    """
    reference = PolicyRef.of(policy, takes)
    checks.integer(num_envs, "num_envs", minimum=1, maximum=checks.MAX_ENVS)
    if resume and output is None:
        raise ValueError("an evaluation is resumed in its folder, output")
    if resume and reference.function is not None:
        raise ValueError("an evaluation of an object is not resumed: nothing says that it is the same policy")
    folder_path = None if output is None else Path(output)
    receipt_path = None if receipt is None else Path(receipt)
    if receipt_path is not None and receipt_path.suffix != ".npz":
        raise ValueError(f"receipt must be a file whose name ends with .npz, got {checks.shown(str(receipt))}")
    dataset_path = None if dataset is None else Path(dataset)
    check_destinations(reference, dataset_path, folder_path, {"receipt": receipt_path})
    kwargs = merged_kwargs(task_kwargs or {}, {"quality": checks.boolean(quality, "quality") or None})
    replaced = Replaced(
        domain_name=domain_name,
        task_name=task_name,
        task_kwargs=kwargs,
        seed=seed,
        num_episodes=num_episodes,
        max_episode_steps=max_episode_steps,
    )
    plan = make_plan(reference, protocol, replaced, dataset_path)
    if receipt_path is not None:
        check_can_be_receipt(plan)
    folder = _open_folder(plan, folder_path, resume)
    found = {name: _found(plan, name, folder) for name in plan.specs}
    announce(plan)
    for name in plan.specs:
        for result in found[name]:
            progress(result)
        with _withdrawn_without_results(folder):
            _play_missing(name, plan, reference, folder, num_envs, num_threads, cluster, progress)
    played = {name: [folder.played[key] for key in _keys(plan, name)] for name in plan.specs}
    evaluation = Evaluation(
        plan=plan,
        results={name: [episode.result for episode in each] for name, each in played.items()},
        traces={name: [episode.trace for episode in each] for name, each in played.items()},
        answer_seconds=np.concatenate([episode.answer_seconds for each in played.values() for episode in each]),
    )
    if receipt_path is not None:
        evaluation.write(receipt_path)
    return evaluation


def check_destinations(
    policy: PolicyRef, dataset: Path | None, output: Path | None, paths: Mapping[str, Path | None]
) -> None:
    """Raises an OSError or a ValueError unless the files of an evaluation can be written, in place of no other one.

    Args:
      policy: that is evaluated, which may be a file.
      dataset: folder of the recording that goals are taken from.
      output: folder of the evaluation, in which files of other names may be.
      paths: of the files by the names of their arguments, None where none is wanted.
    """
    file = policy.file()
    read = [] if file is None else [file]
    folders = [] if dataset is None else [dataset]
    if output is not None:
        read += [output, output / DESCRIPTION_FILE, output / EPISODES_FILE]
        folders.append(output / TRACES_FOLDER)
    files.check_destinations({name: path for name, path in paths.items() if path is not None}, read, folders)


def _open_folder(plan: EvaluationPlan, output: Path | None, resume: bool) -> EvaluationFolder:
    if output is None:
        return EvaluationFolder(None, plan.description)
    if resume:
        return EvaluationFolder.resume(output, plan.description)
    return EvaluationFolder.create(output, plan.description)


@contextlib.contextmanager
def _withdrawn_without_results(folder: EvaluationFolder) -> Iterator[None]:
    """Context in which results are made and written: if they cannot be, and there is none, nothing is left."""
    try:
        yield
    except (OSError, PolicyError):
        folder.withdraw()
        raise


def _keys(plan: EvaluationPlan, name: str) -> list[tuple[str, int]]:
    return [(name, index) for index in range(plan.num_episodes)]


def _found(plan: EvaluationPlan, name: str, folder: EvaluationFolder) -> list[EpisodeResult]:
    """Returns the results of a condition that a folder has; raises a ValueError unless they are those of the plan."""
    results = []
    for key in _keys(plan, name):
        if key in folder.played:
            result = folder.played[key].result
            index = key[1]
            problem = problem_of_episode(plan, name, index, result)
            problem = problem or problem_of_trace(plan, result, folder.played[key].trace)
            if not problem and result.success_at_end is None:
                problem = "does not say whether it ends in success"
            if problem or result.reset != plan.reset_options(name, index):
                what = f"episode {index} of {name} {problem or 'asks for something else'}"
                raise ValueError(
                    f"the folder was altered: {what}; remove its line from {EPISODES_FILE} to play it again"
                )
            results.append(result)
    return results


def _play_missing(
    name: str,
    plan: EvaluationPlan,
    policy: PolicyRef,
    folder: EvaluationFolder,
    num_envs: int,
    num_threads: int | None,
    cluster: Cluster | None,
    progress: Callable[[EpisodeResult], object],
) -> None:
    """Plays the episodes of a condition that a folder lacks, and adds them to it."""
    spec = plan.specs[name]
    waiting = [(index, spec.seed_of(index)) for _, index in _keys(plan, name) if (name, index) not in folder.played]
    if not waiting:
        return
    if cluster is None:
        played = _play(waiting, name, plan, policy, num_envs, num_threads)
    else:
        threads = num_threads or 1
        played = cluster.run(_play_part, (name, plan, policy, num_envs, threads), waiting, num_threads=threads)
    with contextlib.closing(played):
        for episode in played:
            folder.add(episode)
            progress(episode.result)


def _play(
    waiting: list[tuple[int, int]],
    name: str,
    plan: EvaluationPlan,
    policy: PolicyRef,
    num_envs: int,
    num_threads: int | None,
) -> Generator[PlayedEpisode, None, None]:
    """Yields some episodes of a condition, given by their numbers and seeds."""
    spec = plan.specs[name]
    with contextlib.closing(spec.make_vector_env(even_count(len(waiting), num_envs), num_threads)) as environments:
        controller = make_controller(spec, policy, environments)
        yield from play_condition(name, plan, environments, controller, Waiting(waiting))


def _play_part(
    waiting: list[tuple[int, int]],
    name: str,
    plan: EvaluationPlan,
    policy: PolicyRef,
    num_envs: int,
    num_threads: int,
) -> list[PlayedEpisode]:
    """Plays some episodes in a process of a cluster."""
    return [*_play(waiting, name, plan, policy, num_envs, num_threads)]
