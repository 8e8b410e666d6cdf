"""The vectorised microwave_table domain."""

import gymnasium

from kitchen_suite.gymnasium_env.microwave_table import FrankaMicrowaveTableEnv
from kitchen_suite.vector_env.base import SuiteVectorEnv


class FrankaMicrowaveTableVectorEnv(SuiteVectorEnv, gymnasium.vector.VectorEnv):
    """A vector of `FrankaMicrowaveTableEnv`s; accepts the arguments of `SuiteVectorEnv` and of the single one."""

    env_class = FrankaMicrowaveTableEnv
