"""The cabinet's expert: it reaches for a drawer's handle, grasps it and pulls, from observations to joint offsets."""

import math

import mink
import numpy as np
from numpy.typing import NDArray

from kitchen_suite import checks
from kitchen_suite.entities import PANDA
from kitchen_suite.entities.cabinet import DRAWERS
from kitchen_suite.experts.arm import ARM, Arm
from kitchen_suite.experts.expert import Expert, Style
from kitchen_suite.experts.planning import Pace, Path, plan, retreat
from kitchen_suite.experts.skills import CLOSED, OPEN, Hand, Move, Skill, Vector
from kitchen_suite.tasks.drawer_control import JOINT_HIGH, JOINT_LOW
from kitchen_suite.tasks.drawer_observation import SIZE, SLICES
from kitchen_suite.tasks.drawer_reward import SUCCESS_OPENING
from kitchen_suite.tasks.open_cabinet import CONTROL_TIMESTEP, DEFAULT_POSE

_GAINS = np.array([link.servo.gain for link in PANDA.links])

# Speed of every joint on the way [rad / control step]: 1.2 rad/s, where an episode ends at 5.
_PACE = Pace(joint_speed=np.full(7, 0.012), timestep=CONTROL_TIMESTEP)
# Speeds of the hand before the handle and with the drawer [m/s]; control steps to close on it.
_APPROACH_SPEED, _PULL_SPEED = 0.18, 0.15
_CLOSING_STEPS = 60
# How far before the handle the hand turns to go straight in, and how far it pulls [m].
_STANDOFF, _PULL = 0.08, 0.36
# How far the hand points down [degrees]: a level hand cannot reach the lower handle.
_TILTS = {"top": 0.0, "bottom": 20.0}

# An opening from which it rests [m]: noise may make it look farther open than it is.
_ENOUGH = SUCCESS_OPENING + 0.02
# Control steps after the end of a path until it tries again: the drawer follows late.
_LINGER = 40

# Log odds of closing the gripper that leave nothing to chance.
_CERTAIN = 50.0


def _skill(drawer: str) -> Skill:
    """How to open a drawer, in its handle's frame: z points into the cabinet, y up."""
    tilt = math.radians(_TILTS[drawer])
    approach: Vector = (0.0, -math.sin(tilt), math.cos(tilt))
    hand = Hand(approach=approach, spread=(0.0, 1.0, 0.0))
    return Skill(
        steps=(
            Move(to=(0.0, 0.0, -_STANDOFF), fingers=OPEN, free=True, hand=hand),
            Move(to=(0.0, 0.0, 0.0), fingers=OPEN, speed=_APPROACH_SPEED, hand=hand),
            Move(to=(0.0, 0.0, 0.0), fingers=CLOSED, settle=_CLOSING_STEPS, hand=hand),
            Move(to=(0.0, 0.0, -_PULL), fingers=CLOSED, speed=_PULL_SPEED, hand=hand),
        ),
        posture=tuple(DEFAULT_POSE[ARM].tolist()),
        retreat=(_STANDOFF, 0.0, 0.0),
        release=_CLOSING_STEPS,
    )


class DrawerExpert(Expert):
    """Opens a drawer of the cabinet and holds it open."""

    observation_size = SIZE
    _low, _high = -np.inf, np.inf

    def __init__(self, drawer: str = "top", *, style: Style | None = None) -> None:
        """Prepares for a drawer.

        Args:
          drawer: `top` or `bottom`.
          style: how to move; its action noise is in rad.

        Raises:
          TypeError: an argument of the wrong type.
          ValueError: there is no such drawer.
        """
        self._skill = _skill(checks.choice(drawer, DRAWERS, "drawer"))
        self._arm = Arm("open_cabinet")
        super().__init__(style)

    def _joints(self, observation: NDArray[np.float64]) -> NDArray[np.float64]:
        share = (observation[SLICES["joint_positions"]] + 1.0) / 2.0
        return (JOINT_LOW + share * (JOINT_HIGH - JOINT_LOW))[ARM]

    def _new_path(self, observation: NDArray[np.float64], joints: NDArray[np.float64]) -> Path | None:
        first, opening = self._path is None, float(observation[SLICES["drawer_position"]][0])
        if not first and (opening >= _ENOUGH or not self._has_ended(_LINGER)):
            return None
        start = Path.still(joints, OPEN)
        if not first:
            start = retreat(self._arm, _PACE, self._skill, joints=joints, fingers=CLOSED)
        handle = _handle(observation, self._arm.pose(joints))
        return start.then(plan(self._arm, _PACE, self._skill, frame=handle, offsets=self._offsets(1)), _PACE)

    def _action(
        self, observation: NDArray[np.float64], joints: NDArray[np.float64], target: NDArray[np.float64], fingers: float
    ) -> NDArray[np.float64]:
        arm = target - joints + self._arm.gravity(joints) / _GAINS
        return np.append(arm, _CERTAIN if fingers == CLOSED else -_CERTAIN)


def _handle(observation: NDArray[np.float64], hand: mink.SE3) -> mink.SE3:
    """Where the handle is: what is seen is how far it is from the hand."""
    position = hand.translation() + observation[SLICES["handle_offset"]]
    x, y, z, w = observation[SLICES["handle_orientation_offset"]]
    # Of the hand's two quaternions the offset was taken from the one that leads to a unit one.
    candidates = [np.array([w, x, y, z]) + sign * hand.rotation().wxyz for sign in (1.0, -1.0)]
    best = min(candidates, key=lambda quaternion: abs(np.linalg.norm(quaternion) - 1.0))
    return mink.SE3.from_rotation_and_translation(mink.SO3(wxyz=best / np.linalg.norm(best)), position)
