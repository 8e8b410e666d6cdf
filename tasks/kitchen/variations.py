"""The parameters of the kitchen that groups of variations vary, with their seen and held-out distributions."""

from collections.abc import Mapping

import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities.parameters import Elements, Parameter, Quantity
from kitchen_suite.entities.scenes.scene import Scene
from kitchen_suite.tasks.goals import Goal
from kitchen_suite.tasks.kitchen.goals import GOALS
from kitchen_suite.tasks.variations import Bands
from kitchen_suite.tasks.varied import Varied, around, between, one_of

# No asked task starts nearer to its goal than this multiple of its threshold.
START_DISTANCE = 1.2

# Whether each of the seven tasks is done at the start; without effect on those that are asked.
DONE = "tasks/done"

_UNDONE, _ALL_DONE = np.zeros(7), np.ones(7)

# Burners follow their knobs, and the lamp its switch. The kettle's displacement is along x and y, and about z.
START = (
    around("franka/joint_offset", "start", default=np.zeros(7), seen=0.1, held_out=0.15),
    between("oven/knobs", "start", default=np.zeros(4), seen=(-0.3, 0.0), held_out=[(-0.5, -0.3)]),
    between("hood/switch", "start", default=0.0, seen=(-0.2, 0.0), held_out=[(-0.3, -0.2)]),
    between("slide_cabinet/door", "start", default=0.0, seen=(0.0, 0.2), held_out=[(0.2, 0.3)]),
    between(
        "hinge_cabinet/doors",
        "start",
        default=(0.0, 0.0),
        seen=((-0.5, 0.0), (0.0, 0.5)),
        held_out=[((-0.8, 0.5), (-0.5, 0.8))],
    ),
    between("microwave/door", "start", default=0.0, seen=(-0.25, 0.0), held_out=[(-0.38, -0.25)]),
    around("kettle/pose", "start", default=np.zeros(3), seen=(0.02, 0.02, 0.15), held_out=(0.03, 0.03, 0.3)),
    # Each with a probability of 1/4; held out, of 1/2.
    Varied(
        name=DONE,
        group="start",
        default=np.zeros(7),
        seen=Bands([(_UNDONE, _UNDONE)] * 3 + [(_ALL_DONE, _ALL_DONE)]),
        held_out=Bands([(_UNDONE, _UNDONE), (_ALL_DONE, _ALL_DONE)]),
    ),
)

DYNAMICS = (
    around("kitchen/friction_scale", "dynamics", default=1.0, seen=0.15, held_out=0.3),
    around("franka/gain_scale", "dynamics", default=1.0, seen=0.1, held_out=0.2),
    around("franka/damping_scale", "dynamics", default=1.0, seen=0.1, held_out=0.2),
    around("oven/damping_scale", "dynamics", default=1.0, seen=0.3, held_out=0.5),
    *(
        around(f"{prop}/{quantity}_scale", "dynamics", default=1.0, seen=0.3, held_out=0.5)
        for prop in ("hood", "slide_cabinet", "hinge_cabinet", "microwave")
        for quantity in ("damping", "friction")
    ),
    between("kettle/mass", "dynamics", default=0.88, seen=(0.6, 1.2), held_out=[(0.4, 0.6), (1.2, 1.5)]),
)

SENSING = (
    between("sensing/robot_noise", "sensing", default=1.0, seen=(0.5, 2.0), held_out=[(2.0, 3.0)]),
    between("sensing/object_noise", "sensing", default=1.0, seen=(0.5, 2.0), held_out=[(2.0, 3.0)]),
    one_of("sensing/action_delay", "sensing", default=0.0, seen=(0.0, 1.0), held_out=(1.0,)),
)

VARIED: tuple[Varied, ...] = (*START, *DYNAMICS, *SENSING)


def done_parameter(scene: Scene, tasks: Mapping[str, Goal]) -> Parameter:
    """Returns the parameter that completes some tasks at the start.

    Args:
      scene: with the goals' props.
      tasks: goals of the tasks that it can complete; those of other tasks are ignored.
    """
    joints = {task: goal.joints_in(scene) for task, goal in tasks.items()}
    elements = tuple(joint for each in joints.values() for joint in each)

    def write(physics: mjcf.Physics, elements: Elements, value: NDArray[np.float64]) -> None:
        del elements
        for task, is_done in zip(GOALS, value > 0.5, strict=True):
            if is_done and task in joints:
                physics.bind(joints[task]).qpos = tasks[task].value

    quantity = Quantity(
        read=lambda physics, elements: np.zeros(len(GOALS)),
        write=write,
        model_fields=(),
        shape=(len(GOALS),),
        non_negative=True,
    )
    return Parameter(name=DONE, unit="0 or 1", quantity=quantity, elements=elements)
