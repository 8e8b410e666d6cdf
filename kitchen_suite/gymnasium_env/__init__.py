"""The suite's Gymnasium environments. Importing this package registers their ids, and imports no dm_control.

Each domain has an id for any of its tasks, `KitchenSuite/FrankaKitchen-v1` and `KitchenSuite/FrankaOpenCabinet-v1`, and
each task has one of its own, such as `KitchenSuite/Kettle-v1`.
"""

import importlib
from typing import TYPE_CHECKING, Any

import gymnasium

from kitchen_suite.suite import ALL_TASKS, DOMAINS

if TYPE_CHECKING:
    from kitchen_suite.gymnasium_env.kitchen import FrankaKitchenEnv as FrankaKitchenEnv
    from kitchen_suite.gymnasium_env.open_cabinet import FrankaOpenCabinetEnv as FrankaOpenCabinetEnv

__all__ = ["IDS", "KITCHEN_ID", "OPEN_CABINET_ID", "TASK_IDS", "FrankaKitchenEnv", "FrankaOpenCabinetEnv"]

# By domain of the suite.
IDS = {name: domain.env_id for name, domain in DOMAINS.items()}
KITCHEN_ID, OPEN_CABINET_ID = IDS["kitchen"], IDS["open_cabinet"]

# By domain and task of the suite.
TASK_IDS = {(domain, task): f"KitchenSuite/{task.title().replace('_', '')}-v1" for domain, task in ALL_TASKS}

_ENTRY_POINTS = {domain.env.rpartition(":")[2]: domain.env for domain in DOMAINS.values()}


def __getattr__(name: str) -> Any:
    """Imports the class of an environment when it is first used."""
    if name not in _ENTRY_POINTS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_ENTRY_POINTS[name].partition(":")[0]), name)


def __dir__() -> list[str]:
    return __all__


def _register() -> None:
    for name, domain in DOMAINS.items():
        tasks = {TASK_IDS[name, task]: arguments for task, arguments in domain.tasks.items()}
        for env_id, arguments in {domain.env_id: {}, **tasks}.items():
            if env_id not in gymnasium.registry:
                gymnasium.register(
                    env_id,
                    entry_point=domain.env,
                    vector_entry_point=domain.vector_env,
                    max_episode_steps=domain.episode_steps,
                    kwargs=dict(arguments),
                )


_register()
