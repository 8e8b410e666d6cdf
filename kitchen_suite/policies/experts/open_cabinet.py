"""The cabinet's expert: it reaches for a drawer's handle, grasps it and pulls, from observations to joint offsets."""

import dataclasses
import math

import mink
import numpy as np
from numpy.typing import NDArray

from kitchen_suite import checks
from kitchen_suite.entities import PANDA
from kitchen_suite.entities.props.cabinet import DRAWERS
from kitchen_suite.policies.experts.base import Expert, MotionStyle
from kitchen_suite.policies.experts.kinematics import ARM, ArmKinematics
from kitchen_suite.policies.experts.skills import CLOSED, OPEN, HandOrientation, Move, Skill, Vector
from kitchen_suite.policies.experts.trajectories import JointSpeedLimits, JointTrajectory, plan, retreat
from kitchen_suite.tasks.open_cabinet.action import JOINT_HIGH, JOINT_LOW
from kitchen_suite.tasks.open_cabinet.mdp import CONTROL_TIMESTEP
from kitchen_suite.tasks.open_cabinet.observation import SIZE, SLICES
from kitchen_suite.tasks.open_cabinet.reward import SUCCESS_OPENING
from kitchen_suite.tasks.open_cabinet.task import DEFAULT_POSE

_GAINS = np.array([link.actuator.gain for link in PANDA.links])

# Speed of every joint on the way [rad / control step]: 1.2 rad/s, where an episode ends at 5.
_PACE = JointSpeedLimits(joint_speed=np.full(7, 0.012), timestep=CONTROL_TIMESTEP)
# Speeds of the hand before the handle and with the drawer [m/s]; faster, the lower handle slips out.
_APPROACH_SPEED, _PULL_SPEED = 0.18, 0.2
# Control steps to close on the handle, and to let go of it.
_CLOSING_STEPS, _OPENING_STEPS = 40, 30
# How far before the handle the hand turns to go straight in, and how far it pulls [m].
_STANDOFF, _PULL = 0.08, 0.36
# How far the hand points down [degrees]: only so the arm can pull the lower handle to the end without bending its elbow
# (joint 4) to the limit.
_TILTS = {"top": 0.0, "bottom": 40.0}

# An opening from which it rests [m]: noise may make it look farther open than it is.
_ENOUGH = SUCCESS_OPENING + 0.02
# Control steps after the end of a path until it tries again: the drawer follows late.
_LINGER = 40

# Distance between hand and handle from which the grasp has failed [m]: half a pad is 0.01, and noise may add as much.
_SLIP = 0.04

# Log odds of closing the gripper that leave nothing to chance.
_CERTAIN = 50.0


def _skill(drawer: str) -> Skill:
    """How to open a drawer, in its handle's frame: z points into the cabinet, y up."""
    tilt = math.radians(_TILTS[drawer])
    approach: Vector = (0.0, -math.sin(tilt), math.cos(tilt))
    hand = HandOrientation(approach=approach, spread=(0.0, 1.0, 0.0))
    return Skill(
        steps=(
            Move(to=(0.0, 0.0, -_STANDOFF), fingers=OPEN, free=True, hand=hand),
            Move(to=(0.0, 0.0, 0.0), fingers=OPEN, speed=_APPROACH_SPEED, hand=hand),
            Move(to=(0.0, 0.0, 0.0), fingers=CLOSED, settle=_CLOSING_STEPS, hand=hand),
            Move(to=(0.0, 0.0, -_PULL), fingers=CLOSED, speed=_PULL_SPEED, hand=hand),
        ),
        posture=tuple(DEFAULT_POSE[ARM].tolist()),
        retreat=(_STANDOFF, 0.0, 0.0),
        release=_OPENING_STEPS,
    )


