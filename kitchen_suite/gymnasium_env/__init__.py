"""The suite's Gymnasium environments; importing this package registers their ids.

`gymnasium.make("kitchen_suite.gymnasium_env:KitchenSuite/FrankaKitchen-v1")` imports it by itself.
"""

import gymnasium

from kitchen_suite.gymnasium_env import kitchen, open_cabinet
from kitchen_suite.gymnasium_env.kitchen import FrankaKitchenEnv as FrankaKitchenEnv
from kitchen_suite.gymnasium_env.open_cabinet import FrankaOpenCabinetEnv as FrankaOpenCabinetEnv

KITCHEN_ID = "KitchenSuite/FrankaKitchen-v1"
OPEN_CABINET_ID = "KitchenSuite/FrankaOpenCabinet-v1"

# By domain of the suite.
IDS = {"kitchen": KITCHEN_ID, "open_cabinet": OPEN_CABINET_ID}

# By id: entry points of the single and of the vectorised environment, and where `make` and `make_vec` truncate.
_ENVIRONMENTS = {
    KITCHEN_ID: (
        "kitchen_suite.gymnasium_env.kitchen:FrankaKitchenEnv",
        "kitchen_suite.vector_env.kitchen:FrankaKitchenVectorEnv",
        kitchen.EPISODE_STEPS,
    ),
    OPEN_CABINET_ID: (
        "kitchen_suite.gymnasium_env.open_cabinet:FrankaOpenCabinetEnv",
        "kitchen_suite.vector_env.open_cabinet:FrankaOpenCabinetVectorEnv",
        open_cabinet.EPISODE_STEPS,
    ),
}

for _id, (_single, _vectorised, _steps) in _ENVIRONMENTS.items():
    if _id not in gymnasium.registry:
        gymnasium.register(_id, entry_point=_single, vector_entry_point=_vectorised, max_episode_steps=_steps)
