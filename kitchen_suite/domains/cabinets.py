"""The domains of a drawer or a door to be opened: `open_cabinet` and `microwave_table`."""

from types import MappingProxyType

from kitchen_suite.domains.base import Domain
from kitchen_suite.names import MICROWAVE_TABLE_ENVIRONMENT, OPEN_CABINET_ENVIRONMENT

OPEN_CABINET = Domain(
    "open_cabinet",
    scene="kitchen_suite.entities:build_open_cabinet_scene",
    task="kitchen_suite.tasks:OpenCabinetTask",
    tasks=MappingProxyType({f"{drawer}_drawer": {"drawer": drawer} for drawer in ("top", "bottom")}),
    env_id="KitchenSuite/FrankaOpenCabinet-v1",
    episode_steps=700,
    task_id="KitchenSuite/{}-v1",
    env=OPEN_CABINET_ENVIRONMENT.single,
    vector_env=OPEN_CABINET_ENVIRONMENT.vector,
    training="kitchen_suite.training.hyperparameters:OPEN_CABINET_RECIPE",
    expert="kitchen_suite.policies.experts.open_cabinet:DrawerExpert",
    benchmark="kitchen_suite.benchmarks.open_cabinet:OPEN_CABINET",
)


MICROWAVE_TABLE = Domain(
    "microwave_table",
    scene="kitchen_suite.entities:build_microwave_table_scene",
    task="kitchen_suite.tasks:MicrowaveTableTask",
    tasks=MappingProxyType({"open": MappingProxyType({})}),
    env_id="KitchenSuite/FrankaMicrowaveTable-v1",
    episode_steps=500,
    env=MICROWAVE_TABLE_ENVIRONMENT.single,
    vector_env=MICROWAVE_TABLE_ENVIRONMENT.vector,
    expert="kitchen_suite.policies.experts.microwave_table:MicrowaveExpert",
)
