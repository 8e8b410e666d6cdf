"""Replays recorded actions."""

from collections.abc import Callable, Iterator
from typing import Any

import gymnasium
import mujoco
import numpy as np
from numpy.typing import NDArray

from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.rollouts.episode import EpisodeArrays, EpisodeBuffer
from kitchen_suite.rollouts.single_rollout import Actions, play
from kitchen_suite.rollouts.spec import reset_to_seed

_STATE = "observation/observation"


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
    arrays = play(environment, start, _recorded_actions(environment, recorded), watch)
    return EpisodeArrays(
        index=recorded.index,
        seed=recorded.seed,
        arrays={**arrays, "action": recorded.arrays["action"]},
        instruction=suite_env(environment).instruction,
    )


def _check_fits(environment: gymnasium.Env, recorded: EpisodeArrays) -> None:
    """Checks the actions and states of an episode.

    Raises:
      ValueError: their shapes are not the environment's, or it begins with positions that MuJoCo does not simulate.
    """
    space = environment.observation_space
    state = space["observation"] if isinstance(space, gymnasium.spaces.Dict) else space
    pairs = {"action": (recorded.arrays["action"], environment.action_space), "observation": (_state(recorded), state)}
    for name, (array, expected) in pairs.items():
        if array.shape[1:] != expected.shape:
            raise ValueError(
                f"episode {recorded.index} has {name}s of shape {array.shape[1:]}, the environment {expected.shape}"
            )
    if np.abs(_state(recorded)[0]).max() > mujoco.mjMAXVAL:
        limit = f"{mujoco.mjMAXVAL:g}, the greatest that MuJoCo simulates"
        raise ValueError(f"episode {recorded.index} begins with positions beyond {limit}")


def _start(environment: gymnasium.Env, recorded: EpisodeArrays, seeding: str) -> tuple[Any, dict[str, Any]]:
    """Resets to where the recorded episode began; returns the observation and the info there."""
    inner = suite_env(environment)
    observation, info = reset_to_seed(environment, recorded.seed or 0, seeding)
    task, physics = inner.environment.task, inner.environment.physics
    first = _state(recorded)[0]
    if recorded.seed is None:
        task.set_observed_positions(first)
    if np.isfinite(first).all() and not task.is_initial(physics, first):
        task.restore(physics, first)
        observation = inner.set_state(inner.get_state())
    return observation, info


def _recorded_actions(environment: gymnasium.Env, recorded: EpisodeArrays) -> Actions:
    inner = suite_env(environment)

    def actions(buffer: EpisodeBuffer) -> Iterator[NDArray]:
        del buffer
        for action, observation in zip(recorded.arrays["action"], _state(recorded)[:-1], strict=True):
            if recorded.seed is None:
                inner.environment.task.set_observed_positions(observation)
            yield action

    return actions


def _state(recorded: EpisodeArrays) -> NDArray[np.float64]:
    """Returns the observations `(T + 1, ...)` of a recording without its goals."""
    for name in (_STATE, "observation"):
        if name in recorded.arrays:
            return recorded.arrays[name]
    raise ValueError(f"episode {recorded.index} has no observations of the state")
