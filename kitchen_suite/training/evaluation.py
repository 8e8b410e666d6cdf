"""Evaluation of a trained policy on vectorised environments, one episode from each seed."""

import collections
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.policies.trained import TrainedPolicy, flat
from kitchen_suite.rollouts.controllers import Controller, NetworkController
from kitchen_suite.rollouts.vector_rollout import VectorRollout
from kitchen_suite.training.metrics import EPISODE_METRICS, episode_metrics
from kitchen_suite.vector_env.base import SuiteVectorEnv


def network_controller(policy: TrainedPolicy) -> Controller:
    """Returns a controller that acts by a policy of PPO in all environments at once."""
    return NetworkController(lambda observations: policy(flat(observations)))


def evaluate(controller: Controller, environments: SuiteVectorEnv, seeds: Sequence[int]) -> dict[str, NDArray]:
    """Plays an episode of each seed, without exploration.

    Args:
      controller: acts by the policy.
      environments: with autoreset mode `Disabled`.
      seeds: of the episodes.

    Returns:
      Metrics of the episodes `(n,)` by name: those of `episode_metrics`, and `episode/return`; all are 0 for an episode
      in which the physics has diverged.
    """
    rollout = VectorRollout(environments, controller)
    task = environments.template_env.environment.task
    metrics = {name: np.zeros(len(seeds)) for name in (*EPISODE_METRICS, "episode/return")}
    for index, episode in rollout.play(collections.deque(enumerate(seeds))):
        if episode:
            for name, value in episode_metrics(task, episode.last_info).items():
                metrics[name][index] = value
            metrics["episode/return"][index] = episode.total_reward
    return metrics
