"""What a worker plays of a rollout."""

import collections
from collections.abc import Mapping, Sequence
from typing import Any

from kitchen_suite import policies, suite
from kitchen_suite.rollouts.episode import Episode, play
from kitchen_suite.tasks import OpenCabinetTask


class RolloutWorker:
    """Plays episodes of a rollout, one after the other; each is the first of an environment's life."""

    def __init__(self, domain_name: str, task_name: str, task_kwargs: Mapping[str, Any], policy: str) -> None:
        """Makes everything ready; see the flags of `rollout`."""
        self._environment = suite.load(domain_name, task_name, task_kwargs={**task_kwargs, "visuals": False})
        self._build_policy = policies.find(policy)
        self._waiting: collections.deque[tuple[int, int]] = collections.deque()

    def play(self, more: Sequence[tuple[int, int]]) -> tuple[int, Episode]:
        """See `ray_pool.Player`."""
        self._waiting.extend(more)
        index, seed = self._waiting.popleft()
        if isinstance(self._environment.task, OpenCabinetTask):
            # Rewards must not depend on what was played before.
            self._environment.task.total_steps = 0
        return index, play(self._environment, self._build_policy, seed)
