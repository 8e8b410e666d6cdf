"""Plays episodes with a trained policy, many at once, each from its own seed."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.policies.trained import TrainedPolicy, flat
from kitchen_suite.training.metrics import episode_metrics
from kitchen_suite.vector_env.base import SuiteVectorEnv
from kitchen_suite.vector_env.open_cabinet import FrankaOpenCabinetVectorEnv


def evaluate(policy: TrainedPolicy, environments: SuiteVectorEnv, seeds: Sequence[int]) -> dict[str, NDArray]:
    """Plays one episode in each environment.

    Args:
      policy: what acts, without exploration.
      environments: as many as there are seeds, with autoreset mode `NextStep`.
      seeds: of the episodes.

    Returns:
      Measures of the episodes `(n,)` by name, as of `episode_metrics`, and `episode/return`.
    """
    count = environments.num_envs
    if isinstance(environments, FrankaOpenCabinetVectorEnv):
        # The penalties' weights depend on it, but an evaluation must not depend on how many went before.
        environments.total_steps = np.zeros(count, np.int64)
    observations, _ = environments.reset(seed=seeds)
    ended, returns = np.zeros(count, bool), np.zeros(count)
    measures: dict[str, NDArray] = {}
    while not ended.all():
        observations, rewards, terminations, truncations, infos = environments.step(policy(flat(observations)))
        returns += np.where(ended, 0.0, rewards)
        reason = (terminations | truncations) & ~ended
        if not reason.any():
            continue
        for name, values in episode_metrics(infos).items():
            measures[name] = np.where(reason, values, measures.get(name, 0.0))
        ended |= reason
    return {**measures, "episode/return": returns}
