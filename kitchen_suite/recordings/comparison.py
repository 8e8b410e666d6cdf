"""Compares an episode with its replay."""

import dataclasses
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.gymnasium_env.base import SuiteEnv
from kitchen_suite.rollouts.episode_arrays import EpisodeArrays
from kitchen_suite.tasks import KitchenTask
from kitchen_suite.tasks.kitchen.goals import goal_distances

_CABINET_VERDICT = "info/is_success"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Comparison:
    """How a recorded episode and its replay differ; steps count from 1, None where there is no difference.

    Attributes:
      seed: of the episode.
      steps: number of control steps.
      recorded_return: sum of the recorded rewards.
      replayed_return: sum of the replayed ones.
      rewards: first step with another reward.
      completions: first step after which other tasks are within their threshold (cabinet: with another verdict).
      tasks: those that differ there.
      ends: first step that ends only one of them.
      observation_difference: greatest one of any number of an observation, goals included.
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

    def is_equal(self, *, exactly: bool) -> bool:
        """Whether rewards, completions and ends are equal; `exactly`: observations as well."""
        steps = (self.rewards, self.completions, self.ends)
        return steps == (None, None, None) and not (exactly and self.observation_difference)


def compare(
    environment: SuiteEnv, recorded: EpisodeArrays, replayed: EpisodeArrays, *, truncations: bool
) -> Comparison:
    """Compares an episode with its replay.

    Args:
      environment: where it was replayed.
      recorded: the episode.
      replayed: its replay.
      truncations: whether these are compared, or only terminations: other recorders truncate where they stop.
    """
    one, other = recorded.arrays, replayed.arrays
    ends = one["termination"] != other["termination"]
    if truncations:
        ends = ends | (one["truncation"] != other["truncation"])
    completions, tasks = _completions(environment, one, other)
    shown = [name for name in one if name.split("/")[0] == "observation"]
    return Comparison(
        seed=recorded.seed,
        steps=recorded.steps,
        recorded_return=float(one["reward"].sum()),
        replayed_return=float(other["reward"].sum()),
        rewards=_first(one["reward"] != other["reward"]),
        completions=completions,
        tasks=tasks,
        ends=_first(ends),
        observation_difference=max(float(np.abs(one[name] - other[name]).max()) for name in shown),
    )


def _completions(
    environment: SuiteEnv, one: Mapping[str, NDArray], other: Mapping[str, NDArray]
) -> tuple[int | None, tuple[str, ...]]:
    """First step after which completions differ, and the tasks that do."""
    task = environment.environment.task
    if isinstance(task, KitchenTask):
        names = task.mdp.goals.tasks
        within = [_within(task, arrays) for arrays in (one, other)]
    else:
        if _CABINET_VERDICT not in one:  # Recorded without infos.
            return None, ()
        names = ("drawer",)
        within = [arrays[_CABINET_VERDICT][:, np.newaxis] for arrays in (one, other)]
    # Before the first step nothing can be completed.
    differing = (within[0] != within[1])[1:]
    step = _first(differing.any(axis=1))
    tasks = () if step is None else tuple(np.array(names)[differing[step - 1]])
    return step, tasks


def _within(task: KitchenTask, arrays: Mapping[str, NDArray]) -> NDArray[np.bool_]:
    """Which tasks are within their threshold, `(T + 1, n)`, in configured order."""
    key, goals = "observation/achieved_goal", task.mdp.goals
    if key in arrays:
        achieved = arrays[key]
    else:
        achieved = np.concatenate([arrays[f"{key}/{name}"] for name in goals.tasks], axis=1)
    return goal_distances(achieved, goals.desired, goals.starts) < task.threshold


def _first(differs: NDArray[np.bool_]) -> int | None:
    """Number of the first step, from 1, that differs."""
    return int(np.argmax(differs)) + 1 if differs.any() else None
