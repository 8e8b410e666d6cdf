"""Vectorised generated kitchens with objects: many episodes in one kitchen, or in several."""

from collections.abc import Sequence
from typing import Any

from kitchen_suite.entities.kitchen_designs import Design
from kitchen_suite.entities.pick_and_place import DEFAULT_DESIGN
from kitchen_suite.gymnasium_env.base import SuiteEnv
from kitchen_suite.gymnasium_env.pick_and_place import PickAndPlaceEnv
from kitchen_suite.tasks.pick_and_place.mdp import Request
from kitchen_suite.vector_env.generated_kitchens import GeneratedKitchenVectorEnv


class PickAndPlaceVectorEnv(GeneratedKitchenVectorEnv):
    """A vector of `PickAndPlaceEnv`s. Accepts the arguments of `SuiteVectorEnv` and of `PickAndPlaceEnv`.

    `design` may also be a sequence of designs, as in `GeneratedKitchenVectorEnv`.
    """

    env_class = PickAndPlaceEnv

    def _make_templates(
        self, *, design: Design | Sequence[Design] = DEFAULT_DESIGN, **settings: Any
    ) -> Sequence[SuiteEnv]:
        return super()._make_templates(design=design, **settings)

    def _instructions_of_episodes(self) -> Sequence[tuple[str, ...]]:
        request = self._episodes.state.mdp_state.request
        rows = (Request(*row) for row in zip(*request, strict=True))
        return [task.instructions_of(row) for task, row in zip(self._tasks, rows, strict=True)]
