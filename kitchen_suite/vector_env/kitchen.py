"""The vectorised kitchen: many kitchens stepped together as one Gymnasium vector environment."""

import functools
import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
import tree
from numpy.typing import NDArray

from kitchen_suite.gymnasium_env.base import VARIATION_SPLIT
from kitchen_suite.gymnasium_env.kitchen import FrankaKitchenEnv, GoalMethod, goal_observation
from kitchen_suite.tasks.kitchen.goal_rewards import (
    EPISODE_COMPLETIONS,
    STEP_COMPLETIONS,
    TO_COMPLETE,
    GoalArrays,
    Infos,
)
from kitchen_suite.tasks.kitchen.requests import RENDER_GOAL, TASK_ID
from kitchen_suite.tasks.orders import REQUESTED
from kitchen_suite.vector_env.base import SuiteVectorEnv


# VectorEnv is named again because some libraries recognise vectorised environments by their direct bases.
class FrankaKitchenVectorEnv(SuiteVectorEnv, gymnasium.vector.VectorEnv):
    """A vector of `FrankaKitchenEnv`s. Accepts the arguments of `SuiteVectorEnv` and of `FrankaKitchenEnv`."""

    env_class = FrankaKitchenEnv
    _template_env: FrankaKitchenEnv

    def _get_info(self) -> dict[str, NDArray]:
        infos = super()._get_info()
        return {**self._names(), **infos} if self._template_env.info_format == "lists" else infos

    def _infos_of_reset(self, options: Mapping[str, Any], mask: NDArray[np.bool_]) -> dict[str, Any]:
        if not options.keys() & {TASK_ID, RENDER_GOAL}:
            return {}
        given = (options.get(name) for name in (TASK_ID, RENDER_GOAL))
        ids, shown = ([None] * self.num_envs if rows is None else rows for rows in given)
        wanted = mask & [task_id is not None or each is not None for task_id, each in zip(ids, shown, strict=True)]
        if not wanted.any():
            return {}
        goals = self._mdp.goal_state(self._episodes.state.mdp_state)
        infos: dict[str, Any] = {"goal": goal_observation(goals, self._mdp.sensors.slices), "_goal": wanted}
        infos["goal"][~wanted] = 0.0
        if rendered := [i for i in np.flatnonzero(wanted).tolist() if shown[i]]:
            pictures = {}
            for i in rendered:
                self._episodes.show(i)
                pictures[i] = self._template_env.render_goal(goals[i])
            infos["goal_rendered"] = np.stack(
                [pictures.get(i, np.zeros_like(pictures[rendered[0]])) for i in range(self.num_envs)]
            )
            infos["_goal_rendered"] = np.isin(np.arange(self.num_envs), rendered)
        return infos

    @property
    def has_goals(self) -> bool:
        """Whether observations hold goals; only then is there `compute_reward`, as of a goal environment."""
        return self._observations.has_goals

    @GoalMethod
    def compute_reward(
        self, achieved_goal: GoalArrays, desired_goal: GoalArrays, info: Infos
    ) -> float | NDArray[np.float64]:
        """Returns rewards as `FrankaKitchenEnv.compute_reward` does; its arguments are those of that method.

        For goals `(n, ...)`, `info` may also be the infos of this environment's `step`.
        """
        return self._template_env.compute_reward(achieved_goal, desired_goal, self._split_infos(info))

    @GoalMethod
    def compute_terminated(
        self, achieved_goal: GoalArrays, desired_goal: GoalArrays, info: Infos
    ) -> bool | NDArray[np.bool_]:
        """Returns terminations as `FrankaKitchenEnv.compute_terminated` does; arguments as in `compute_reward`."""
        return self._template_env.compute_terminated(achieved_goal, desired_goal, self._split_infos(info))

    @GoalMethod
    def compute_truncated(
        self, achieved_goal: GoalArrays, desired_goal: GoalArrays, info: Infos
    ) -> bool | NDArray[np.bool_]:
        """Returns truncations as `FrankaKitchenEnv.compute_truncated` does; arguments as in `compute_reward`."""
        return self._template_env.compute_truncated(achieved_goal, desired_goal, self._split_infos(info))

    def _split_infos(self, info: Infos) -> Infos:
        """Splits infos of `step` into a list of one for each environment; returns other infos unchanged."""
        if not isinstance(info, dict) or f"_{TO_COMPLETE}_mask" not in info:
            return info
        arrays = {key: array for key, array in info.items() if not key.startswith("_")}
        return [tree.map_structure(operator.itemgetter(i), arrays) for i in range(self.num_envs)]

    def _instructions_of_episodes(self) -> Sequence[tuple[str, ...]] | None:
        if self._mdp.ordering.draw is None:
            return None
        orders = self._mdp.current_order(self._episodes.state.mdp_state)
        return [self._task.requests.instructions_in(order) for order in orders]

    @functools.cached_property
    def _remembered(self) -> tuple[Callable[[bytes], tuple[str, ...]], Callable[[bytes], tuple[str, ...]]]:
        """`goals.names` of the bytes of a mask, `goals.by_completion` of those of steps; found values are kept."""
        goals, keep = self._mdp.goals, functools.lru_cache(4096)
        selected = keep(lambda mask: tuple(goals.names(np.frombuffer(mask, bool))))
        return selected, keep(lambda steps: tuple(goals.by_completion(np.frombuffer(steps, np.int64))))

    def _names(self) -> dict[str, NDArray[np.object_]]:
        """Returns the lists of task names `(n,)` that infos of the single environment have."""
        state = self._episodes.state.mdp_state
        env = self._template_env
        count = self.num_envs
        progress, (selected, completed) = state.progress, self._remembered
        lists: dict[str, Sequence[Any]] = {
            TO_COMPLETE: [*map(list, map(selected, rows_as_bytes(progress.remaining)))],
            STEP_COMPLETIONS: [*map(list, map(selected, rows_as_bytes(progress.completions)))],
            EPISODE_COMPLETIONS: [*map(list, map(completed, rows_as_bytes(progress.completion_steps)))],
            **({VARIATION_SPLIT: (env.variation_split,) * count} if env.varies else {}),
        }
        if self._mdp.ordering.draw:
            lists[REQUESTED] = [self._task.requests.tasks_in(order) for order in state.requested_order]
        return {key: np.fromiter(names, object, count) for key, names in lists.items()}


def rows_as_bytes(array: NDArray) -> list[bytes]:
    """Returns the bytes of each row of an array `(n, k)`."""
    contiguous = np.ascontiguousarray(array)
    row = np.dtype((np.void, contiguous.itemsize * contiguous.shape[1]))
    rows: list[bytes] = contiguous.view(row)[:, 0].tolist()
    return rows
