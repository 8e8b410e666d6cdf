"""The suite's vectorised environments: many episodes stepped together, each equal to the single environment's.

`gymnasium.make_vec("kitchen_suite.gymnasium_env:KitchenSuite/FrankaKitchen-v1", num_envs=32)` builds one.
"""

from kitchen_suite.vector_env.kitchen import FrankaKitchenVectorEnv
from kitchen_suite.vector_env.open_cabinet import FrankaOpenCabinetVectorEnv

__all__ = ["FrankaKitchenVectorEnv", "FrankaOpenCabinetVectorEnv"]
