"""Variations of the kitchen's parameters by groups, in the order in which they are drawn."""

from collections.abc import Callable, Collection

import numpy as np
from dm_control import mjcf

from kitchen_suite.entities.parameters import Elements, Parameter, ParameterType
from kitchen_suite.entities.scenes import Scene
from kitchen_suite.kitchen_tasks import DEFAULT_TASKS
from kitchen_suite.tasks.episode.pushes import PUSH
from kitchen_suite.tasks.kitchen.goals import GOALS
from kitchen_suite.tasks.variations import appearance
from kitchen_suite.tasks.variations.distributions import Bands, ParameterVariation, around, between, one_of
from kitchen_suite.types import Array

# Whether each of the default tasks is done at the start; without effect on those that move the same joints as
# requested ones, and on those that would be in their way.
DONE = "tasks/done"

# The open door of the hinge cabinet stands before the handle of the slide cabinet.
_IN_THE_WAY = {"slide cabinet": "hinge cabinet"}


def may_be_done(requested: Collection[str]) -> list[str]:
    """Returns the tasks that may be done at the start of an episode that asks for some."""
    in_the_way = {_IN_THE_WAY[task] for task in requested if task in _IN_THE_WAY}
    return [
        task
        for task in DEFAULT_TASKS
        if task not in in_the_way and not any(GOALS[task].shares_joints(GOALS[other]) for other in requested)
    ]


def done_parameter(scene: Scene, requested: Callable[[], Collection[str]]) -> Parameter:
    """Returns the parameter that completes some tasks at the start.

    Args:
      scene: with the goals' props.
      requested: returns the tasks that the episode that starts asks for.
    """
    joints = {task: GOALS[task].joints_in(scene) for task in DEFAULT_TASKS}
    elements = tuple(joint for task in may_be_done(requested()) for joint in joints[task])

    def write(physics: mjcf.Physics, elements: Elements, value: Array) -> None:
        possible = may_be_done(requested())
        for task, is_done in zip(DEFAULT_TASKS, value > 0.5, strict=True):
            if is_done and task in possible:
                physics.bind(joints[task]).qpos = GOALS[task].value

    parameter_type = ParameterType(
        read=lambda physics, elements: np.zeros(len(DEFAULT_TASKS)),
        write=write,
        model_fields=(),
        shape=(len(DEFAULT_TASKS),),
        non_negative=True,
    )
    return Parameter(name=DONE, unit="0 or 1", type=parameter_type, elements=elements)


_UNDONE = np.zeros(7)  # No task is done at the start.
_ALL_DONE = np.ones(7)  # Every task is done at the start.

# Burners follow their knobs, and the lamp its switch. The kettle's displacement is along x and y, and about z.
START = (
    around("franka/joint_offset", "start", seen=0.1, held_out=0.15),
    between("oven/knobs", "start", seen=(-0.3, 0.0), held_out=[(-0.5, -0.3)]),
    between("hood/switch", "start", seen=(-0.2, 0.0), held_out=[(-0.3, -0.2)]),
    between("slide_cabinet/door", "start", seen=(0.0, 0.2), held_out=[(0.2, 0.3)]),
    # The goal of `hinge cabinet` has the left door closed, which the expert does not do.
    between(
        "hinge_cabinet/doors",
        "start",
        seen=((-0.15, 0.0), (0.0, 0.5)),
        held_out=[((-0.2, 0.5), (-0.15, 0.8))],
        # Almost to where the tasks of the doors are done; from an open left door, almost to where it is closed.
        limits=((-0.8, 0.0), (0.8, 1.0)),
    ),
    between("microwave/door", "start", seen=(-0.25, 0.0), held_out=[(-0.38, -0.25)]),
    around(
        "kettle/pose",
        "start",
        seen=(0.02, 0.02, 0.15),
        held_out=(0.03, 0.03, 0.3),
        # Anywhere on the hob, whose burners are up to 0.45 m apart.
        limits=((-0.03, -0.03, -0.5), (0.5, 0.5, 0.5)),
    ),
    # Each with a probability of 1/4; held out, of 1/2.
    ParameterVariation(
        name=DONE,
        group="start",
        seen=Bands([(_UNDONE, _UNDONE)] * 3 + [(_ALL_DONE, _ALL_DONE)]),
        held_out=Bands([(_UNDONE, _UNDONE), (_ALL_DONE, _ALL_DONE)]),
    ),
)


