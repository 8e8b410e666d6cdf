"""Plays episodes, each with its own seed, and keeps what happened in them."""

import dataclasses
import time
from collections.abc import Callable, Mapping

import dm_env
import numpy as np
from numpy.typing import NDArray

from kitchen_suite.environment import Environment
from kitchen_suite.policies import PolicyBuilder

# A verdict, a measure, or control steps by the name of what happened then.
Result = bool | int | float | dict[str, int]

# Tells the policy's random numbers from all others that are drawn with the same seed.
POLICY_STREAM = 1


@dataclasses.dataclass(frozen=True, kw_only=True)
class EpisodeStats:
    """What came of an episode.

    Attributes:
      seed: fixes the episode: environment and policy draw from states made from it.
      steps: number of control steps.
      total_reward: undiscounted return.
      results: what the task reports of the episode, by name.
      seconds: time it took to play [s].
    """

    seed: int
    steps: int
    total_reward: float
    results: dict[str, Result]
    seconds: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class Episode:
    """What happened in an episode of `T` control steps.

    Attributes:
      observations: by key, `(T + 1, ...)`.
      actions: `(T, n)`.
      rewards: `(T,)`.
      discounts: `(T,)`; the last one is 0 if the episode terminated, 1 if its time ran out.
      outcome: what came of it.
    """

    observations: Mapping[str, NDArray]
    actions: NDArray[np.float64]
    rewards: NDArray[np.float64]
    discounts: NDArray[np.float64]
    outcome: EpisodeStats


def play(
    environment: Environment,
    build_policy: PolicyBuilder,
    seed: int,
    watch: Callable[[dm_env.TimeStep], None] = lambda timestep: None,
) -> Episode:
    """Plays one episode, the same for the same seed whatever was played before.

    Args:
      environment: where it is played.
      build_policy: makes the policy that acts in it.
      seed: a non-negative integer of any size.
      watch: called after the reset and after every step.
    """
    started = time.perf_counter()
    environment.random_state = seed
    policy = build_policy(environment, np.random.default_rng((seed, POLICY_STREAM)))
    timestep = environment.reset()
    # Copies: a policy may change the arrays it is given.
    observations, actions, rewards, discounts = [_copy(timestep.observation)], [], [], []
    watch(timestep)
    while not timestep.last():
        actions.append(policy(timestep))
        timestep = environment.step(actions[-1])
        observations.append(_copy(timestep.observation))
        rewards.append(timestep.reward)
        discounts.append(timestep.discount)
        watch(timestep)
    return Episode(
        observations={key: np.stack([row[key] for row in observations]) for key in observations[0]},
        actions=np.array(actions, np.float64),
        rewards=np.array(rewards, np.float64),
        discounts=np.array(discounts, np.float64),
        outcome=EpisodeStats(
            seed=seed,
            steps=len(rewards),
            total_reward=float(sum(rewards)),
            results=environment.task.episode_results,
            seconds=time.perf_counter() - started,
        ),
    )


def _copy(observation: Mapping[str, NDArray]) -> dict[str, NDArray]:
    return {key: np.array(value) for key, value in observation.items()}
