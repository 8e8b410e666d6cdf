"""A training run in a folder: its description, and the run of each seed with evaluations, curves and checkpoints.

The folder holds the best policy of all seeds. An interrupted run is resumed from the newest checkpoint of each seed.
"""

import abc
import collections
import contextlib
import dataclasses
import enum
import hashlib
import io
import json
import shutil
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, ClassVar, Generic, Self, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch.utils.tensorboard import SummaryWriter
from tqdm import tqdm

from kitchen_suite import checks, files
from kitchen_suite.episodes.play import Controller, VectorRollout
from kitchen_suite.episodes.spec import EnvironmentSpec
from kitchen_suite.policies.files import StoredPolicy
from kitchen_suite.tasks.task import SuiteTask
from kitchen_suite.training.recipes import Schedule
from kitchen_suite.vector_env.base import SuiteVectorEnv

RUN_FILE = "training.json"
_RUN = files.DescribedFolder(RUN_FILE, "a training run", "seed_*", "name another folder, or resume it")

# Files of the policies of the best evaluation and of the last one; the latter is not chosen by what it is scored on.
POLICY_FILE = "policy.npz"
LAST_POLICY_FILE = "last_policy.npz"

_CHECKPOINTS = "checkpoint_*.pt"
_NUM_CHECKPOINTS = 3  # The newest ones, which are kept.

NO_RESULT = (-1.0, 0.0)  # Below the success rate and mean return of any evaluation.

# First seeds of training and of evaluation episodes. Smaller ones, which people play with, stay unseen.
_TRAINING_SEEDS = 1_000_000_000
EVALUATION_SEEDS = 500_000_000

_EVALUATION_ENVS = 20  # Environments that policies are evaluated in.

# Success of the first episodes of an evaluation below which the others are not played: far from success a rough figure
# will do, and the episodes that fail are the longest.
_LEAST_SUCCESS = 0.5

_HEADING = "seed        steps  minutes     return  progress  success"

EPISODE_METRICS = ("episode/success", "episode/progress", "episode/length")


class DivergedError(checks.WorkFailedError):
    """A network's parameters are no longer finite."""


class Learner(abc.ABC):
    """Learns step by step, and exports a policy.

    Attributes:
      title: name of the algorithm.
      unit: name of the steps that it counts.
      steps: learned from so far: control steps over all environments, or steps of the optimiser.
      warmup_batches: batches that still train the value network alone.
    """

    title: ClassVar[str]
    unit: ClassVar[str]
    steps = 0
    warmup_batches = 0

    @property
    @abc.abstractmethod
    def modules(self) -> Mapping[str, Any]:
        """Networks, scalers and optimiser by name."""

    @abc.abstractmethod
    def learn(self) -> dict[str, float]:
        """Learns for some steps; returns metrics by name."""

    @abc.abstractmethod
    def export(self, metadata: Mapping[str, Any]) -> StoredPolicy:
        """Returns the current policy, without exploration."""

    @abc.abstractmethod
    def controller(self, policy: Any, environments: SuiteVectorEnv) -> Controller:
        """Returns a controller that acts by an exported policy."""

    def check_finite(self, networks: Mapping[str, torch.nn.Module]) -> None:
        """Raises a DivergedError unless all parameters of networks, by name, are finite."""
        for name, network in networks.items():
            if not all(parameter.isfinite().all() for parameter in network.parameters()):
                problem = f"the {name} network is no longer finite: lower the learning rate"
                raise DivergedError(f"after {self.steps} steps {problem}")

    def state(self) -> dict[str, Any]:
        """Returns the state of learning, as in checkpoints; that of the episodes in progress is not part of it."""
        return {
            "modules": {name: module.state_dict() for name, module in self.modules.items()},
            "random": torch.get_rng_state(),
            "steps": self.steps,
            "warmup_batches": self.warmup_batches,
        }

    def load_state(self, state: Mapping[str, Any]) -> None:
        """Restores the state of learning, which may have other entries."""
        for name, module in self.modules.items():
            module.load_state_dict(state["modules"][name])
        torch.set_rng_state(state["random"])
        self.steps = state["steps"]
        self.warmup_batches = state["warmup_batches"]


