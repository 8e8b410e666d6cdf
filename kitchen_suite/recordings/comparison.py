"""Compares a recorded episode with its replay."""

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.rollouts.episode import EpisodeArrays
from kitchen_suite.tasks.base import SuiteTask


@dataclasses.dataclass(frozen=True, kw_only=True)
class Comparison:
    """The differences between a recorded episode and its replay; steps count from 1, None without a difference.

    Attributes:
      seed: of the episode.
      steps: number of control steps.
      recorded_return: sum of the recorded rewards.
      replayed_return: sum of the replayed rewards.
      rewards: first step with another reward.
      completions: first step after which other tasks are within their threshold (open_cabinet: with another success).
      tasks: those that differ there.
      ends: first step that ends only one of the two episodes.
      observation_difference: maximum over all numbers of the observations, goals included; NaN where one is NaN, inf
        where an array is missing or has another shape.
      arrays: names of all arrays that are missing in one episode, or differ in shape or in a number; NaN differs.
    """

    seed: int | None
    steps: int
    recorded_return: float
    replayed_return: float
    rewards: int | None
    completions: int | None
    tasks: tuple[str, ...]
    ends: int | None
    observation_difference: float
    arrays: tuple[str, ...]

    def is_equal(self, *, exactly: bool) -> bool:
        """Whether rewards, completions and ends are equal; `exactly`: all arrays as well."""
        steps = (self.rewards, self.completions, self.ends)
        return steps == (None, None, None) and not (exactly and self.arrays)


def compare(task: SuiteTask, recorded: EpisodeArrays, replayed: EpisodeArrays, *, truncations: bool) -> Comparison:
    """Compares an episode with its replay.

    Args:
      task: of the environment that replayed it.
      recorded: the episode.
      replayed: its replay.
      truncations: whether these are compared, or only terminations: other recorders truncate where they stop.
    """
    one, other = recorded.arrays, replayed.arrays
    ends = one["termination"] != other["termination"]
    if truncations:
        ends = ends | (one["truncation"] != other["truncation"])
    completions, tasks = _compare_completions(task, recorded, replayed)
    names = list({**one, **other})
    return Comparison(
        seed=recorded.seed,
        steps=recorded.steps,
        recorded_return=float(one["reward"].sum()),
        replayed_return=float(other["reward"].sum()),
        rewards=_first(one["reward"] != other["reward"]),
        completions=completions,
        tasks=tasks,
        ends=_first(ends),
        observation_difference=float(np.max([_difference(one, other, name) for name in names])),
        arrays=tuple(name for name in names if not _are_equal(one, other, name)),
    )


def _are_equal(one: Mapping[str, NDArray], other: Mapping[str, NDArray], name: str) -> bool:
    return name in one and name in other and np.array_equal(one[name], other[name])


def _difference(one: Mapping[str, NDArray], other: Mapping[str, NDArray], name: str) -> float:
    """Returns the greatest difference of an observation's numbers, 0 for other arrays."""
    if name.partition("/")[0] != "observation":
        return 0.0
    if name not in one or name not in other or one[name].shape != other[name].shape:
        return math.inf
    # Pictures are unsigned.
    return float(np.abs(np.subtract(one[name], other[name], dtype=np.float64)).max())


def _compare_completions(
    task: SuiteTask, recorded: EpisodeArrays, replayed: EpisodeArrays
) -> tuple[int | None, tuple[str, ...]]:
    """Returns the first step after which completions differ, and the tasks that do."""
    if not _have_same_layout(recorded.arrays, replayed.arrays):
        return None, ()
    one, other = task.goals_reached(recorded.arrays), task.goals_reached(replayed.arrays)
    if one is None or other is None:  # Recorded without infos.
        return None, ()
    names = np.array(one[0])
    # Before the first step no task can be completed.
    differing = (one[1] != other[1])[1:]
    step = _first(differing.any(axis=1))
    return step, () if step is None else tuple(names[differing[step - 1]])


def _have_same_layout(recorded: Mapping[str, NDArray], replayed: Mapping[str, NDArray]) -> bool:
    """Whether recorded observations, and infos where there are any, have the shapes of the replayed ones."""
    return all(
        recorded[name].shape == array.shape if name in recorded else name.startswith("info/")
        for name, array in replayed.items()
    )


def _first(differs: NDArray[np.bool_]) -> int | None:
    """Returns the number of the first step, from 1, that differs."""
    return int(np.argmax(differs)) + 1 if differs.any() else None
