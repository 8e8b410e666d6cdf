"""The domain `microwave_table`: the door of a microwave on a table is to be opened."""

from types import MappingProxyType

from kitchen_suite.domains.base import Domain

MICROWAVE_TABLE = Domain(
    "microwave_table",
    scene="kitchen_suite.entities:build_microwave_table_scene",
    task="kitchen_suite.tasks:MicrowaveTableTask",
    tasks=MappingProxyType({"open": MappingProxyType({})}),
    env_id="KitchenSuite/FrankaMicrowaveTable-v1",
    episode_steps=500,
    env="kitchen_suite.gymnasium_env.cabinets:FrankaMicrowaveTableEnv",
    vector_env="kitchen_suite.vector_env.cabinets:FrankaMicrowaveTableVectorEnv",
)
