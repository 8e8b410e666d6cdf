"""The loop that plays an episode in a single environment."""

import time
from collections.abc import Callable
from typing import Any

from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.rollouts.episode import EpisodeArrays, EpisodeBuffer
from kitchen_suite.rollouts.spec import EpisodeSpec, clipped_action, policy_generator, reset_to_seed


def episode_name(index: int, seed: int | None) -> str:
    """Returns the name of the episode of a number and a seed, if that is known."""
    return f"episode {index}" + ("" if seed is None else f", seed {seed}")


class SingleRollout:
    """Plays the episodes of a specification one by one; each depends on nothing but its seed.

    Attributes:
      environment: in which they are played.
      buffer: the steps of the episode in progress.
    """

    buffer: EpisodeBuffer

    def __init__(self, spec: EpisodeSpec, **extra: Any) -> None:
        """Makes the environment, with `extra` further arguments, and finds the policy."""
        self._spec = spec
        self.environment = spec.make_environment(**extra)
        self._build_policy = spec.find_policy()

    def start(self, seed: int, name: str = "") -> None:
        """Starts the episode of a seed, with a name for readers; raises a PolicyError if the policy cannot be built."""
        self.buffer = EpisodeBuffer(*reset_to_seed(self.environment, seed, self._spec.seeding), name=name)
        self._policy = self._build_policy(suite_env(self.environment).environment, policy_generator(seed))

    def step(self) -> None:
        """Makes a control step with the policy's action.

        Raises:
          PhysicsError: the physics has diverged.
          PolicyError: the policy raised an exception, or returned a bad action.
        """
        timestep = self.buffer.timestep(suite_env(self.environment))
        self.buffer.step(self.environment, clipped_action(self._policy, timestep, self.environment.action_space))

    def play(
        self, index: int, seed: int, watch: Callable[[EpisodeBuffer], None] = lambda buffer: None
    ) -> EpisodeArrays:
        """Plays the episode of a number and a seed; `watch` is called after the reset and after every step."""
        started = time.perf_counter()
        self.start(seed, episode_name(index, seed))
        watch(self.buffer)
        while not self.buffer.has_ended:
            self.step()
            watch(self.buffer)
        return EpisodeArrays(
            index=index,
            seed=seed,
            arrays=self.buffer.arrays(),
            seconds=time.perf_counter() - started,
            instruction=suite_env(self.environment).instruction,
        )