AnyLearner = TypeVar("AnyLearner", bound=Learner)


@dataclasses.dataclass(frozen=True, kw_only=True)
class RunDescription:
    """The task, hyperparameters and seed of a run. A run is resumed only with an equal description.

    Attributes:
      domain_name: a key of `suite.DOMAINS`.
      task_name: one of the domain's tasks.
      task_kwargs: additional arguments of the Gymnasium environment, which JSON can hold.
      training_kwargs: additional arguments of the environments trained in, among them `max_episode_steps`.
      hyperparameters: all of them, by name.
      seed: of the first learner.
      algorithm: `ppo` or `bc`.
      data_sha256: of what is learned or started from; None in descriptions of an earlier version.
    """

    domain_name: str
    task_name: str
    task_kwargs: dict[str, Any]
    training_kwargs: dict[str, Any]
    hyperparameters: dict[str, Any]
    seed: int
    algorithm: str = "ppo"
    data_sha256: str | None = None

    @property
    def metadata(self) -> dict[str, Any]:
        """The metadata of the run's policies on their training."""
        names = ("domain_name", "task_name", "task_kwargs", "training_kwargs", "hyperparameters")
        return {name: getattr(self, name) for name in names}

    def create(self, folder: Path) -> None:
        """Writes it to the folder of a new run, as `DescribedFolder.create`."""
        _RUN.create(folder, vars(self))

    def resume(self, folder: Path) -> None:
        """Checks the description in the folder of an interrupted run.

        Raises:
          OSError: the folder cannot be written to, or holds no run.
          ValueError: it holds a run with another description, or on other data.
        """
        found = files.parse(_RUN.load(folder), RunDescription, str(folder / RUN_FILE))
        _RUN.resume(folder, found.entries(), self.entries())
        if found.data_sha256 not in (None, self.data_sha256):
            remedy = "pass the same demonstrations and their number, or the same initial policy, or name another folder"
            raise ValueError(f"{folder} holds a training run on other data: {remedy}")

    def entries(self) -> dict[str, Any]:
        """Returns it as JSON without the data; arguments of the task and hyperparameters are beside other entries."""
        entries = json.loads(json.dumps(vars(self)))
        entries.pop("data_sha256", None)
        return {**entries.pop("task_kwargs"), **entries.pop("hyperparameters"), **entries}


def digest_of(arrays: Sequence[NDArray]) -> str:
    """Returns the SHA-256 of the shape of each array, and of the SHA-256 of its contents."""
    parts = [(each.shape, hashlib.sha256(each.ravel().view(np.uint8).data).hexdigest()) for each in arrays]
    return hashlib.sha256(repr(parts).encode()).hexdigest()


def save_checkpoint(folder: Path, state: Mapping[str, Any]) -> Path:
    """Writes a state, named by its steps, and removes all checkpoints but the last few; returns the file."""
    path = folder / _CHECKPOINTS.replace("*", f"{state['steps']:012d}")
    contents = io.BytesIO()
    torch.save(state, contents)
    with files.atomic_write(path) as partial:
        partial.write_bytes(contents.getbuffer())
    for old in sorted(folder.glob(_CHECKPOINTS))[:-_NUM_CHECKPOINTS]:
        old.unlink()
    return path


def load_checkpoint(folder: Path) -> dict[str, Any] | None:
    """Returns the state in the newest checkpoint of a seed; None if there is none. An OSError names a damaged one."""
    paths = sorted(folder.glob(_CHECKPOINTS))
    if not paths:
        return None
    with files.reading(paths[-1], "a checkpoint; without it, the run is resumed from the one before"):
        state: dict[str, Any] = torch.load(paths[-1], weights_only=True)
    return state


class StopReason(enum.Enum):
    """Why the run of a seed stopped, and what trains it on, with the fields of its `Schedule`."""

    STEPS = "all steps were made", "a num_steps above {num_steps}"
    TARGET = "the target was reached", "a target_success above {target_success:g}"
    NO_PROGRESS = "there was no progress", "a patience above {patience}, or of 0,"


