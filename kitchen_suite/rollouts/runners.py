"""Episodes of a specification, played one by one or many at once, also by worker processes.

The runners are `workers.worker.EpisodeRunner`s.
"""

import collections
import contextlib
import math
from collections.abc import Generator, Sequence

from kitchen_suite.rollouts.controllers import PolicyController
from kitchen_suite.rollouts.episode import EpisodeArrays
from kitchen_suite.rollouts.single_rollout import SingleRollout
from kitchen_suite.rollouts.spec import RecordingSpec
from kitchen_suite.rollouts.vector_rollout import VectorRollout


def play_many(
    spec: RecordingSpec, waiting: collections.deque[tuple[int, int]], num_envs: int, num_threads: int | None
) -> Generator[tuple[int, EpisodeArrays | None], None, None]:
    """Yields the number and the arrays of each episode as it ends, None for one whose physics has diverged.

    Args:
      spec: specification of the episodes.
      waiting: numbers and seeds of episodes; it may grow while they are played.
      num_envs: number of environments.
      num_threads: number of threads that step them.
    """
    with contextlib.closing(spec.make_vector_env(num_envs, num_threads)) as environments:
        controller = PolicyController(environments, spec.find_policy())
        for index, episode in VectorRollout(environments, controller).play(waiting):
            yield index, episode.collect() if episode else None


def even_count(num_episodes: int, num_envs: int) -> int:
    """Returns the number of environments, at most `num_envs`, of which all play episodes to the end."""
    rounds = math.ceil(num_episodes / num_envs)
    return math.ceil(num_episodes / rounds)


class SingleRunner:
    """Plays its episodes one after the other."""

    def __init__(self, spec: RecordingSpec) -> None:
        self._rollout = SingleRollout(spec)
        self._waiting: collections.deque[tuple[int, int]] = collections.deque()

    def run(self, more: Sequence[tuple[int, int]]) -> tuple[int, EpisodeArrays]:
        self._waiting.extend(more)
        index, seed = self._waiting.popleft()
        return index, self._rollout.play(index, seed)


class VectorRunner:
    """Plays many of its episodes at once."""

    def __init__(self, spec: RecordingSpec, num_envs: int, num_threads: int) -> None:
        self._waiting: collections.deque[tuple[int, int]] = collections.deque()
        self._episodes = play_many(spec, self._waiting, num_envs, num_threads)

    def run(self, more: Sequence[tuple[int, int]]) -> tuple[int, EpisodeArrays | None]:
        """Returns the next episode to end, None if its physics has diverged."""
        self._waiting.extend(more)
        return next(self._episodes)
