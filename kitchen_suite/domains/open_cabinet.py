"""The domain `open_cabinet`: a drawer of a cabinet is to be opened."""

from types import MappingProxyType

from kitchen_suite.domains.base import Domain

OPEN_CABINET = Domain(
    "open_cabinet",
    scene="kitchen_suite.entities:build_open_cabinet_scene",
    task="kitchen_suite.tasks:OpenCabinetTask",
    tasks=MappingProxyType({f"{drawer}_drawer": {"drawer": drawer} for drawer in ("top", "bottom")}),
    env_id="KitchenSuite/FrankaOpenCabinet-v1",
    episode_steps=700,
    task_id="KitchenSuite/{}-v1",
    env="kitchen_suite.gymnasium_env.cabinets:FrankaOpenCabinetEnv",
    vector_env="kitchen_suite.vector_env.cabinets:FrankaOpenCabinetVectorEnv",
    training="kitchen_suite.training.recipes:OPEN_CABINET",
    expert="kitchen_suite.policies.experts.open_cabinet:DrawerExpert",
    benchmark="kitchen_suite.benchmarks.open_cabinet:OPEN_CABINET",
)
