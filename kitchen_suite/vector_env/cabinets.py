"""The domains with a cabinet, a table or generated kitchens: named classes over `SuiteVectorEnv`."""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from kitchen_suite.entities.designs import Design, KitchenDesign
from kitchen_suite.gymnasium_env.cabinets import FrankaMicrowaveTableEnv, FrankaOpenCabinetEnv, KitchensEnv
from kitchen_suite.vector_env.base import SuiteVectorEnv


# VectorEnv is named again because some libraries recognise vectorised environments by their direct bases.
class FrankaOpenCabinetVectorEnv(SuiteVectorEnv, gymnasium.vector.VectorEnv):
    """A vector of `FrankaOpenCabinetEnv`s. Accepts the arguments of `SuiteVectorEnv` and of `FrankaOpenCabinetEnv`.

    Each environment counts its control steps over all its episodes. The weights of the penalties depend on the count.
    """

    env_class = FrankaOpenCabinetEnv
    _template_env: FrankaOpenCabinetEnv

    @property
    def total_steps(self) -> NDArray[np.int64]:
        """Control steps `(n,)` over all episodes of each environment, since it was built or statistics were reset."""
        return self._episodes.state.mdp_state.total_steps.copy()

    @total_steps.setter
    def total_steps(self, value: NDArray[np.int64]) -> None:
        self._episodes.state.mdp_state.total_steps[:] = value


class FrankaMicrowaveTableVectorEnv(SuiteVectorEnv, gymnasium.vector.VectorEnv):
    """A vector of `FrankaMicrowaveTableEnv`s; accepts the arguments of `SuiteVectorEnv` and of the single one."""

    env_class = FrankaMicrowaveTableEnv


class KitchensVectorEnv(SuiteVectorEnv, gymnasium.vector.VectorEnv):
    """A vector of `KitchensEnv`s. Accepts the arguments of `SuiteVectorEnv` and of `KitchensEnv`.

    `design` may also be a sequence of designs, such as `range(16)`: environment `i` then has `design[i % len(design)]`.
    """

    env_class = KitchensEnv

    def _make_templates(
        self, *, design: Design | Sequence[Design] = 0, split: str = "train", **settings: Any
    ) -> Sequence[KitchensEnv]:
        design = design.tolist() if isinstance(design, np.ndarray) else design
        if isinstance(design, str) or not isinstance(design, Sequence):
            return (KitchensEnv(design, split, **settings),)
        if not len(design):
            raise ValueError("design must have at least one design, got an empty sequence")
        made: dict[KitchenDesign, KitchensEnv] = {}
        templates = []
        for i, each in enumerate(design[: self.num_envs]):
            try:
                checked = KitchenDesign.make(each, split)
                if checked not in made:
                    made[checked] = KitchensEnv(checked, split, **settings)
                templates.append(made[checked])
                if templates[-1].observation_space != templates[0].observation_space:
                    raise ValueError("extra_observables have other sizes than in design[0]: leave them out")
            except (TypeError, ValueError) as error:
                raise (ValueError if isinstance(error, ValueError) else TypeError)(f"design[{i}]: {error}") from error
        return templates

    def _instructions_of_episodes(self) -> Sequence[tuple[str, ...]]:
        state = self._episodes.state.mdp_state
        episodes = zip(self._tasks, state.order, state.goal, strict=True)
        return [task.instructions_of(order, goal) for task, order, goal in episodes]
