"""Plays episodes in vectorised environments, each from its own seed, and keeps what happened in them."""

import collections
from collections.abc import Generator, Iterator, Mapping

import gymnasium
import numpy as np
from numpy.typing import NDArray

from kitchen_suite.gymnasium_env.base import SuiteEnv
from kitchen_suite.policies import PolicyBuilder, PolicyError
from kitchen_suite.rollouts.episode import POLICY_STREAM
from kitchen_suite.rollouts.episode_arrays import EpisodeArrays, flatten, suite_view
from kitchen_suite.rollouts.take import EpisodeBuffer, Row
from kitchen_suite.vector_env.base import SuiteVectorEnv
from kitchen_suite.vector_env.open_cabinet import FrankaOpenCabinetVectorEnv


class VectorRollout:
    """Plays many episodes at once; each is what it would be alone, in a new environment."""

    def __init__(self, environments: SuiteVectorEnv, single: SuiteEnv, build_policy: PolicyBuilder) -> None:
        """Makes everything ready.

        Args:
          environments: where they are played; their autoreset mode is `Disabled`.
          single: one such environment; it is not stepped.
          build_policy: makes the policy of an episode.
        """
        self._environments, self._single, self._build_policy = environments, single, build_policy
        self._view = suite_view(single)

    def play(self, waiting: collections.deque[tuple[int, int]]) -> Iterator[tuple[int, EpisodeArrays | None]]:
        """Plays episodes; gives each one's number and what happened in it when it has ended.

        None stands in place of an episode in which the physics diverged.

        Args:
          waiting: numbers and seeds of episodes, taken from the left; it may grow while they are played.
        """
        takes: list[EpisodeBuffer | None] = [None] * self._environments.num_envs
        ended = np.full(len(takes), True)
        while True:
            if waiting:
                ended |= [take is None for take in takes]
            for i in np.flatnonzero(ended):
                takes[i] = self._next(waiting)
            if not any(takes):
                return
            self._start(takes, ended)
            ended = yield from self._step(takes)

    def _next(self, waiting: collections.deque[tuple[int, int]]) -> EpisodeBuffer | None:
        if not waiting:
            return None
        index, seed = waiting.popleft()
        # The same as `episodes.play` gives a policy.
        policy = self._build_policy(self._single.environment, np.random.default_rng((seed, POLICY_STREAM)))
        return EpisodeBuffer(index, seed, policy)

    def _start(self, takes: list[EpisodeBuffer | None], mask: NDArray[np.bool_]) -> None:
        """Resets the environments of new takes, and those that are idle but have ended."""
        if not mask.any():
            return
        environments = self._environments
        if isinstance(environments, FrankaOpenCabinetVectorEnv):
            # Rewards must not depend on what was played before.
            environments.total_steps = np.where(mask, 0, environments.total_steps)
        seeds = [take.seed if take and new else None for take, new in zip(takes, mask, strict=True)]
        observations, infos = environments.reset(seed=seeds, options={"reset_mask": mask})
        frame = _frame(observations, infos)
        for i in np.flatnonzero(mask):
            if take := takes[i]:
                take.rows.append(_row(frame, i))

    def _step(
        self, takes: list[EpisodeBuffer | None]
    ) -> Generator[tuple[int, EpisodeArrays | None], None, NDArray[np.bool_]]:
        """Makes a control step; gives the episodes that it ends, and returns which environments these are in."""
        actions = self._act(takes)
        observations, rewards, terminations, truncations, infos = self._environments.step(actions)
        diverged = infos.pop("physics_error", np.zeros(len(takes), bool))
        frame = _frame(observations, infos)
        ended: NDArray[np.bool_] = terminations | truncations
        for i, take in enumerate(takes):
            if take is None:
                continue
            take.add(_row(frame, i), (actions[i], rewards[i], terminations[i], truncations[i]))
            if ended[i]:
                yield take.index, None if diverged[i] else take.finish(len(takes))
        return ended

    def _act(self, takes: list[EpisodeBuffer | None]) -> NDArray[np.float32]:
        """What the policies do now, `(n, ...)`, as it can be applied; zeros where no episode is played."""
        space = self._environments.single_action_space
        assert isinstance(space, gymnasium.spaces.Box)
        actions = np.zeros((len(takes), *space.shape), space.dtype)
        for i, take in enumerate(takes):
            if take:
                # Clipped here, so that what is applied is what is recorded.
                action = take.act(self._view).clip(space.low, space.high)
                if np.abs(action).max() > np.finfo(space.dtype).max:
                    raise PolicyError(f"the policy's action does not fit into {space.dtype}: {action}")
                actions[i] = action
        return actions


def _frame(observations: object, infos: Mapping[str, NDArray]) -> dict[str, NDArray]:
    """Observations and infos of all environments, `(n, ...)` each, without the infos' masks."""
    shown = {name: array for name, array in infos.items() if not name.startswith("_")}
    return {**flatten(observations, "observation"), **flatten(shown, "info")}


def _row(frame: Mapping[str, NDArray], i: int | np.integer) -> Row:
    return {name: array[i] for name, array in frame.items()}