class SeedRun(Generic[AnyLearner]):
    """The training of one learner, in a folder of its own; a context while it learns, which writes its curves.

    Attributes:
      learner: that is trained.
      resumed: whether the learner continues from a checkpoint.
      best: success rate and mean return of the best evaluation so far.
      best_of_run: those of the best evaluation of all seeds of the run so far.
    """

    def __init__(
        self,
        folder: Path,
        seed: int,
        schedule: Schedule,
        learner: AnyLearner,
        evaluation_environments: SuiteVectorEnv,
        metadata: Mapping[str, Any],
        *,
        best_of_run: tuple[float, float] = NO_RESULT,
        report: Callable[[str], None] = lambda row: None,
    ) -> None:
        """Restores the newest checkpoint of the seed in the folder of a run; creates the seed's folder otherwise.

        Evaluations first play an episode in each environment, without autoreset. Metadata is of exported policies;
        `report` is called with a table row after each evaluation.
        """
        self._folder = folder / f"seed_{seed}"
        self._run_policy_file = folder / POLICY_FILE
        self._seed = seed
        self._schedule = schedule
        self.learner = learner
        self._evaluation_environments = evaluation_environments
        self._metadata = metadata
        self._report = report
        self._folder.mkdir(parents=True, exist_ok=True)
        # Duration and processor time of all threads until the last evaluation [s].
        self._seconds = np.zeros(2)
        self.best = NO_RESULT
        self.best_of_run = best_of_run
        # Greatest mean progress of an evaluation.
        self._progress = 0.0
        # Success rates of the last two evaluations.
        self._successes: list[float] = []
        checkpoint = load_checkpoint(self._folder)
        self.resumed = checkpoint is not None
        if checkpoint:
            learner.load_state(checkpoint)
            self._seconds = np.array([checkpoint["seconds"], checkpoint["processor_seconds"]])
            self.best = checkpoint["best"]
            self._progress = checkpoint["progress"]
            self._successes = checkpoint["successes"]
            self._keep_if_best()

    @property
    def steps(self) -> int:
        """Steps learned from so far."""
        return self.learner.steps

    @property
    def episode_seed(self) -> int:
        """First seed of the episodes that the learner plays from now on."""
        return _TRAINING_SEEDS + self._seed * 1_000_000 + self.steps % 1_000_000

    @property
    def stop_reason(self) -> StopReason | None:
        """Why the learner has to stop; None as long as it learns."""
        schedule = self._schedule
        if len(self._successes) == 2 and min(self._successes) >= schedule.target_success:
            return StopReason.TARGET
        if self.steps >= schedule.num_steps:
            return StopReason.STEPS
        if 0 < schedule.patience <= self.steps and self._progress < schedule.min_progress:
            return StopReason.NO_PROGRESS
        return None

    def __enter__(self) -> Self:
        """Starts the clocks, and opens the curves."""
        self._started = _clocks() - self._seconds
        # TensorBoard hides the curves that an interrupted run wrote after its last checkpoint.
        self._curves = SummaryWriter(self._folder, purge_step=self.steps + 1 if self.resumed else None)
        self._bar = tqdm(
            total=self._schedule.num_steps,
            initial=self.steps,
            desc=f"seed {self._seed}, at most",
            unit="step",
            unit_scale=True,
            disable=None,
            leave=False,
        )
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._bar.close()
        self._curves.close()

    def begin(self) -> None:
        """Evaluates the policy of a new learner, before its first step."""
        if not self.resumed:
            self._evaluate_and_checkpoint()
        self._last_steps = self.steps
        self._last_time = time.perf_counter()

    def record(self, metrics: dict[str, float]) -> None:
        """Writes the metrics of what has just been learned; evaluates the policy and saves a checkpoint when due."""
        previous = self._last_steps
        seconds = time.perf_counter() - self._last_time
        self._write({**metrics, "time/steps_per_second": (self.steps - previous) / seconds})
        self._bar.update(self.steps - previous)
        name = next(iter(metrics))
        self._bar.set_postfix_str(f"{name.partition('/')[2]} {metrics[name]:.2f}", refresh=False)
        # After each multiple of the interval, and after the last steps.
        interval = self._schedule.eval_interval
        if self.steps // interval > previous // interval or self.stop_reason is not None:
            self._evaluate_and_checkpoint()
        self._last_steps = self.steps
        self._last_time = time.perf_counter()

    def _write(self, scalars: Mapping[str, float]) -> None:
        """Writes the values of curves, by name, to the disk."""
        for name, value in scalars.items():
            self._curves.add_scalar(name, value, self.steps)
        self._curves.flush()

    def _evaluate_and_checkpoint(self) -> None:
        """Evaluates the policy; writes its metrics, a checkpoint and a table row."""
        means = self._evaluate()
        self._seconds = _clocks() - self._started
        seconds, processor_seconds = self._seconds.tolist()
        minutes = seconds / 60
        curves = {name.replace("episode/", "evaluation/"): mean for name, mean in means.items()}
        times = {"time/minutes": minutes, "time/processor_minutes": processor_seconds / 60}
        self._write({**curves, **times})
        progress = {"best": self.best, "progress": self._progress, "successes": self._successes}
        times = {"seconds": seconds, "processor_seconds": processor_seconds}
        save_checkpoint(self._folder, {**self.learner.state(), **times, **progress})
        self._keep_if_best()
        # In the columns of `_HEADING`.
        self._report(
            f"{self._seed:4d}  {self.steps:11,d}  {minutes:7.1f}  {means['episode/return']:9.1f}  "
            f"{means['episode/progress']:8.3f}  {means['episode/success']:7.0%}"
        )

    def _evaluate(self) -> dict[str, float]:
        """Evaluates and saves the policy, also as the best so far if it is, and returns the means of the metrics."""
        policy = self.learner.export(self._metadata)
        metrics = self._play(self.learner.controller(policy, self._evaluation_environments))
        means = {name: float(values.mean()) for name, values in metrics.items()}
        success, mean_return = result = means["episode/success"], means["episode/return"]
        self._progress = max(self._progress, means["episode/progress"])
        self._successes = [*self._successes[-1:], success]
        training = {"seed": self._seed, "steps": self.steps, "success": success, "return": mean_return}
        policy = policy.with_metadata({**policy.metadata, "training": training})
        policy.save(self._folder / LAST_POLICY_FILE)
        if result > self.best:
            self.best = result
            policy.save(self._folder / POLICY_FILE)
        return means

    def _play(self, controller: Controller) -> dict[str, NDArray]:
        """Plays the episodes of an evaluation, only the first of them where few of these succeed; returns metrics."""
        seeds = range(EVALUATION_SEEDS, EVALUATION_SEEDS + self._schedule.eval_episodes)
        first = self._evaluation_environments.num_envs
        metrics = evaluate(controller, self._evaluation_environments, seeds[:first])
        if len(seeds) <= first or metrics["episode/success"].mean() < _LEAST_SUCCESS:
            return metrics
        others = evaluate(controller, self._evaluation_environments, seeds[first:])
        return {name: np.concatenate([values, others[name]]) for name, values in metrics.items()}

    def _keep_if_best(self) -> None:
        """Copies the policy of the seed to the folder of the run if it is the best of all seeds so far."""
        if self.best > self.best_of_run:
            self.best_of_run = self.best
            with files.atomic_write(self._run_policy_file) as partial:
                shutil.copyfile(self._folder / POLICY_FILE, partial)


