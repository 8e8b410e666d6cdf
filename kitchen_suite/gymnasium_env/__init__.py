"""The suite's Gymnasium environments. Importing this package registers their ids, and imports no dm_control.

Each domain has an id for any of its tasks, `KitchenSuite/FrankaKitchen-v1` and `KitchenSuite/FrankaOpenCabinet-v1`, and
each task has one of its own, such as `KitchenSuite/Kettle-v1`.
"""

import pkgutil
from typing import TYPE_CHECKING, Any

from kitchen_suite.suite import DOMAINS

if TYPE_CHECKING:
    from kitchen_suite.gymnasium_env.cabinets import FrankaMicrowaveTableEnv as FrankaMicrowaveTableEnv
    from kitchen_suite.gymnasium_env.cabinets import FrankaOpenCabinetEnv as FrankaOpenCabinetEnv
    from kitchen_suite.gymnasium_env.kitchen import FrankaKitchenEnv as FrankaKitchenEnv

_CLASSES = {domain.env.rpartition(":")[2]: domain.env for domain in DOMAINS.values()}

__all__ = ["IDS", "KITCHEN_ID", "OPEN_CABINET_ID", "TASK_IDS", *_CLASSES]

IDS: dict[str, str]
"""Ids for any task of a domain, by the domain's name."""

TASK_IDS: dict[tuple[str, str], str]
"""Ids of single tasks, by the names of domain and task."""

KITCHEN_ID = DOMAINS["kitchen"].env_id
"""Id for any task of the kitchen: `KitchenSuite/FrankaKitchen-v1`."""

OPEN_CABINET_ID = DOMAINS["open_cabinet"].env_id
"""Id for any drawer of open_cabinet: `KitchenSuite/FrankaOpenCabinet-v1`."""


def __getattr__(name: str) -> Any:
    """Imports the class of an environment when it is first used; makes the tables of ids from the present domains."""
    if name == "IDS":
        return {domain.name: domain.env_id for domain in DOMAINS.values()}
    if name == "TASK_IDS":
        return {(domain.name, task): env_id for domain in DOMAINS.values() for task, env_id in domain.task_ids.items()}
    if name in _CLASSES:
        return pkgutil.resolve_name(_CLASSES[name])
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
