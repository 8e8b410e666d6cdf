"""The suite's Gymnasium environments; importing this module registers their ids.

`gymnasium.make("kitchen_suite.gymnasium_env:KitchenSuite/FrankaKitchen-v1")` imports it by itself.
"""

import gymnasium

from kitchen_suite.gymnasium_cabinet import FrankaOpenCabinetEnv as FrankaOpenCabinetEnv
from kitchen_suite.gymnasium_kitchen import FrankaKitchenEnv as FrankaKitchenEnv

KITCHEN_ID = "KitchenSuite/FrankaKitchen-v1"
CABINET_ID = "KitchenSuite/FrankaOpenCabinet-v1"

# Entry point, and control steps after which `make` truncates.
_ENVIRONMENTS = {
    KITCHEN_ID: ("kitchen_suite.gymnasium_kitchen:FrankaKitchenEnv", 280),
    CABINET_ID: ("kitchen_suite.gymnasium_cabinet:FrankaOpenCabinetEnv", 700),
}

for _name, (_entry_point, _steps) in _ENVIRONMENTS.items():
    if _name not in gymnasium.registry:
        gymnasium.register(_name, entry_point=_entry_point, max_episode_steps=_steps)