def seed_runs(
    folder: Path,
    description: RunDescription,
    schedule: Schedule,
    environments: SuiteVectorEnv,
    make_learner: Callable[[int], AnyLearner],
    *,
    restarts: int,
    resume: bool,
    report: Callable[[str], None],
) -> Iterator[SeedRun[AnyLearner]]:
    """Yields the run of each seed to be trained: of the first, and of more as long as there is no progress.

    The folder is created, or is that of an interrupted run, before the first one. Environments are of the evaluations,
    as in `evaluation_environments`; `make_learner` returns a new learner for a seed, and `report` is called with each
    line of a table. Raises as `RunDescription.create` and `RunDescription.resume`, before the first step.
    """
    seed = checks.integer(description.seed, "seed", minimum=0)
    restarts = checks.integer(restarts, "restarts", minimum=0, maximum=checks.MAX_COUNT)
    # Raises a ValueError if hyperparameters or initial policy do not fit the environments, before there is a folder.
    learner = make_learner(seed)
    best = _recorded_best(folder / POLICY_FILE) if resume else NO_RESULT
    (description.resume if resume else description.create)(folder)
    for line in _heading(folder, description, learner, schedule):
        report(line)
    for each in range(seed, seed + restarts + 1):
        if each > seed:
            learner = make_learner(each)
        metadata = description.metadata
        run = SeedRun(folder, each, schedule, learner, environments, metadata, best_of_run=best, report=report)
        had_finished = run.resumed and run.stop_reason is not None
        if not had_finished:
            yield run
        assert run.stop_reason, "it has stopped"
        best = run.best_of_run
        reason, remedy = run.stop_reason.value
        success, mean_return = run.best
        report(f"seed {each}: {reason}; best evaluation: success {success:.0%}, return {mean_return:.1f}")
        if had_finished:
            report(f"seed {each} had finished before: {remedy.format(**vars(schedule))} trains on")
        if run.stop_reason is not StopReason.NO_PROGRESS:
            return


