"""Replays recorded actions."""

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import gymnasium
import mujoco
import numpy as np
from numpy.typing import NDArray

from kitchen_suite.gymnasium_env.base import VARIATION_VALUES, suite_env
from kitchen_suite.rollouts.episode import EpisodeArrays, EpisodeBuffer, unflatten
from kitchen_suite.rollouts.single_rollout import Actions, episode_name, play
from kitchen_suite.rollouts.spec import reset_to_seed
from kitchen_suite.tasks.task import SuiteTask


def replay(
    environment: gymnasium.Env,
    recorded: EpisodeArrays,
    seeding: str,
    watch: Callable[[EpisodeBuffer], None] = lambda buffer: None,
) -> EpisodeArrays:
    """Plays the actions of a recorded episode again, from its seed.

    Without a seed, noise cannot be drawn again: each of a kitchen's actions is then added to the recorded positions, as
    when it was recorded. An episode of a kitchen that began in another state than a reset begins in that state.

    Args:
      environment: made with the arguments of the recording.
      recorded: the episode.
      seeding: of the recording, see `rollouts.spec.SEEDINGS`.
      watch: called after the reset and after every step.

    Raises:
      ValueError: the arrays do not fit the environment, or the episode has no seed, and its task's episodes start from
        a seed only.
    """
    _check_fits(environment, recorded)
    start = _start(environment, recorded, seeding)
    name = episode_name(recorded.index, recorded.seed)
    arrays = play(environment, start, _recorded_actions(environment, recorded), watch, name)
    return EpisodeArrays(
        index=recorded.index,
        seed=recorded.seed,
        arrays={**arrays, "action": recorded.arrays["action"]},
        instruction=suite_env(environment).instruction,
    )


def _check_fits(environment: gymnasium.Env, recorded: EpisodeArrays) -> None:
    """Checks the actions and states of an episode.

    Raises:
      ValueError: their shapes are not the environment's, it begins with positions that MuJoCo does not simulate, or it
        has neither a seed nor states.
    """
    _check_shape(recorded, "action", recorded.arrays["action"], environment.action_space.shape)
    states = _states(environment, recorded)
    if states is None:
        if recorded.seed is None:
            raise ValueError(f"episode {recorded.index} has no observations of the state")
        return
    _check_shape(recorded, "observation", states, suite_env(environment).observations.flat_space.shape)
    if np.abs(states[0]).max() > mujoco.mjMAXVAL:
        limit = f"{mujoco.mjMAXVAL:g}, the greatest that MuJoCo simulates"
        raise ValueError(f"episode {recorded.index} begins with positions beyond {limit}")


def _check_shape(recorded: EpisodeArrays, name: str, array: NDArray, expected: tuple[int, ...] | None) -> None:
    if array.shape[1:] != expected:
        raise ValueError(f"episode {recorded.index} has {name}s of shape {array.shape[1:]}, the environment {expected}")


def _start(environment: gymnasium.Env, recorded: EpisodeArrays, seeding: str) -> tuple[Any, dict[str, Any]]:
    """Resets to where the recorded episode began; returns the observation and the info there."""
    inner = suite_env(environment)
    task = inner.environment.task
    observation, info = reset_to_seed(environment, recorded.seed or 0, seeding, _options(task, recorded))
    physics = inner.environment.physics
    states = _task_states(environment, recorded)
    if states is None:
        return observation, info
    first = states[0]
    if recorded.seed is None:
        task.set_observed_positions(first)
    if np.isfinite(first).all() and not task.is_initial(physics, first):
        task.restore(physics, first)
        observation = inner.set_state(inner.get_state())
    return observation, info


def _options(task: SuiteTask, recorded: EpisodeArrays) -> dict[str, Any] | None:
    """Returns the options of a reset that repeat what was drawn in a recorded episode; None if there are none."""
    prefix = f"info/{VARIATION_VALUES}/"
    values = {name.removeprefix(prefix): rows[0] for name, rows in recorded.arrays.items() if name.startswith(prefix)}
    return {**({VARIATION_VALUES: values} if values else {}), **task.requests.recorded(recorded.arrays)} or None


def _recorded_actions(environment: gymnasium.Env, recorded: EpisodeArrays) -> Actions:
    inner = suite_env(environment)

    def actions(buffer: EpisodeBuffer) -> Iterator[NDArray]:
        del buffer
        states = _task_states(environment, recorded)
        for step, action in enumerate(recorded.arrays["action"]):
            if recorded.seed is None and states is not None:
                inner.environment.task.set_observed_positions(states[step])
            yield action

    return actions


def _task_states(environment: gymnasium.Env, recorded: EpisodeArrays) -> NDArray | None:
    """Returns the observations of `_states` without the extra observables, which come last."""
    states = _states(environment, recorded)
    return None if states is None else states[:, : states.shape[1] - suite_env(environment).environment.task.extra_size]


def _states(environment: gymnasium.Env, recorded: EpisodeArrays) -> NDArray | None:
    """Returns the flat observations `(T + 1, ...)` of a recording; None if it does not hold them as a whole.

    Raises:
      ValueError: it lacks arrays of the environment's observation type.
    """
    try:
        states = suite_env(environment).observations.recover_flat(unflatten(recorded.arrays, "observation"))
        has_other_type = isinstance(states, Mapping)
    except (IndexError, KeyError, TypeError):
        has_other_type = True
    if has_other_type:
        raise ValueError(f"episode {recorded.index} has no observations of the state")
    return states


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
