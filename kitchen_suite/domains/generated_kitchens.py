"""The domain `kitchens`: parts of generated kitchens to be opened, closed, turned on or off, or moved."""

from types import MappingProxyType

from kitchen_suite.domains.domain import Domain
from kitchen_suite.environment_classes import GENERATED_KITCHEN_ENVIRONMENT
from kitchen_suite.physics_names import FAST

_VERBS = ("open", "close", "turn_on", "turn_off", "move_kettle")


_TASKS = {
    **{verb: MappingProxyType({"verbs": (verb,)}) for verb in _VERBS},
    "any": MappingProxyType({"verbs": _VERBS}),
    # Several parts in an episode, in an order that is drawn.
    "any_2": MappingProxyType({"verbs": _VERBS, "tasks_per_episode": 2}),
    "any_4": MappingProxyType({"verbs": _VERBS, "tasks_per_episode": 4}),
}


KITCHENS = Domain(
    "kitchens",
    scene="kitchen_suite.entities:build_generated_kitchen",
    task="kitchen_suite.tasks:GeneratedKitchenTask",
    tasks=MappingProxyType(_TASKS),
    env_id="KitchenSuite/Kitchens-v1",
    episode_steps=280,
    physics=FAST,
    env=GENERATED_KITCHEN_ENVIRONMENT.single,
    vector_env=GENERATED_KITCHEN_ENVIRONMENT.vector,
    expert="kitchen_suite.policies.experts.generated_kitchens:PartExpert",
    contents="kitchen_suite.tasks.generated_kitchens.file_contents:with_contents",
)
