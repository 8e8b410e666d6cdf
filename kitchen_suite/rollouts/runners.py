"""The runners of episodes in worker processes; see `workers.worker.EpisodeRunner`."""

import collections
from collections.abc import Sequence

from kitchen_suite import policies
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.rollouts.controllers import PolicyController
from kitchen_suite.rollouts.episode import EpisodeArrays
from kitchen_suite.rollouts.single_rollout import SingleRollout
from kitchen_suite.rollouts.spec import RecordingSpec
from kitchen_suite.rollouts.vector_rollout import VectorRollout


class SingleRunner:
    """Plays the episodes that it is assigned one after the other."""

    def __init__(self, spec: RecordingSpec) -> None:
        self._rollout = SingleRollout(spec)
        self._waiting: collections.deque[tuple[int, int]] = collections.deque()

    def run(self, more: Sequence[tuple[int, int]]) -> tuple[int, EpisodeArrays]:
        self._waiting.extend(more)
        index, seed = self._waiting.popleft()
        return index, self._rollout.play(index, seed)


class VectorRunner:
    """Plays many of the episodes that it is assigned at once."""

    def __init__(self, spec: RecordingSpec, num_envs: int, num_threads: int) -> None:
        controller = PolicyController(suite_env(spec.make_environment()), policies.find(spec.policy))
        self._waiting: collections.deque[tuple[int, int]] = collections.deque()
        self._ended = VectorRollout(spec.make_vector_env(num_envs, num_threads), controller).play(self._waiting)

    def run(self, more: Sequence[tuple[int, int]]) -> tuple[int, EpisodeArrays | None]:
        """Returns the next episode to end, None in place of one in which the physics diverged."""
        self._waiting.extend(more)
        index, episode = next(self._ended)
        return index, episode.collect() if episode else None
