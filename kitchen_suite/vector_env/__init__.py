"""The suite's vectorised environments: many episodes stepped together, each equal to the single environment's.

`gymnasium.make_vec("kitchen_suite.gymnasium_env:KitchenSuite/FrankaKitchen-v1", num_envs=32)` builds one.
"""

import pkgutil
from typing import TYPE_CHECKING, Any

from kitchen_suite.suite import DOMAINS

if TYPE_CHECKING:
    from kitchen_suite.vector_env.cabinets import FrankaMicrowaveTableVectorEnv as FrankaMicrowaveTableVectorEnv
    from kitchen_suite.vector_env.cabinets import FrankaOpenCabinetVectorEnv as FrankaOpenCabinetVectorEnv
    from kitchen_suite.vector_env.kitchen import FrankaKitchenVectorEnv as FrankaKitchenVectorEnv

_CLASSES = {domain.vector_env.rpartition(":")[2]: domain.vector_env for domain in DOMAINS.values()}

__all__ = [*_CLASSES]


def __getattr__(name: str) -> Any:
    """Imports the class of an environment when it is first used."""
    if name in _CLASSES:
        return pkgutil.resolve_name(_CLASSES[name])
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
