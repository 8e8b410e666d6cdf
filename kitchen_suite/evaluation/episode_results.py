"""The results of single episodes, as they are kept, and the scores of many."""

import dataclasses
import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kitchen_suite import files
from kitchen_suite.evaluation import scores
from kitchen_suite.evaluation.protocols import Score
from kitchen_suite.tasks.base import SuiteTask

# Decimals of the scores; those beyond would differ between versions of SciPy.
_DECIMALS = 6


@dataclasses.dataclass(frozen=True, kw_only=True)
class EpisodeResult:
    """The result of an episode.

    Attributes:
      condition: name of the condition of its protocol.
      episode: its number in the condition, from 0.
      seed: of the episode.
      success: whether it succeeded.
      progress: how far it came, as its task measures it.
      control_steps: its length.
      asked: the tasks that it asked for, each with the control step of its completion or None; None for tasks that
        cannot be counted.
      diverged: whether its physics diverged; it then counts as a failure of the greatest length, at its start.
    """

    condition: str
    episode: int
    seed: int
    success: bool
    progress: float
    control_steps: int
    asked: dict[str, int | None] | None = None
    diverged: bool = False

    @classmethod
    def of(cls, task: SuiteTask, infos: Mapping[str, Any], *, control_steps: int, **numbers: Any) -> "EpisodeResult":
        """Returns the result of an episode of a task.

        Args:
          task: of the episode.
          infos: its last infos, without leading axis.
          control_steps: its length.
          **numbers: further attributes.
        """
        completions = task.completions_in(infos)
        return cls(
            success=bool(infos["is_success"]),
            progress=float(task.progress_in(infos)),
            control_steps=control_steps,
            asked=completions.steps_by_task if completions else None,
            **numbers,
        )

    @classmethod
    def from_line(cls, line: str | bytes) -> "EpisodeResult":
        """Returns the result that `line` was made of.

        Raises:
          ValueError: the line holds something else.
        """
        return files.parse(json.loads(line), cls, "not the result of an episode")

    @property
    def line(self) -> str:
        """The result as JSON in one line."""
        return json.dumps(dataclasses.asdict(self))


def score_episodes(results: Sequence[EpisodeResult], score: Score | None = None) -> dict[str, Any]:
    """Returns the scores of the episodes of a condition, as JSON represents them.

    Args:
      results: at least one, in the order of their numbers.
      score: a published score; only for tasks that can be counted.
    """
    measured: dict[str, tuple[float, scores.Interval]] = {}
    further: dict[str, Any] = {}
    if all(result.asked is not None for result in results):
        asked, steps, tasks = _arrays(results)
        completed = scores.tasks_completed(asked, steps)
        most = int(asked.sum(axis=1).max())
        reached = scores.at_least(completed, most)
        measured |= {name: scores.rate(verdicts) for name, verdicts in reached.items()}
        measured["mean_tasks"] = scores.mean(completed, low=0.0, high=most)
        if score:
            measured[score.name] = scores.mean(completed / score.tasks * score.best, low=0.0, high=score.best)
        further["task_rates"] = {
            name: _task_rate(steps[asked[:, column], column] > 0) for column, name in enumerate(tasks)
        }
        further["order_entropy"] = round(scores.order_entropy(asked, steps), _DECIMALS)
    else:
        measured["mean_progress"] = scores.mean([result.progress for result in results])
    measured["success"] = scores.rate([result.success for result in results])
    measured["control_steps"] = scores.mean([result.control_steps for result in results])
    return {
        **{name: round(value, _DECIMALS) for name, (value, _) in measured.items()},
        "intervals": {name: _rounded(interval) for name, (_, interval) in measured.items()},
        **further,
        "diverged_seeds": [result.seed for result in results if result.diverged],
    }


def _arrays(results: Sequence[EpisodeResult]) -> tuple[NDArray[np.bool_], NDArray[np.int64], list[str]]:
    """Returns which tasks `(n, k)` episodes ask for, their completion steps `(n, k)`, and the tasks' names in order."""
    rows = [result.asked or {} for result in results]
    tasks = sorted({name for row in rows for name in row})
    asked = np.array([[name in row for name in tasks] for row in rows])
    steps = np.array([[row.get(name) or -1 for name in tasks] for row in rows])
    return asked, steps, tasks


def _task_rate(completed: NDArray[np.bool_]) -> dict[str, Any]:
    """Returns how often a task was completed in the episodes `(n,)` that asked for it."""
    value, interval = scores.rate(completed)
    counts = {"asked": completed.size, "completed": int(completed.sum())}
    return {"rate": round(value, _DECIMALS), "interval": _rounded(interval), **counts}


def _rounded(interval: scores.Interval) -> list[float] | None:
    return None if interval is None else [round(bound, _DECIMALS) for bound in interval]
