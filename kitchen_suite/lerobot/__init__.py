"""The suite as environments of LeRobot, which imports this package where `lerobot_env_kitchen` is installed.

Otherwise `--env.discover_packages_path=kitchen_suite.lerobot` makes it do so. Importing this package registers a type
of environment for each domain: `--env.type=kitchen`, `--env.type=open_cabinet`. Needs the extra `lerobot`.
"""

from kitchen_suite import installation as _installation

_installation.installed(("lerobot",), "kitchen_suite.lerobot", "lerobot")

from kitchen_suite.lerobot.configs import SuiteEnvConfig as SuiteEnvConfig  # noqa: E402
from kitchen_suite.lerobot.configs import make_env as make_env  # noqa: E402
from kitchen_suite.lerobot.configs import register as register  # noqa: E402
from kitchen_suite.suite import DOMAINS  # noqa: E402

__all__ = ["SuiteEnvConfig", "make_env", "register"]

for _domain in DOMAINS.values():
    register(_domain)
