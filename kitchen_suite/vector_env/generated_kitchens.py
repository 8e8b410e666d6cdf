"""Vectorised generated kitchens: many episodes in one kitchen, or in several."""

from collections.abc import Sequence
from typing import Any, ClassVar

import gymnasium
import numpy as np

from kitchen_suite.closing import closed_on_error
from kitchen_suite.entities.kitchen_designs import Design, KitchenDesign
from kitchen_suite.gymnasium_env.base import SuiteEnv
from kitchen_suite.gymnasium_env.generated_kitchens import GeneratedKitchenEnv
from kitchen_suite.vector_env.base import SuiteVectorEnv


class GeneratedKitchenVectorEnv(SuiteVectorEnv, gymnasium.vector.VectorEnv):
    """A vector of `GeneratedKitchenEnv`s. Accepts the arguments of `SuiteVectorEnv` and of `GeneratedKitchenEnv`.

    `design` may also be a sequence of designs, such as `range(16)`: environment `i` then has `design[i % len(design)]`.
    """

    env_class: ClassVar[type[SuiteEnv]] = GeneratedKitchenEnv

    def _make_templates(
        self, *, design: Design | Sequence[Design] = 0, split: str = "train", **settings: Any
    ) -> Sequence[SuiteEnv]:
        design = design.tolist() if isinstance(design, np.ndarray) else design
        if isinstance(design, str) or not isinstance(design, Sequence):
            return (self.env_class(design=design, split=split, **settings),)
        if not len(design):
            raise ValueError("design must have at least one design, got an empty sequence")
        made: dict[KitchenDesign, SuiteEnv] = {}
        templates = []
        with closed_on_error(made.values()):
            for i, each in enumerate(design[: self.num_envs]):
                try:
                    checked = KitchenDesign.make(each, split)
                    if checked not in made:
                        made[checked] = self.env_class(design=checked, split=split, **settings)
                    templates.append(made[checked])
                    if templates[-1].observation_space != templates[0].observation_space:
                        raise ValueError("extra_observables have other sizes than in design[0]: leave them out")
                except (TypeError, ValueError) as error:
                    kind = ValueError if isinstance(error, ValueError) else TypeError
                    raise kind(f"design[{i}]: {error}") from error
        return templates

    def _instructions_of_episodes(self) -> Sequence[tuple[str, ...]]:
        state = self._episodes.state.mdp_state
        episodes = zip(self._tasks, state.order, state.goal, strict=True)
        return [task.instructions_of(order, goal) for task, order, goal in episodes]
