"""The suite for LeRobot: its observations, environments and configs, and datasets of recordings.

LeRobot finds the environments where `lerobot_env_kitchen` is installed, or by
`--env.discover_packages_path=kitchen_suite.lerobot`: `--env.type=kitchen`, `--env.type=open_cabinet`. That registers
them, as the names of this package do when they are first used; both need the extra `lerobot`.
"""

from typing import TYPE_CHECKING as _TYPE_CHECKING
from typing import Any as _Any

if _TYPE_CHECKING:
    from kitchen_suite.lerobot.configs import SuiteEnvConfig as SuiteEnvConfig
    from kitchen_suite.lerobot.configs import make_env as make_env
    from kitchen_suite.lerobot.configs import register as register

__all__ = ["SuiteEnvConfig", "make_env", "register"]


def __getattr__(name: str) -> _Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from kitchen_suite.lerobot import configs

    return getattr(configs, name)
