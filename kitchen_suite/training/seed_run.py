"""One seed of a training run: learns, is evaluated, writes curves and checkpoints, and goes on where it stopped."""

import contextlib
import dataclasses
import enum
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from numpy.typing import NDArray
from torch.utils.tensorboard import SummaryWriter
from tqdm import tqdm

from kitchen_suite.policies.trained import TrainedPolicy
from kitchen_suite.training import agent as agents
from kitchen_suite.training import checkpoints
from kitchen_suite.training.evaluation import evaluate
from kitchen_suite.training.learner import Learner
from kitchen_suite.vector_env.base import SuiteVectorEnv

POLICY_FILE = "policy.npz"

# Training episodes take their seeds from here on, so that smaller ones, which people play with, are unseen.
_TRAINING_SEEDS = 1_000_000_000
EVALUATION_SEEDS = 500_000_000


class StopReason(enum.Enum):
    """How an attempt came to its end."""

    STEPS = "all steps were made"
    TARGET = "the target was reached"
    NO_PROGRESS = "there was no progress"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Schedule:
    """When what happens, in control steps over all environments.

    Attributes:
      num_steps: length of the training.
      eval_interval: between evaluations, each followed by a checkpoint.
      eval_episodes: episodes of an evaluation.
      target_success: rate of success that two evaluations in a row must reach to end the training; above 1 for never.
      patience: steps after which an attempt that has come to no progress is given up; 0 for never.
      least_progress: mean progress of an evaluation that counts as some.
    """

    num_steps: int
    eval_interval: int
    eval_episodes: int
    target_success: float
    patience: int
    least_progress: float


class SeedRun:
    """A learner with one seed, and its folder."""

    def __init__(
        self,
        folder: Path,
        seed: int,
        schedule: Schedule,
        learner: Learner,
        evaluated: SuiteVectorEnv,
        metadata: Mapping[str, Any],
    ) -> None:
        """Takes up what an interrupted attempt has left in the folder, if anything.

        Args:
          folder: of curves, checkpoints and the best policy; made if it is not there.
          seed: of the learner.
          schedule: when what happens.
          learner: new.
          evaluated: environments of the evaluations, with autoreset mode `NextStep`.
          metadata: of exported policies.

        Raises:
          CheckpointError: no checkpoint that is there can be read.
          OSError: the folder cannot be written to.
        """
        self._folder, self._seed, self._schedule = folder, seed, schedule
        self._learner, self._evaluated, self._metadata = learner, evaluated, metadata
        folder.mkdir(parents=True, exist_ok=True)
        self._seconds, self._best, self._progress = 0.0, (-1.0, 0.0), 0.0
        self._successes: list[float] = []
        self.resumed = self._resume()

    @property
    def best(self) -> tuple[float, float]:
        """Rate of success and mean return of the best evaluation so far."""
        return self._best

    @property
    def steps(self) -> int:
        """Control steps learned from so far."""
        return self._learner.steps

    def run(self, show: Callable[[str], None]) -> StopReason:
        """Learns until there is a reason to stop; `show` is called with a line for each evaluation."""
        if self.resumed and (reason := self._stop_reason()):
            return reason
        schedule, learner = self._schedule, self._learner
        started = time.perf_counter() - self._seconds
        learner.start(_TRAINING_SEEDS + self._seed * 1_000_000 + self.steps % 1_000_000)
        # What an interrupted attempt wrote after its last checkpoint is not shown.
        purge = self.steps + 1 if self.resumed else None
        with contextlib.closing(SummaryWriter(str(self._folder), purge_step=purge)) as writer, self._bar() as bar:
            if not self.resumed:
                self._evaluate_and_checkpoint(writer, started, show)
            while (reason := self._stop_reason()) is None:
                before, began = self.steps, time.perf_counter()
                means = learner.learn()
                means["time/steps_per_second"] = (self.steps - before) / (time.perf_counter() - began)
                _write(writer, means, self.steps)
                bar.update(self.steps - before)
                bar.set_postfix_str(f"reward {means['step/reward']:.2f}", refresh=False)
                due = self.steps // schedule.eval_interval > before // schedule.eval_interval
                if due or self._stop_reason():
                    self._evaluate_and_checkpoint(writer, started, show)
        return reason

    def _evaluate_and_checkpoint(self, writer: SummaryWriter, started: float, show: Callable[[str], None]) -> None:
        """Evaluates the policy, and writes down all that there is."""
        measures = self._evaluate()
        self._seconds = time.perf_counter() - started
        _write(writer, {**_means(measures), "time/minutes": self._seconds / 60}, self.steps)
        self._save()
        show(self._row(measures))

    def _stop_reason(self) -> StopReason | None:
        if len(self._successes) == 2 and min(self._successes) >= self._schedule.target_success:
            return StopReason.TARGET
        if self.steps >= self._schedule.num_steps:
            return StopReason.STEPS
        gave_up = 0 < self._schedule.patience <= self.steps and self._progress < self._schedule.least_progress
        return StopReason.NO_PROGRESS if gave_up else None

    def _evaluate(self) -> dict[str, NDArray]:
        """Plays the held-out episodes; keeps the policy if it is the best so far."""
        policy = agents.export(self._learner.agent, self._metadata)
        count = self._schedule.eval_episodes
        measures = evaluate(policy, self._evaluated, [*range(EVALUATION_SEEDS, EVALUATION_SEEDS + count)])
        success, gain = measures["episode/success"].mean(), measures["episode/return"].mean()
        self._progress = max(self._progress, float(measures["episode/progress"].mean()))
        self._successes = [*self._successes[-1:], float(success)]
        if (success, gain) > self._best:
            self._best = float(success), float(gain)
            self._keep(policy)
        return measures

    def _keep(self, policy: TrainedPolicy) -> None:
        found = {"seed": self._seed, "steps": self.steps, "success": self._best[0], "return": self._best[1]}
        known = {**policy.metadata, "training": found}
        dataclasses.replace(policy, metadata=known).save(self._folder / POLICY_FILE)

    def _save(self) -> None:
        counters = {"seconds": self._seconds, "best": list(self._best), "progress": self._progress}
        state = {**self._learner.state(), **counters, "successes": self._successes}
        checkpoints.save(self._folder, self.steps, state)

    def _resume(self) -> bool:
        state = checkpoints.load_last(self._folder)
        if state is None:
            return False
        self._learner.load_state(state)
        success, gain = state["best"]
        self._best, self._seconds = (success, gain), state["seconds"]
        self._progress, self._successes = state["progress"], state["successes"]
        return True

    def _bar(self) -> tqdm:
        description = f"seed {self._seed}"
        total = self._schedule.num_steps
        return tqdm(
            total=total, initial=self.steps, desc=description, unit="step", unit_scale=True, disable=None, leave=False
        )

    def _row(self, measures: Mapping[str, NDArray]) -> str:
        means = {name: values.mean() for name, values in measures.items()}
        return (
            f"{self._seed:4d}  {self.steps:11,d}  {self._seconds / 60:7.1f}  {means['episode/return']:9.1f}  "
            f"{means['episode/progress']:8.3f}  {means['episode/success']:7.0%}"
        )


HEADING = "seed        steps  minutes     return  progress  success"


def _means(measures: Mapping[str, NDArray]) -> dict[str, float]:
    return {name.replace("episode/", "evaluation/"): float(values.mean()) for name, values in measures.items()}


def _write(writer: SummaryWriter, means: Mapping[str, float], steps: int) -> None:
    for name, value in means.items():
        writer.add_scalar(name, value, steps)
