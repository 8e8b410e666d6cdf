"""One seed of a training run: it learns, is evaluated, and writes curves and checkpoints, from which it can resume."""

import contextlib
import enum
import os
import socket
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tensorboard.compat.proto.event_pb2 import Event, SessionLog
from tensorboard.compat.proto.summary_pb2 import Summary
from tensorboard.summary.writer.record_writer import RecordWriter
from tqdm import tqdm

from kitchen_suite.episodes.play import Controller
from kitchen_suite.settings import Schedule
from kitchen_suite.training import checkpoints
from kitchen_suite.training.checkpoints import Checkpoint
from kitchen_suite.training.learner import Learner, evaluate
from kitchen_suite.vector_env.base import SuiteVectorEnv

# Files of the policies of the best evaluation and of the last one; the latter is not chosen by what it is scored on.
POLICY_FILE, LAST_POLICY_FILE = "policy.npz", "last_policy.npz"

NO_RESULT = (-1.0, 0.0)  # Below the success rate and mean return of any evaluation.

# First seeds of training and of evaluation episodes. Smaller ones, which people play with, stay unseen.
_TRAINING_SEEDS = 1_000_000_000
EVALUATION_SEEDS = 500_000_000

# Success of the first episodes of an evaluation below which the others are not played: far from success a rough figure
# will do, and the episodes that fail are the longest.
_LEAST_SUCCESS = 0.5

HEADING = "seed        steps  minutes     return  progress  success"


class StopReason(enum.Enum):
    """Why the run of a seed stopped."""

    STEPS = "all steps were made"
    TARGET = "the target was reached"
    NO_PROGRESS = "there was no progress"


class CurveWriter:
    """Writes scalars to an event file of TensorBoard.

    It writes in the calling thread; that of `torch.utils.tensorboard.SummaryWriter` prints a traceback on a full disk.
    """

    def __init__(self, folder: Path, *, first_step: int | None = None) -> None:
        """Opens a new file; TensorBoard hides what earlier files in the folder hold from `first_step` on."""
        seconds, nanoseconds = divmod(time.time_ns(), 10**9)
        name = f"events.out.tfevents.{seconds:010d}.{socket.gethostname()}.{os.getpid()}.{nanoseconds:09d}"
        self._writer = RecordWriter((folder / name).open("xb"))
        self._write(file_version="brain.Event:2")
        if first_step is not None:
            self._write(step=first_step, session_log=SessionLog(status=SessionLog.START))

    def write(self, scalars: Mapping[str, float], step: int) -> None:
        """Writes the values of curves, by name, at a step."""
        values = [Summary.Value(tag=name, simple_value=value) for name, value in scalars.items()]
        self._write(step=step, summary=Summary(value=values))

    def close(self) -> None:
        """Closes the file."""
        self._writer.close()

    def _write(self, **fields: Any) -> None:
        self._writer.write(Event(wall_time=time.time(), **fields).SerializeToString())
        self._writer.flush()


class SeedRun:
    """The training of one learner, in a folder of its own.

    Attributes:
      resumed: whether the learner continues from a checkpoint.
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
    ) -> None:
        """Restores the newest checkpoint in the folder, if there is one; creates the folder otherwise.

        Evaluations first play an episode in each environment, without autoreset. Metadata is of exported policies.
        """
        self._folder, self._seed, self._schedule, self.policy_file = folder, seed, schedule, folder / POLICY_FILE
        self._learner, self._evaluation_environments, self._metadata = learner, evaluation_environments, metadata
        folder.mkdir(parents=True, exist_ok=True)
        # Duration and processor time of all threads until the last evaluation [s].
        self._seconds = np.zeros(2)
        self.best, self._progress = NO_RESULT, 0.0
        # Success rates of the last two evaluations.
        self._successes: list[float] = []
        checkpoint = checkpoints.load_last(folder, learner.check_fits)
        self.resumed = checkpoint is not None
        if checkpoint:
            learner.load_state(checkpoint)
            self._seconds = np.array([checkpoint.seconds, checkpoint.processor_seconds])
            self.best, self._progress, self._successes = checkpoint.best, checkpoint.progress, checkpoint.successes

    @property
    def steps(self) -> int:
        """Control steps learned from so far."""
        return self._learner.steps

    def run(self, report: Callable[[str], None]) -> StopReason:
        """Trains until there is a reason to stop; `report` is called with a table row after each evaluation."""
        reason = self._stop_reason()
        if self.resumed and reason:
            return reason
        self._started = _clocks() - self._seconds
        if not reason:
            self._learner.start(_TRAINING_SEEDS + self._seed * 1_000_000 + self.steps % 1_000_000)
        # The curves that an interrupted run wrote after its last checkpoint are hidden.
        curves = CurveWriter(self._folder, first_step=self.steps + 1 if self.resumed else None)
        bar = tqdm(
            total=self._schedule.num_steps,
            initial=self.steps,
            desc=f"seed {self._seed}, at most",
            unit="step",
            unit_scale=True,
            disable=None,
            leave=False,
        )
        with contextlib.closing(curves) as writer, bar:
            if not self.resumed:
                self._evaluate_and_checkpoint(writer, report)
            interval = self._schedule.eval_interval
            while (reason := self._stop_reason()) is None:
                previous = self.steps
                self._learn(writer, bar)
                # After each multiple of the interval, and after the last steps.
                if self.steps // interval > previous // interval or self._stop_reason() is not None:
                    self._evaluate_and_checkpoint(writer, report)
        return reason

    def _stop_reason(self) -> StopReason | None:
        schedule = self._schedule
        if len(self._successes) == 2 and min(self._successes) >= schedule.target_success:
            return StopReason.TARGET
        if self.steps >= schedule.num_steps:
            return StopReason.STEPS
        if 0 < schedule.patience <= self.steps and self._progress < schedule.min_progress:
            return StopReason.NO_PROGRESS
        return None

    def _learn(self, writer: CurveWriter, bar: tqdm) -> None:
        steps, started = self.steps, time.perf_counter()
        means = self._learner.learn()
        means["time/steps_per_second"] = (self.steps - steps) / (time.perf_counter() - started)
        writer.write(means, self.steps)
        bar.update(self.steps - steps)
        name = next(iter(means))
        bar.set_postfix_str(f"{name.partition('/')[2]} {means[name]:.2f}", refresh=False)

    def _evaluate_and_checkpoint(self, writer: CurveWriter, report: Callable[[str], None]) -> None:
        """Evaluates the policy; writes its metrics, a checkpoint and a table row."""
        means = self._evaluate()
        self._seconds = _clocks() - self._started
        seconds, processor_seconds = self._seconds.tolist()
        minutes = seconds / 60
        curves = {name.replace("episode/", "evaluation/"): mean for name, mean in means.items()}
        times = {"time/minutes": minutes, "time/processor_minutes": processor_seconds / 60}
        writer.write({**curves, **times}, self.steps)
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
        report(
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
        environments, last = self._evaluation_environments, EVALUATION_SEEDS + self._schedule.eval_episodes
        seeds, first = range(EVALUATION_SEEDS, last), environments.num_envs
        metrics = evaluate(controller, environments, seeds[:first])
        if len(seeds) <= first or metrics["episode/success"].mean() < _LEAST_SUCCESS:
            return metrics
        others = evaluate(controller, environments, seeds[first:])
        return {name: np.concatenate([values, others[name]]) for name, values in metrics.items()}


def _clocks() -> NDArray[np.float64]:
    """Returns the readings of the clocks of time and of this process's processor time [s]."""
    return np.array([time.perf_counter(), time.process_time()])
