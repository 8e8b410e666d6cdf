"""Vectorised generated kitchens."""

import gymnasium

from kitchen_suite.gymnasium_env.cabinets import KitchensEnv
from kitchen_suite.vector_env.base import SuiteVectorEnv


class KitchensVectorEnv(SuiteVectorEnv, gymnasium.vector.VectorEnv):
    """A vector of `KitchensEnv`s."""

    env_class = KitchensEnv