def _heading(folder: Path, description: RunDescription, learner: Learner, schedule: Schedule) -> Iterator[str]:
    """Yields the lines above the table of evaluations."""
    yield f"{description.domain_name} {description.task_name}, {learner.title}, in {folder}"
    steps = f"at most {schedule.num_steps:,} {learner.unit} for each seed"
    yield f"{steps}, evaluated every {schedule.eval_interval:,} in {schedule.eval_episodes} episodes"
    if schedule.target_success <= 1.0:
        target = f"{100 * schedule.target_success:.4g} %"
        yield f"ends once two evaluations in a row reach a success of {target} (target_success)"
    yield f"curves: tensorboard --logdir={folder}\n\n{_HEADING}"


def _recorded_best(policy_file: Path) -> tuple[float, float]:
    """Returns success rate and mean return of the policy in the folder of a run that is resumed."""
    try:
        training = files.load_metadata(policy_file, "a trained policy")["training"]
        return float(training["success"]), float(training["return"])
    except FileNotFoundError:
        return NO_RESULT


def episode_metrics(task: SuiteTask, infos: Mapping[str, Any]) -> dict[str, NDArray]:
    """Returns the `EPISODE_METRICS` `(n,)` of episodes of a task from their last infos."""
    values = (infos["is_success"], task.records.progress(infos), infos["episode_step"])
    return {name: np.asarray(value, np.float64) for name, value in zip(EPISODE_METRICS, values, strict=True)}


@contextlib.contextmanager
def evaluation_environments(
    spec: EnvironmentSpec, schedule: Schedule, num_threads: int | None
) -> Iterator[SuiteVectorEnv]:
    """Context of the environments that policies are evaluated in."""
    count = min(schedule.eval_episodes, _EVALUATION_ENVS)
    with contextlib.closing(spec.make_vector_env(count, num_threads, **spec.env_class.flat_options)) as environments:
        yield environments


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Context in which PyTorch has one thread: the matrices are small, and with a second one training is slower."""
    count = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(count)


def evaluate(controller: Controller, environments: SuiteVectorEnv, seeds: Sequence[int]) -> dict[str, NDArray]:
    """Plays an episode of each seed, without exploration.

    Environments have autoreset mode `Disabled`. Returns metrics of the episodes `(n,)` by name: those of
    `episode_metrics`, and `episode/return`; all are 0 for an episode in which the physics has diverged.
    """
    task = environments.composer_task
    metrics = {name: np.zeros(len(seeds)) for name in (*EPISODE_METRICS, "episode/return")}
    for index, episode in VectorRollout(environments, controller).play(collections.deque(enumerate(seeds))):
        if not episode.diverged:
            last = {**episode_metrics(task, episode.last_info), "episode/return": episode.rewards.sum()}
            for name, value in last.items():
                metrics[name][index] = value
    return metrics


def _clocks() -> NDArray[np.float64]:
    """Returns the readings of the clocks of time and of this process's processor time [s]."""
    return np.array([time.perf_counter(), time.process_time()])
