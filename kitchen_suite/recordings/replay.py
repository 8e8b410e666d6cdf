"""Plays recorded actions again."""

from collections.abc import Callable, Mapping

import gymnasium
import numpy as np
from numpy.typing import NDArray

from kitchen_suite.gymnasium_env.base import SuiteEnv, suite_env
from kitchen_suite.rollouts.episode_arrays import EpisodeArrays, flatten
from kitchen_suite.tasks import KitchenTask
from kitchen_suite.tasks.kitchen import noise

# What rounding may add to the noise of an observation [rad, m].
_ROUNDING = 1e-6


def play_again(
    environment: gymnasium.Env, recorded: EpisodeArrays, watch: Callable[[], None] = lambda: None
) -> EpisodeArrays:
    """Plays a recorded episode again, from its seed.

    Noise without a seed cannot be drawn again: then each of a kitchen's actions is added to the recorded positions, as
    it was when it was recorded. A kitchen's episode that began elsewhere begins there.

    Args:
      environment: made with the arguments of the recording.
      recorded: the episode.
      watch: called after the reset and after every step.

    Raises:
      ValueError: a cabinet's episode has no seed.
    """
    inner = suite_env(environment)
    rows, steps = [_start(environment, inner, recorded)], []
    watch()
    for i, action in enumerate(recorded.arrays["action"]):
        if recorded.seed is None:
            _show_positions(inner, recorded.arrays["observation/observation"][i])
        observation, *step, info = environment.step(action)
        rows.append(_row(observation, info))
        steps.append(step)
        watch()
    columns = zip(("reward", "termination", "truncation"), zip(*steps, strict=True), strict=True)
    return EpisodeArrays(
        index=recorded.index,
        seed=recorded.seed,
        arrays={
            **{name: np.stack([row[name] for row in rows]) for name in rows[0]},
            "action": recorded.arrays["action"],
            **{name: np.array(column) for name, column in columns},
        },
    )


def _start(environment: gymnasium.Env, inner: SuiteEnv, recorded: EpisodeArrays) -> Mapping[str, NDArray]:
    """Resets; returns what that shows."""
    task = inner.environment.task
    if not isinstance(task, KitchenTask):
        if recorded.seed is None:
            raise ValueError(f"episode {recorded.index} has no seed, without which its start is unknown")
        # Each recorded episode is the first of an environment's life.
        task.total_steps = 0
    observation, info = environment.reset(seed=recorded.seed or 0)
    if isinstance(task, KitchenTask):
        first = recorded.arrays["observation/observation"][0]
        layout, data = task.indices, inner.environment.physics.data
        usual = layout.observed(data.qpos, data.qvel)
        if (np.abs(first - usual) > task.mdp.noise_scale + _ROUNDING).any():
            observation = _move(inner, task, first)
    return _row(observation, info)


def _move(inner: SuiteEnv, task: KitchenTask, first: NDArray[np.float64]) -> Mapping[str, NDArray]:
    """Puts robot and things where an observation `(59,)` has them; returns the observation there."""
    layout, data = task.indices, inner.environment.physics.data
    places = (layout.robot_qpos, layout.robot_qvel, layout.object_qpos, layout.object_qvel)
    for array, where, part in zip((data.qpos, data.qvel) * 2, places, noise.PARTS, strict=True):
        array[where] = first[part]
    state = inner.get_state()
    state["task"]["positions"] = state["task"]["target"] = first[noise.PARTS[0]]
    state["task"]["achieved"] = data.qpos[layout.goal_qpos]
    return inner.set_state(state)


def _show_positions(inner: SuiteEnv, shown: NDArray[np.float64]) -> None:
    """Lets the next action be added to the robot's positions as an observation `(59,)` showed them."""
    state = inner.get_state()
    robot = noise.PARTS[0]
    state["task"]["noise"][robot] = shown[robot] - state["task"]["positions"]
    inner.set_state(state)


def _row(observation: object, info: Mapping[str, NDArray]) -> dict[str, NDArray]:
    arrays = {name: value for name, value in info.items() if isinstance(value, np.ndarray)}
    return {**flatten(observation, "observation"), **flatten(arrays, "info")}
