"""Generated kitchens with objects as Gymnasium environments."""

from typing import Any

from kitchen_suite.entities.kitchen_designs import Design
from kitchen_suite.entities.pick_and_place import DEFAULT_DESIGN
from kitchen_suite.gymnasium_env.base import SuiteEnv
from kitchen_suite.gymnasium_env.generated_kitchens import GeneratedKitchenEnv
from kitchen_suite.tasks.kitchen.control_modes import CONTROL_TIMESTEP


class PickAndPlaceEnv(SuiteEnv):
    """A Franka in a generated kitchen with objects, over `PickAndPlaceTask`: it puts them somewhere, or takes them out.

    Observation: 619 numbers, float32, fewer with `num_slots`; the same in all kitchens. See
      docs/domains/pick_and_place.md.
    Action: nine joint velocities in [-1, 1], float32, as in the kitchen.
    Info: arrays in the order of the layout's objects: `object_positions` `(5, 3)`; `(5,)` each: `requested_tasks_mask`,
      0 where there is no object, `requested_order`, `goal_places` and `start_places`, -1 for what is not requested or
      stands on a worktop, `starts_closed`, and `completion_steps`, -1 for what has not been completed. Arrays of shape
      `()`: `objects_dropped`, `is_success` and `episode_step`. With a dense reward its terms, such as `reward/carry`.
    """

    metadata = {**SuiteEnv.metadata, "render_fps": 1 / CONTROL_TIMESTEP}
    default_domain = "pick_and_place"
    default_cameras = ("workspace",)
    free_camera = GeneratedKitchenEnv.free_camera

    def __init__(self, design: Design = DEFAULT_DESIGN, split: str = "train", **arguments: Any) -> None:
        """Builds the environment; arguments as in `build_pick_and_place`, `PickAndPlaceTask` and `SuiteEnv`."""
        super().__init__(design=design, split=split, **arguments)
