"""The suite's vectorised environments: many episodes stepped together, each equal to the single environment's.

`gymnasium.make_vec("kitchen_suite.gymnasium_env:KitchenSuite/FrankaKitchen-v1", num_envs=32)` builds one.
"""

from typing import TYPE_CHECKING

from kitchen_suite import lazy

if TYPE_CHECKING:
    from kitchen_suite.vector_env.base import SuiteVectorEnv as SuiteVectorEnv
    from kitchen_suite.vector_env.kitchen import FrankaKitchenVectorEnv as FrankaKitchenVectorEnv
    from kitchen_suite.vector_env.microwave_table import FrankaMicrowaveTableVectorEnv as FrankaMicrowaveTableVectorEnv
    from kitchen_suite.vector_env.open_cabinet import FrankaOpenCabinetVectorEnv as FrankaOpenCabinetVectorEnv

__all__ = ["FrankaKitchenVectorEnv", "FrankaMicrowaveTableVectorEnv", "FrankaOpenCabinetVectorEnv", "SuiteVectorEnv"]

__getattr__, __dir__ = lazy.attributes(
    __name__,
    __all__,
    {
        "FrankaKitchenVectorEnv": "kitchen_suite.vector_env.kitchen:FrankaKitchenVectorEnv",
        "FrankaMicrowaveTableVectorEnv": "kitchen_suite.vector_env.microwave_table:FrankaMicrowaveTableVectorEnv",
        "FrankaOpenCabinetVectorEnv": "kitchen_suite.vector_env.open_cabinet:FrankaOpenCabinetVectorEnv",
        "SuiteVectorEnv": "kitchen_suite.vector_env.base:SuiteVectorEnv",
    },
)
