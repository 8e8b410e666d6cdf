"""The domain `microwave_table`: a door to be pulled open."""

from types import MappingProxyType

from kitchen_suite.domains.domain import Domain
from kitchen_suite.environment_classes import MICROWAVE_TABLE_ENVIRONMENT

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
