"""The domain `pick_and_place`: objects of generated kitchens to be put on or in places, or taken out of them."""

from types import MappingProxyType

from kitchen_suite.domains.domain import Domain
from kitchen_suite.environment_classes import PICK_AND_PLACE_ENVIRONMENT
from kitchen_suite.physics_names import FAST

_VERBS = ("put_on", "put_in", "take_out", "open_and_put_in")

_TASKS = {
    **{verb: MappingProxyType({"verbs": (verb,)}) for verb in _VERBS},
    "any": MappingProxyType({"verbs": _VERBS}),
    # Two objects in an episode, in an order that is drawn.
    "any_2": MappingProxyType({"verbs": _VERBS, "tasks_per_episode": 2}),
}

PICK_AND_PLACE = Domain(
    "pick_and_place",
    scene="kitchen_suite.entities:build_pick_and_place",
    task="kitchen_suite.tasks:PickAndPlaceTask",
    tasks=MappingProxyType(_TASKS),
    env_id="KitchenSuite/PickAndPlace-v1",
    episode_steps=500,
    physics=FAST,
    env=PICK_AND_PLACE_ENVIRONMENT.single,
    vector_env=PICK_AND_PLACE_ENVIRONMENT.vector,
    expert="kitchen_suite.policies.experts.pick_and_place:ObjectExpert",
    measures=MappingProxyType({"objects_dropped": 0.0, "peak_carried_contact_force": 0.0}),
    contents="kitchen_suite.tasks.pick_and_place.file_contents:with_contents",
)
