"""The vectorised open_cabinet domain."""

import gymnasium
import numpy as np
from numpy.typing import NDArray

from kitchen_suite.gymnasium_env.open_cabinet import FrankaOpenCabinetEnv
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
