"""The suite as environments of LeRobot: `--env.discover_packages_path=kitchen_suite.lerobot`. Needs the extra `lerobot`.

Importing this package registers a type of environment for each domain: `--env.type=kitchen`, `--env.type=open_cabinet`.
"""

from kitchen_suite.lerobot.configs import SuiteEnvConfig as SuiteEnvConfig
from kitchen_suite.lerobot.configs import make_env as make_env
from kitchen_suite.lerobot.configs import register as register
from kitchen_suite.suite import DOMAINS

__all__ = ["SuiteEnvConfig", "make_env", "register"]

for _domain in DOMAINS.values():
    register(_domain)
