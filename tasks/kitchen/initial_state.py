"""Initial qpos of the kitchen [rad, m], as the code of FrankaKitchen-v1 sets it (gymnasium-robotics 1.4.2).

Nine joints start slightly outside their ranges, and the kettle's quaternion is not normalised; both are kept.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities import Scene
from kitchen_suite.entities.joints import addresses
from kitchen_suite.entities.scenes.kitchen import JOINT_NAMES, in_observed_order
from kitchen_suite.tasks.goals import Goal

_ARM = (0.148388023, -1.76848573, 1.84390296, -2.4768576, 0.260252026, 0.712533105, 1.59515394)
_FINGERS = (0.0479267505, 0.0371350919)

# By prop.
_OBJECTS = {
    "oven": (
        *(-0.00026627985, -5.18043486e-05),
        *(3.1287722e-05, -4.51199853e-05),
        *(-3.90842156e-06, -4.22629655e-05),
        *(6.28065475e-05, 4.04984708e-05),
    ),
    "hood": (0.000462730939, -0.000226906415),
    "slide_cabinet": (-0.000465501369,),
    "hinge_cabinet": (-0.00644129196, -0.00177048263),
    "microwave": (0.00108009684,),
    "kettle": (-0.26939744, 0.350383255, 1.61944683, 1.00618764, 0.0040639512, -0.00662095997, -0.000268278933),
}

# A kettle that starts on a burner stays on it: half of the distance between burners [m].
_BURNER_RADIUS = 0.2

INITIAL_QPOS = np.array([*_ARM, *_FINGERS, *in_observed_order(_OBJECTS)])


def initial_positions(prop: str, joints: Sequence[str] | None = None) -> tuple[float, ...]:
    """Returns the initial positions of a prop's joints, or of some of them, which are hinges or slides [rad, m]."""
    positions: tuple[float, ...] = _OBJECTS[prop]
    return positions if joints is None else tuple(positions[JOINT_NAMES[prop].index(name)] for name in joints)


class Start(NamedTuple):
    """Where the joints of a goal start an episode.

    Attributes:
      prop: name of the prop.
      columns: `(k,)`, indices in qpos.
      positions: `(k,)`, positions at the start [rad, m, quaternion].
      low: `(k,)`, least positions to which variations of the start may displace the joints.
      high: `(k,)`, greatest ones.
    """

    prop: str
    columns: NDArray[np.int64]
    positions: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]

    def allows(self, qpos: NDArray[np.float64]) -> bool:
        """Whether the joints are within their bounds."""
        positions = qpos[self.columns]
        return bool(((self.low <= positions) & (positions <= self.high)).all())


def starts(goals: Mapping[str, Goal], scene: Scene, physics: mjcf.Physics) -> dict[str, Start]:
    """Returns the starts of the goals that have one, by task; hinges and slides start within their ranges."""
    return {
        task: _start(goal, goal.start, goal.joints_in(scene), physics)
        for task, goal in goals.items()
        if goal.start is not None
    }


def _start(goal: Goal, values: tuple[float, ...], joints: Sequence[mjcf.Element], physics: mjcf.Physics) -> Start:
    columns, _ = addresses(physics, joints)
    positions = np.array(values)
    if len(joints) == positions.size:
        low, high = physics.bind(joints).range.T
        return Start(goal.prop, columns, np.clip(positions, low, high), low, high)
    reach = np.array([_BURNER_RADIUS] * 3 + [np.inf] * 4)
    return Start(goal.prop, columns, positions, positions - reach, positions + reach)
