"""The suite's vectorised environments: many episodes stepped together, each equal to the single environment's.

`gymnasium.make_vec("kitchen_suite.gymnasium_env:KitchenSuite/FrankaKitchen-v1", num_envs=32)` builds one.
"""

from typing import TYPE_CHECKING

from kitchen_suite import lazy

if TYPE_CHECKING:
    from kitchen_suite.vector_env.base import SuiteVectorEnv as SuiteVectorEnv
    from kitchen_suite.vector_env.cabinets import FrankaMicrowaveTableVectorEnv as FrankaMicrowaveTableVectorEnv
    from kitchen_suite.vector_env.cabinets import FrankaOpenCabinetVectorEnv as FrankaOpenCabinetVectorEnv
    from kitchen_suite.vector_env.kitchen import FrankaKitchenVectorEnv as FrankaKitchenVectorEnv

__all__ = ["FrankaKitchenVectorEnv", "FrankaMicrowaveTableVectorEnv", "FrankaOpenCabinetVectorEnv", "SuiteVectorEnv"]

__getattr__, __dir__ = lazy.attributes(
    __name__,
    __all__,
    {
        "FrankaKitchenVectorEnv": "kitchen_suite.vector_env.kitchen:FrankaKitchenVectorEnv",
        "FrankaMicrowaveTableVectorEnv": "kitchen_suite.vector_env.cabinets:FrankaMicrowaveTableVectorEnv",
        "FrankaOpenCabinetVectorEnv": "kitchen_suite.vector_env.cabinets:FrankaOpenCabinetVectorEnv",
        "SuiteVectorEnv": "kitchen_suite.vector_env.base:SuiteVectorEnv",
    },
)
