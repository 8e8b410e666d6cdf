"""A training run in a folder: the run of each seed with its evaluations, curves and checkpoints, and the best policy.

An interrupted run is resumed from the newest checkpoint of each seed.
"""

import abc
import collections
import enum
import hashlib
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch.utils.tensorboard import SummaryWriter
from tqdm import tqdm

from kitchen_suite import checks, files
from kitchen_suite.episodes.play import Controller, VectorRollout
from kitchen_suite.policies.files import StoredPolicy
from kitchen_suite.tasks.task import SuiteTask
from kitchen_suite.training import checkpoints
from kitchen_suite.training.checkpoints import Checkpoint, check_modules
from kitchen_suite.training.recipes import Schedule
from kitchen_suite.training.run_folder import RunDescription
from kitchen_suite.vector_env.base import SuiteVectorEnv

# Files of the policies of the best evaluation and of the last one; the latter is not chosen by what it is scored on.
POLICY_FILE = "policy.npz"
LAST_POLICY_FILE = "last_policy.npz"

NO_RESULT = (-1.0, 0.0)  # Below the success rate and mean return of any evaluation.

# First seeds of training and of evaluation episodes. Smaller ones, which people play with, stay unseen.
_TRAINING_SEEDS = 1_000_000_000
EVALUATION_SEEDS = 500_000_000

# Success of the first episodes of an evaluation below which the others are not played: far from success a rough figure
# will do, and the episodes that fail are the longest.
_LEAST_SUCCESS = 0.5

HEADING = "seed        steps  minutes     return  progress  success"

EPISODE_METRICS = ("episode/success", "episode/progress", "episode/length")


class DivergedError(checks.WorkFailedError):
    """A network's parameters are no longer finite."""


class Learner(abc.ABC):
    """Learns step by step, and exports a policy.

    Attributes:
      steps: learned from so far: control steps over all environments, or steps of the optimiser.
      warmup_batches: batches that still train the value network alone.
    """

    steps = 0
    warmup_batches = 0

    @property
    @abc.abstractmethod
    def modules(self) -> Mapping[str, Any]:
        """Networks, scalers and optimiser by name."""

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
        """Returns the state of learning, as in a `Checkpoint`; that of the episodes in progress is not part of it."""
        return {
            "modules": {name: module.state_dict() for name, module in self.modules.items()},
            "random": torch.get_rng_state(),
            "steps": self.steps,
            "warmup_batches": self.warmup_batches,
        }

    def check_fits(self, checkpoint: Checkpoint) -> None:
        """Checks that `load_state` can restore a checkpoint; raises a ValueError if it is one of other networks."""
        check_modules(checkpoint.modules, self.modules)
        # A generator of its own, so that a random state that is refused changes nothing.
        torch.Generator().set_state(checkpoint.random)

    def load_state(self, checkpoint: Checkpoint) -> None:
        """Restores the state of learning; the checkpoint has to fit."""
        for name, module in self.modules.items():
            module.load_state_dict(checkpoint.modules[name])
        torch.set_rng_state(checkpoint.random)
        self.steps = checkpoint.steps
        self.warmup_batches = checkpoint.warmup_batches


def digest_of(arrays: Sequence[NDArray]) -> str:
    """Returns the SHA-256 of the shape of each array, and of the SHA-256 of its contents."""
    parts = [(each.shape, hashlib.sha256(each.ravel().view(np.uint8).data).hexdigest()) for each in arrays]
    return hashlib.sha256(repr(parts).encode()).hexdigest()


class StopReason(enum.Enum):
    """Why the run of a seed stopped."""

    STEPS = "all steps were made"
    TARGET = "the target was reached"
    NO_PROGRESS = "there was no progress"


