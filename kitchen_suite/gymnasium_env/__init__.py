"""The suite's Gymnasium environments. Importing this package registers their ids, and imports no dm_control.

Each domain has an id for any of its tasks, such as `KitchenSuite/FrankaKitchen-v1`, and each task has one of its own,
such as `KitchenSuite/Kettle-v1`.
"""

from typing import TYPE_CHECKING

from kitchen_suite import lazy
from kitchen_suite.suite import DOMAINS

if TYPE_CHECKING:
    from kitchen_suite.gymnasium_env.base import SuiteEnv as SuiteEnv
    from kitchen_suite.gymnasium_env.kitchen import FrankaKitchenEnv as FrankaKitchenEnv
    from kitchen_suite.gymnasium_env.microwave_table import FrankaMicrowaveTableEnv as FrankaMicrowaveTableEnv
    from kitchen_suite.gymnasium_env.open_cabinet import FrankaOpenCabinetEnv as FrankaOpenCabinetEnv

__all__ = [
    "IDS",
    "KITCHEN_ID",
    "OPEN_CABINET_ID",
    "TASK_IDS",
    "FrankaKitchenEnv",
    "FrankaMicrowaveTableEnv",
    "FrankaOpenCabinetEnv",
    "SuiteEnv",
]

IDS: dict[str, str]
"""Ids for any task of a domain, by the domain's name."""

TASK_IDS: dict[tuple[str, str], str]
"""Ids of single tasks, by the names of domain and task."""

KITCHEN_ID = DOMAINS["kitchen"].env_id
"""Id for any task of the kitchen: `KitchenSuite/FrankaKitchen-v1`."""

OPEN_CABINET_ID = DOMAINS["open_cabinet"].env_id
"""Id for any drawer of open_cabinet: `KitchenSuite/FrankaOpenCabinet-v1`."""

__getattr__, __dir__ = lazy.attributes(
    __name__,
    __all__,
    {
        "IDS": lambda: {domain.name: domain.env_id for domain in DOMAINS.values()},
        "TASK_IDS": lambda: {
            (domain.name, task): env_id for domain in DOMAINS.values() for task, env_id in domain.task_ids.items()
        },
        "FrankaKitchenEnv": "kitchen_suite.gymnasium_env.kitchen:FrankaKitchenEnv",
        "FrankaMicrowaveTableEnv": "kitchen_suite.gymnasium_env.microwave_table:FrankaMicrowaveTableEnv",
        "FrankaOpenCabinetEnv": "kitchen_suite.gymnasium_env.open_cabinet:FrankaOpenCabinetEnv",
        "SuiteEnv": "kitchen_suite.gymnasium_env.base:SuiteEnv",
    },
)
