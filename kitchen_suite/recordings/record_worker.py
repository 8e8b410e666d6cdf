"""What a worker plays of a recording."""

import collections
from collections.abc import Sequence

from kitchen_suite import policies
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.recordings.spec import RecordingSpec
from kitchen_suite.rollouts.episode_arrays import EpisodeArrays
from kitchen_suite.rollouts.vector_rollout import VectorRollout


class RecordWorker:
    """Plays episodes of a recording, many at once."""

    def __init__(self, recipe: RecordingSpec, num_envs: int, num_threads: int) -> None:
        """Makes everything ready.

        Args:
          recipe: what they are made of.
          num_envs: how many are played at once.
          num_threads: threads that play them.
        """
        environments = recipe.environments(num_envs, num_threads)
        recorder = VectorRollout(environments, suite_env(recipe.environment()), policies.find(recipe.policy))
        self._waiting: collections.deque[tuple[int, int]] = collections.deque()
        self._playing = recorder.play(self._waiting)

    def play(self, more: Sequence[tuple[int, int]]) -> tuple[int, EpisodeArrays | None]:
        """See `ray_pool.Player`; None in place of an episode in which the physics diverged."""
        self._waiting.extend(more)
        return next(self._playing)