class SeedRun:
    """The training of one learner, in a folder of its own; a context while it learns, which writes its curves.

    Attributes:
      resumed: whether the learner continues from a checkpoint.
      first_steps: steps that the learner had learned from before.
      best: success rate and mean return of the best evaluation so far.
      policy_file: file of its policy.
    """

    def __init__(
        self,
        folder: Path,
        seed: int,
        schedule: Schedule,
        learner: Learner,
        evaluation_environments: SuiteVectorEnv,
        metadata: Mapping[str, Any],
        report: Callable[[str], None] = lambda row: None,
    ) -> None:
        """Restores the newest checkpoint in the folder, if there is one; creates the folder otherwise.

        Evaluations first play an episode in each environment, without autoreset. Metadata is of exported policies;
        `report` is called with a table row after each evaluation.
        """
        self._folder = folder
        self._seed = seed
        self._schedule = schedule
        self._learner = learner
        self._evaluation_environments = evaluation_environments
        self._metadata = metadata
        self._report = report
        self.policy_file = folder / POLICY_FILE
        folder.mkdir(parents=True, exist_ok=True)
        # Duration and processor time of all threads until the last evaluation [s].
        self._seconds = np.zeros(2)
        self.best = NO_RESULT
        self._progress = 0.0
        # Success rates of the last two evaluations.
        self._successes: list[float] = []
        checkpoint = checkpoints.load_last(folder, learner.check_fits)
        self.resumed = checkpoint is not None
        self.first_steps = checkpoint.steps if checkpoint else 0
        if checkpoint:
            learner.load_state(checkpoint)
            self._seconds = np.array([checkpoint.seconds, checkpoint.processor_seconds])
            self.best = checkpoint.best
            self._progress = checkpoint.progress
            self._successes = checkpoint.successes

    @property
    def steps(self) -> int:
        """Steps learned from so far."""
        return self._learner.steps

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
        checkpoint = Checkpoint(
            **self._learner.state(),
            seconds=seconds,
            processor_seconds=processor_seconds,
            best=self.best,
            progress=self._progress,
            successes=self._successes,
        )
        checkpoints.save(self._folder, checkpoint)
        # In the columns of `HEADING`.
        self._report(
            f"{self._seed:4d}  {self.steps:11,d}  {minutes:7.1f}  {means['episode/return']:9.1f}  "
            f"{means['episode/progress']:8.3f}  {means['episode/success']:7.0%}"
        )

    def _evaluate(self) -> dict[str, float]:
        """Evaluates and saves the policy, also as the best so far if it is, and returns the means of the metrics."""
        policy = self._learner.export(self._metadata)
        metrics = self._play(self._learner.controller(policy, self._evaluation_environments))
        means = {name: float(values.mean()) for name, values in metrics.items()}
        success, mean_return = result = means["episode/success"], means["episode/return"]
        self._progress = max(self._progress, means["episode/progress"])
        self._successes = [*self._successes[-1:], success]
        training = {"seed": self._seed, "steps": self.steps, "success": success, "return": mean_return}
        policy = policy.with_metadata({**policy.metadata, "training": training})
        policy.save(self._folder / LAST_POLICY_FILE)
        if result > self.best:
            self.best = result
            policy.save(self.policy_file)
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


class Run:
    """A training run: the runs of its seeds, and the best policy of them all.

    Attributes:
      description: of the run.
      evaluation_environments: those that policies are evaluated in.
      policy_file: file of the best policy.
    """

    def __init__(
        self,
        folder: Path,
        description: RunDescription,
        schedule: Schedule,
        evaluation_environments: SuiteVectorEnv,
        *,
        resume: bool = False,
        report: Callable[[str], None] = lambda row: None,
    ) -> None:
        """Creates the folder, or prepares that of an interrupted run; raises as `RunDescription.resume`."""
        self._folder = folder
        self.description = description
        self._schedule = schedule
        self.evaluation_environments = evaluation_environments
        self._report = report
        self._seed_run: SeedRun | None = None
        self.policy_file = folder / POLICY_FILE
        self._best = self._recorded_best() if resume else NO_RESULT
        (description.resume if resume else description.create)(folder)

    @property
    def steps(self) -> int:
        """Steps that the current seed has learned from."""
        return self._seed_run.steps if self._seed_run else 0

    def of_seed(self, seed: int, learner: Learner) -> SeedRun:
        """Returns the run of a seed, which goes on where it was interrupted."""

        def report(row: str) -> None:
            self.keep_if_best(seed_run)
            self._report(row)

        folder = self._folder / f"seed_{seed}"
        metadata = self.description.metadata
        seed_run = SeedRun(folder, seed, self._schedule, learner, self.evaluation_environments, metadata, report)
        self._seed_run = seed_run
        return seed_run

    def keep_if_best(self, run: SeedRun) -> None:
        """Copies the policy of a seed to the folder of the run if it is the best of all seeds so far."""
        if run.best > self._best:
            self._best = run.best
            with files.atomic_write(self.policy_file) as partial:
                shutil.copyfile(run.policy_file, partial)

    def _recorded_best(self) -> tuple[float, float]:
        """Returns success rate and mean return of the policy in the folder of a run that is resumed."""
        try:
            training = files.load_metadata(self.policy_file, "a trained policy")["training"]
            return float(training["success"]), float(training["return"])
        except (KeyError, OSError, TypeError, ValueError):  # There is none, or a damaged one.
            return NO_RESULT


def episode_metrics(task: SuiteTask, infos: Mapping[str, Any]) -> dict[str, NDArray]:
    """Returns the `EPISODE_METRICS` `(n,)` of episodes of a task from their last infos."""
    values = (infos["is_success"], task.records.progress(infos), infos["episode_step"])
    return {name: np.asarray(value, np.float64) for name, value in zip(EPISODE_METRICS, values, strict=True)}


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
