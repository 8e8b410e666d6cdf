"""The loop that plays an episode in a single environment."""

import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.policies import Policy
from kitchen_suite.rollouts.episode import EpisodeArrays, EpisodeBuffer
from kitchen_suite.rollouts.spec import RecordingSpec, policy_generator, reset_to_seed

# Yields the actions of an episode, given the buffer that its steps are added to.
Actions = Callable[[EpisodeBuffer], Iterator[NDArray]]


def play(
    environment: gymnasium.Env,
    start: tuple[Any, Mapping[str, Any]],
    actions: Actions,
    watch: Callable[[EpisodeBuffer], None] = lambda buffer: None,
    name: str = "",
) -> dict[str, NDArray]:
    """Plays an episode, and returns its arrays by name.

    Args:
      environment: in which an episode has been started.
      start: observation and info of its reset.
      actions: of the episode.
      watch: called after the reset and after every step.
      name: of the episode.
    """
    buffer = EpisodeBuffer(*start, name=name)
    watch(buffer)
    for action in actions(buffer):
        observation, reward, termination, truncation, info = environment.step(action)
        buffer.add(action, observation, float(reward), termination, truncation, info)
        watch(buffer)
    return buffer.arrays()


def episode_name(index: int, seed: int | None) -> str:
    """Returns the name of the episode of a number and a seed, if that is known."""
    return f"episode {index}" + ("" if seed is None else f", seed {seed}")


class SingleRollout:
    """Plays the episodes of a specification one by one; each depends on nothing but its seed."""

    def __init__(self, spec: RecordingSpec, **extra: Any) -> None:
        """Makes the environment, with `extra` further arguments, and finds the policy."""
        self._spec = spec
        self.environment = spec.make_environment(**extra)
        self._build_policy = spec.find_policy()

    def play(
        self, index: int, seed: int, watch: Callable[[EpisodeBuffer], None] = lambda buffer: None
    ) -> EpisodeArrays:
        """Plays the episode of a number and a seed; `watch` as in the function `play`."""
        started = time.perf_counter()
        start = reset_to_seed(self.environment, seed, self._spec.seeding)
        policy = self._build_policy(suite_env(self.environment).environment, policy_generator(seed))
        arrays = play(self.environment, start, self._until_end(policy), watch, episode_name(index, seed))
        return EpisodeArrays(
            index=index,
            seed=seed,
            arrays=arrays,
            seconds=time.perf_counter() - started,
            instruction=suite_env(self.environment).instruction,
        )

    def _until_end(self, policy: Policy) -> Actions:
        inner, space = suite_env(self.environment), self.environment.action_space
        assert isinstance(space, gymnasium.spaces.Box)

        def actions(buffer: EpisodeBuffer) -> Iterator[NDArray]:
            while not buffer.has_ended:
                # Clipped here, so that the recorded action is the applied one.
                yield np.asarray(policy(buffer.timestep(inner))).clip(space.low, space.high)

        return actions
