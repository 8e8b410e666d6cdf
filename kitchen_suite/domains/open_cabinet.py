"""The domain `open_cabinet`: a drawer to be pulled open."""

from types import MappingProxyType

from kitchen_suite.domains.domain import Domain
from kitchen_suite.environment_classes import OPEN_CABINET_ENVIRONMENT

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
    training="kitchen_suite.training.recipes:OPEN_CABINET_RECIPE",
    expert="kitchen_suite.policies.experts.open_cabinet:DrawerExpert",
)
