"""The vectorised microwave table: many of them stepped together as one Gymnasium vector environment."""

import gymnasium

from kitchen_suite.gymnasium_env.microwave_table import FrankaMicrowaveTableEnv
from kitchen_suite.vector_env.base import SuiteVectorEnv


# VectorEnv is named again because some libraries recognise vectorised environments by their direct bases.
class FrankaMicrowaveTableVectorEnv(SuiteVectorEnv, gymnasium.vector.VectorEnv):
    """A vector of `FrankaMicrowaveTableEnv`s; accepts the arguments of `SuiteVectorEnv` and of the single one."""

    env_class = FrankaMicrowaveTableEnv