class DrawerExpert(Expert):
    """Opens a drawer of the cabinet and holds it open.

    On the way to a place before the handle it looks where that is, again and again, and takes the mean; then it goes
    in, grasps and pulls. It begins anew if the drawer is not open afterwards.
    """

    observation_size = SIZE
    _low, _high = -np.inf, np.inf

    def __init__(self, drawer: str = "top", *, style: MotionStyle | None = None) -> None:
        """Prepares for a drawer.

        Args:
          drawer: `top` or `bottom`.
          style: how to move; its action noise is in rad.

        Raises:
          TypeError: an argument of the wrong type.
          ValueError: there is no such drawer.
        """
        self._skill = _skill(checks.choice(drawer, DRAWERS, "drawer"))
        self._arm = ArmKinematics("open_cabinet")
        super().__init__(style)

    def reset(self, generator: np.random.Generator) -> None:
        super().reset(generator)
        self._looks = False
        self._sightings: list[NDArray[np.float64]] = []

    def _joints(self, observation: NDArray[np.float64]) -> NDArray[np.float64]:
        share = (observation[SLICES["joint_positions"]] + 1.0) / 2.0
        return (JOINT_LOW + share * (JOINT_HIGH - JOINT_LOW))[ARM]

    def _new_path(self, observation: NDArray[np.float64], joints: NDArray[np.float64]) -> JointTrajectory | None:
        first = self._path is None
        if self._looks:
            self._sightings.append(_handle(observation, self._arm.forward(joints)).wxyz_xyz)
        if not first and not self._has_ended(0 if self._looks else _LINGER) and not self._has_slipped(observation):
            return None
        if not first and observation[SLICES["drawer_position"]][0] >= _ENOUGH:
            return None
        self._looks = not self._looks
        if not self._looks:
            mean = np.mean(self._sightings, axis=0)
            handle = mink.SE3.from_rotation_and_translation(mink.SO3(wxyz=mean[:4]).normalize(), mean[4:])
            return JointTrajectory.still(joints, OPEN).then(plan(self._arm, _PACE, self._skill, frame=handle), _PACE)
        handle = _handle(observation, self._arm.forward(joints))
        self._sightings = [handle.wxyz_xyz]
        approach = dataclasses.replace(self._skill, steps=self._skill.steps[:1])
        way = plan(self._arm, _PACE, approach, frame=handle, offsets=self._offsets(1))
        if first:
            return JointTrajectory.still(joints, OPEN).then(way, _PACE)
        return retreat(self._arm, _PACE, self._skill, joints=joints, fingers=CLOSED).then(way, _PACE)

    def _has_slipped(self, observation: NDArray[np.float64]) -> bool:
        """Whether the handle is no longer between the closed fingers."""
        _, fingers = self._current_path.at(self._time)
        return fingers == CLOSED and float(np.linalg.norm(observation[SLICES["handle_offset"]])) > _SLIP

    def _action(
        self, observation: NDArray[np.float64], joints: NDArray[np.float64], target: NDArray[np.float64], fingers: float
    ) -> NDArray[np.float64]:
        arm = target - joints + self._arm.gravity(joints) / _GAINS
        return np.append(arm, _CERTAIN if fingers == CLOSED else -_CERTAIN)


def _handle(observation: NDArray[np.float64], hand: mink.SE3) -> mink.SE3:
    """Where the handle is: what is seen is how far it is from the hand."""
    position = hand.translation() + observation[SLICES["handle_offset"]]
    x, y, z, w = observation[SLICES["handle_orientation_offset"]]
    # The offset was taken from that one of the hand's two quaternions which leads to the one of length 1.
    candidates = [np.array([w, x, y, z]) + sign * hand.rotation().wxyz for sign in (1.0, -1.0)]
    best = min(candidates, key=lambda quaternion: abs(np.linalg.norm(quaternion) - 1.0))
    # Of a rotation's two quaternions always the one with a positive w, so that they have a mean.
    rotation = mink.SO3(wxyz=best * np.sign(best[0])).normalize()
    return mink.SE3.from_rotation_and_translation(rotation, position)