def _cabinet(name: str) -> ParameterVariation:
    """Offset of a cabinet, which hangs on the wall above the hood: forward, and up, or down where the hood is lowered.

    It cannot move back into the wall.
    """
    return between(
        name,
        "layout",
        seen=((-0.025, -0.03, -0.015), (0.025, 0.0, 0.035)),
        held_out=[((-0.03, -0.04, 0.035), (-0.025, -0.03, 0.05)), ((0.025, -0.04, 0.035), (0.03, -0.03, 0.05))],
    )


# Poses of the furniture and of the robot's base [m, rad], and the burner of the kettle. The pedestal stands against the
# oven, so that it can only move back. A kettle on the top left burner would be at its goal.
LAYOUT = (
    between(
        "pedestal/offset",
        "layout",
        seen=((-0.03, -0.025, 0.0), (0.03, 0.0, 0.0)),
        held_out=[((-0.04, -0.035, 0.0), (-0.03, -0.025, 0.0)), ((0.03, -0.035, 0.0), (0.04, -0.025, 0.0))],
    ),
    around("microwave/offset", "layout", seen=(0.04, 0.04, 0.0), held_out=(0.05, 0.05, 0.0)),
    around("microwave/yaw", "layout", seen=0.1, held_out=0.14),
    _cabinet("slide_cabinet/offset"),
    _cabinet("hinge_cabinet/offset"),
    between(
        "hood/offset",
        "layout",
        seen=((0.0, 0.0, -0.04), (0.0, 0.0, 0.0)),
        held_out=[((0.0, 0.0, -0.055), (0.0, 0.0, -0.04))],
    ),
    one_of("kettle/burner", "layout", seen=(0.0, 1.0), held_out=(2.0,)),
)

DYNAMICS = (
    around("kitchen/friction_scale", "dynamics", seen=0.15, held_out=0.3),
    around("franka/gain_scale", "dynamics", seen=0.1, held_out=0.2),
    around("franka/damping_scale", "dynamics", seen=0.1, held_out=0.2),
    around("oven/damping_scale", "dynamics", seen=0.3, held_out=0.5),
    *(
        around(f"{prop}/{quantity}_scale", "dynamics", seen=0.3, held_out=0.5)
        for prop in ("hood", "slide_cabinet", "hinge_cabinet", "microwave")
        for quantity in ("damping", "friction")
    ),
    between("kettle/mass", "dynamics", seen=(0.6, 1.2), held_out=[(0.4, 0.6), (1.2, 1.5)]),
)

SENSING = (
    between("sensing/robot_noise", "sensing", seen=(0.5, 2.0), held_out=[(2.0, 3.0)]),
    between("sensing/object_noise", "sensing", seen=(0.5, 2.0), held_out=[(2.0, 3.0)]),
    one_of("sensing/action_delay", "sensing", seen=(0.0, 1.0), held_out=(1.0,)),
)

APPEARANCE = (
    *appearance.ROOM,
    appearance.color("walls/base_board_", appearance.TINT),
    appearance.color("counter/", appearance.TINT),
    appearance.texture("counter/", seen=(0, 1, 2), held_out=(3, 4)),
    appearance.color("cabinets/", appearance.LACQUER),
    appearance.texture("cabinets/", seen=(0, 1, 2), held_out=(3, 4)),
    appearance.color("handles/", appearance.METAL),
    appearance.color("oven/metal_", appearance.METAL),
    appearance.color("oven/enamel_", appearance.HOB),
    appearance.brightness("oven/hob_light_", seen=(0.5, 1.0), held_out=((0.0, 0.5), (1.0, 1.3))),
    *appearance.MICROWAVE,
    appearance.color("kettle/", appearance.KETTLE),
    appearance.color("kettle/grip_", appearance.TINT),
    appearance.texture("kettle/grip_", seen=(0, 1), held_out=(2, 3)),
    appearance.color("pedestal/", appearance.GREY),
)

CAMERA = appearance.cameras("overview", "workspace", "left", "right", "franka/wrist", "franka/hand")

VARIED: tuple[ParameterVariation, ...] = (*START, *LAYOUT, *DYNAMICS, *SENSING, *APPEARANCE, *CAMERA, *PUSH)
