"""Trains a policy with one seed, and with more seeds as long as there is no progress."""

import contextlib
import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import torch

from kitchen_suite import checks
from kitchen_suite.episodes.report import print_line
from kitchen_suite.episodes.spec import EnvironmentSpec
from kitchen_suite.training.bc import BCTraining
from kitchen_suite.training.ppo import PPOTraining
from kitchen_suite.training.recipes import ALGORITHMS, BC, PPO, Schedule
from kitchen_suite.training.run import HEADING, Run, StopReason, digest_of
from kitchen_suite.training.run_folder import RunDescription

# Environments that policies are evaluated in.
_EVALUATION_ENVS = 20

# What makes a finished seed train on, with the fields of its `Schedule`.
_TRAIN_ON = {
    StopReason.TARGET: "a target_success above {target_success:g}",
    StopReason.STEPS: "a num_steps above {num_steps}",
    StopReason.NO_PROGRESS: "a patience above {patience}, or of 0,",
}


def train(
    folder: Path,
    spec: EnvironmentSpec,
    schedule: Schedule,
    *,
    algorithm: str = PPO,
    seed: int = 0,
    restarts: int = 3,
    hyperparameters: Mapping[str, Any] | None = None,
    training_kwargs: Mapping[str, Any] | None = None,
    demonstrations: Sequence[Path] = (),
    num_demonstrations: Sequence[int] = (),
    initial_policy: Path | None = None,
    num_threads: int | None = None,
    resume: bool = False,
) -> Path:
    """Trains a policy, and prints a table of its evaluations.

    The folder gets a folder for each seed, with curves for TensorBoard and the last checkpoints, and the best policy.

    Args:
      folder: of the run.
      spec: of the environments that the policy is evaluated in.
      schedule: when the policy is evaluated, and when training stops; see `recipes.find_schedule`.
      algorithm: `ppo` or `bc`.
      seed: first seed.
      restarts: number of additional seeds to try where one is given up.
      hyperparameters: changes to those of the domain's recipe.
      training_kwargs: arguments of the environments trained in; they replace the recipe's. Only for PPO.
      demonstrations: folders of recordings; PPO clones them first.
      num_demonstrations: episodes to learn from, or a number for each folder; all when empty. Only for `bc`.
      initial_policy: file of a policy to start from. Only for PPO.
      num_threads: number of threads that step the environments; one per processor when None.
      resume: whether to continue the run in the folder from its newest checkpoints.

    Returns the file of the best policy.

    Raises:
      CheckpointError: no checkpoint can be read.
      DivergedError: learning diverged.
      OSError: a file cannot be read or written.
      ValueError: an argument is not valid, or the folder holds another run.
    """
    _check(algorithm, schedule, training_kwargs, demonstrations, num_demonstrations, initial_policy)
    seed = checks.integer(seed, "seed", minimum=0)
    restarts = checks.integer(restarts, "restarts", minimum=0, maximum=checks.MAX_COUNT)
    spec.make_environment().close()
    training: PPOTraining | BCTraining
    if algorithm == PPO:
        training = PPOTraining(
            spec,
            hyperparameters=hyperparameters or {},
            training_kwargs=training_kwargs or {},
            demonstrations=demonstrations,
            initial_policy=initial_policy,
            num_threads=num_threads,
        )
    else:
        training = BCTraining(
            spec,
            demonstrations,
            num_steps=schedule.num_steps,
            hyperparameters=hyperparameters or {},
            num_demonstrations=num_demonstrations,
        )
    evaluation = dataclasses.replace(spec, max_episode_steps=training.max_episode_steps)
    count = min(schedule.eval_episodes, _EVALUATION_ENVS)
    with contextlib.ExitStack() as stack:
        stack.callback(training.close)
        environments = evaluation.make_vector_env(count, num_threads, **spec.env_class.flat_options)
        stack.callback(environments.close)
        stack.enter_context(_one_thread())
        # Raises a ValueError if hyperparameters or initial policy do not fit the environments.
        training.make_learner(seed)
        description = RunDescription(
            domain_name=spec.domain_name,
            task_name=spec.task_name,
            task_kwargs=dict(spec.task_kwargs),
            training_kwargs=training.training_kwargs,
            hyperparameters=dataclasses.asdict(training.config),
            seed=seed,
            algorithm=algorithm,
            data_sha256=digest_of(training.data),
        )
        run = Run(folder, description, schedule, environments, resume=resume, report=print_line)
        _print_heading(folder, spec, training, schedule)
        for each in range(seed, seed + restarts + 1):
            if _train_seed(training, run, each, schedule) is not StopReason.NO_PROGRESS:
                break
    print_line(f"best policy: {run.policy_file}")
    return run.policy_file


@contextlib.contextmanager
def _one_thread() -> Iterator[None]:
    """Context in which PyTorch has one thread: the matrices are small, and with a second one training is slower."""
    count = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(count)


def _print_heading(folder: Path, spec: EnvironmentSpec, training: PPOTraining | BCTraining, schedule: Schedule) -> None:
    print_line(f"{spec.domain_name} {spec.task_name}, {training.title}, in {folder}")
    steps = f"at most {schedule.num_steps:,} {training.steps} for each seed"
    print_line(f"{steps}, evaluated every {schedule.eval_interval:,} in {schedule.eval_episodes} episodes")
    if schedule.target_success <= 1.0:
        target = f"{100 * schedule.target_success:.4g} %"
        print_line(f"ends once two evaluations in a row reach a success of {target} (target_success)")
    print_line(f"curves: tensorboard --logdir={folder}\n\n{HEADING}")


def _train_seed(training: PPOTraining | BCTraining, run: Run, seed: int, schedule: Schedule) -> StopReason:
    """Trains with a seed, and prints why it stopped."""
    trained = training.train(run, seed)
    run.keep_if_best(trained)
    reason = trained.stop_reason
    assert reason, "it has stopped"
    success, mean_return = trained.best
    print_line(f"seed {seed}: {reason.value}; best evaluation: success {success:.0%}, return {mean_return:.1f}")
    if trained.resumed and trained.steps == trained.first_steps:
        print_line(f"seed {seed} had finished before: {_TRAIN_ON[reason].format(**vars(schedule))} trains on")
    return reason


def _check(
    algorithm: str,
    schedule: Schedule,
    training_kwargs: Mapping[str, Any] | None,
    demonstrations: Sequence[Path],
    num_demonstrations: Sequence[int],
    initial_policy: Path | None,
) -> None:
    """Raises a ValueError for arguments that the algorithm does not take."""
    checks.choice(algorithm, ALGORITHMS, "algorithm")
    if algorithm == BC:
        if not demonstrations:
            raise ValueError(f"algorithm {BC!r} needs demonstrations, a folder of a recording")
        for name, value in (("initial_policy", initial_policy), ("training_kwargs", training_kwargs)):
            if value:
                raise ValueError(f"{name} is for the algorithm {PPO!r}, not for {BC!r}")
    elif num_demonstrations:
        raise ValueError(f"num_demonstrations is for the algorithm {BC!r}; PPO clones all episodes")
    elif schedule.num_steps == 0 and not demonstrations:
        raise ValueError("num_steps 0 is for cloning alone, which needs demonstrations")
