"""The suite's Gymnasium environments; importing this module registers their ids.

`gymnasium.make("kitchen_suite.gymnasium_env:KitchenSuite/FrankaKitchen-v1")` imports it by itself.
"""

import gymnasium

from kitchen_suite.gymnasium_env.kitchen import FrankaKitchenEnv as FrankaKitchenEnv
from kitchen_suite.gymnasium_env.open_cabinet import FrankaOpenCabinetEnv as FrankaOpenCabinetEnv

KITCHEN_ID = "KitchenSuite/FrankaKitchen-v1"
CABINET_ID = "KitchenSuite/FrankaOpenCabinet-v1"

# By domain of the suite.
IDS = {"kitchen": KITCHEN_ID, "open_cabinet": CABINET_ID}

# Entry points of one and of many, and control steps after which `make` and `make_vec` truncate.
_ENVIRONMENTS = {
    KITCHEN_ID: (
        "kitchen_suite.gymnasium_env.kitchen:FrankaKitchenEnv",
        "kitchen_suite.vector_env.kitchen:FrankaKitchenVectorEnv",
        280,
    ),
    CABINET_ID: (
        "kitchen_suite.gymnasium_env.open_cabinet:FrankaOpenCabinetEnv",
        "kitchen_suite.vector_env.open_cabinet:FrankaOpenCabinetVectorEnv",
        700,
    ),
}

for _name, (_one, _many, _steps) in _ENVIRONMENTS.items():
    if _name not in gymnasium.registry:
        gymnasium.register(_name, entry_point=_one, vector_entry_point=_many, max_episode_steps=_steps)
