"""Evaluation of a trained policy on vectorised environments, one episode from each seed."""

import collections
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.policies.trained import TrainedPolicy
from kitchen_suite.rollouts.rollout import Controller, NetworkController, VectorRollout
from kitchen_suite.tasks.task import SuiteTask
from kitchen_suite.vector_env.base import SuiteVectorEnv

EPISODE_METRICS = ("episode/success", "episode/progress", "episode/length")


def step_metrics(infos: Mapping[str, Any]) -> dict[str, NDArray]:
    """Returns the reward terms `(n,)` of a step; none if the task's reward has no terms.

    Where the step ended an episode and the next one has begun (autoreset mode `SameStep`), they are those of the step,
    not of the reset.
    """
    ended, final_info = infos.get("_final_info", False), infos.get("final_info", infos)
    terms = [name for name in infos if name.startswith("reward/")]
    return {f"step/{name}": np.where(ended, final_info[name], infos[name]) for name in terms}


def episode_metrics(task: SuiteTask, infos: Mapping[str, Any]) -> dict[str, NDArray]:
    """Returns the `EPISODE_METRICS` `(n,)` of episodes of a task from their last infos."""
    values = (infos["is_success"], task.progress_in(infos), infos["episode_step"])
    return {name: np.asarray(value, np.float64) for name, value in zip(EPISODE_METRICS, values, strict=True)}


def network_controller(policy: TrainedPolicy, environments: SuiteVectorEnv) -> Controller:
    """Returns a controller that acts by a policy of PPO in all environments at once."""
    flatten = environments.composer_task.policy_inputs.flatten
    return NetworkController(lambda observations: policy(flatten(observations)))


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
    task = environments.composer_task
    metrics = {name: np.zeros(len(seeds)) for name in (*EPISODE_METRICS, "episode/return")}
    for index, episode in rollout.play(collections.deque(enumerate(seeds))):
        if episode:
            for name, value in episode_metrics(task, episode.last_info).items():
                metrics[name][index] = value
            metrics["episode/return"][index] = episode.total_reward
    return metrics
