"""The expert of the microwave on a table, which takes the door's handle and swings the door open."""

import functools
from typing import Any

import mink
import numpy as np
from dm_control import mjcf

from kitchen_suite.entities import MicrowaveTableArena, build_microwave_table_scene
from kitchen_suite.policies.experts import skills
from kitchen_suite.policies.experts.base import Expert, MotionStyle
from kitchen_suite.policies.experts.encoders import make_encoder
from kitchen_suite.policies.experts.kitchen_skills import UP, grasp
from kitchen_suite.policies.experts.open_cabinet import panda_model
from kitchen_suite.policies.experts.skills import CLOSED, OPEN, ArcMove, HandOrientation, Move, Revolute, Skill
from kitchen_suite.policies.experts.trajectories import JointTrajectory
from kitchen_suite.tasks.control_modes.joints import DEFAULT_POSE
from kitchen_suite.tasks.control_modes.registry import make_mode
from kitchen_suite.tasks.microwave_table.mdp import OPEN_ANGLE, SIZE, SLICES
from kitchen_suite.tasks.microwave_table.task import CONTROL_MODES, GOAL
from kitchen_suite.types import Array

# The hand at the grasp: that of the start, turned about its axis by a quarter, which moves the last joint alone.
_GRASP = HandOrientation(approach=(0.866, 0.0, -0.5), spread=(0.0, 1.0, 0.0))
# Distances of the hand's site from its place at the handle: far, near and there [m].
_DISTANCES = (0.11, 0.07, 0.0)
# In control modes in which the hand cannot turn, its fingers stand one above the other. They press against the bar from
# the right, so high that the palm passes above it. Places of the site before and while it presses, relative to the
# handle: to the right, ahead, and up [m].
_BESIDE, _PRESSED = 0.05, 0.01
_AHEAD, _ABOVE = 0.015, 0.11
_RETREAT = (-0.10, -0.05, 0.0)  # Displacement of the hand after it has lost the handle [m].

# Speeds of the hand towards the handle [m/s], and of the door [rad/s].
_APPROACH_SPEED, _DOOR_SPEED = 0.25, 0.5
# Control steps to close the fingers, to open them, and from the end of a trajectory to the next one.
_CLOSING_STEPS, _OPENING_STEPS, _SETTLE_STEPS = 15, 20, 15

# Angle by which the door is swung about the hinges of the default layout; after that, the path of the handle determines
# their position [rad].
_FIRST_ANGLE = 0.1
# Distance from the goal at which the expert stops [rad].
_TOLERANCE = 0.03
_SLIP = 0.09  # Horizontal distance of the site from the handle beyond which the hand has lost it [m].


class MicrowaveExpert(Expert):
    """Swings the door of the microwave open by its handle, from any angle, and holds it.

    It infers the position of the hinges from the path of the handle. If the hand loses the handle, it grasps it again;
    if the door is not open at the end, it plans another swing.
    """

    control_modes = CONTROL_MODES
    observation_size = SIZE

    def __init__(
        self, *, style: MotionStyle | None = None, control_mode: str = "joint_offset", **control_options: Any
    ) -> None:
        """Builds the expert; arguments as of every `Expert`."""
        mode = make_mode(control_mode, CONTROL_MODES, control_options)
        super().__init__(style, make_encoder(mode, panda_model(MicrowaveTableArena)))

    def robot_positions(self, observation: Array) -> Array:
        return observation[SLICES["joint_positions"]]

    def _next_trajectory(self, observation: Array, joints: Array) -> JointTrajectory | None:
        hand, (door,) = self._kinematics.forward(joints), observation[SLICES["door_position"]].tolist()
        offset = observation[SLICES["handle_offset"]]
        handle = hand.translation() + offset
        if self._trajectory is None:
            self._start = door, handle
            self._orientation = _GRASP if self.encoder.turns_hand else HandOrientation.from_rotation(hand.rotation())
            return JointTrajectory.stationary(joints, OPEN).then(self._plan_grasp(handle), self._limits)
        if self._current_fingers == CLOSED and np.linalg.norm(offset[:2]) > _SLIP:
            return self._plan_retreat(joints).then(self._plan_grasp(handle), self._limits)
        if not self._has_ended(_SETTLE_STEPS) or door < OPEN_ANGLE + _TOLERANCE:
            return None
        return self._plan_swing(joints, door, handle)

    def _plan_grasp(self, handle: Array) -> JointTrajectory:
        """Plans the way of the hand to the handle at a position `(3,)` [m], and the closing of its fingers."""
        place = skills.vector(self._place(handle, -_BESIDE))
        moves = grasp(place, self._orientation, _DISTANCES, settle_steps=_CLOSING_STEPS, speed=_APPROACH_SPEED)
        seed = tuple(DEFAULT_POSE[:7].tolist())
        self._skill = Skill(moves=moves, ik_seed=seed, retreat=_RETREAT, release_steps=_OPENING_STEPS)
        return self._plan(self._skill)

    def _plan_swing(self, joints: Array, door: float, handle: Array) -> JointTrajectory:
        """Plans the way of the hand with the handle, which is at `(3,)` [m] while the door is at an angle [rad]."""
        is_known = abs(door - self._start[0]) >= _FIRST_ANGLE / 2
        hinges = self._observed_hinges(door, handle) if is_known else handle - _turn(door) @ _closed_handle()
        place = self._place(handle, -_PRESSED)
        # The hand keeps its place at the handle without turning, so it moves about an axis of its own.
        axis = Revolute(elements=(0,), anchor=skills.vector(place + hinges - handle), axis=UP)
        orientation = HandOrientation.from_rotation(self._kinematics.forward(joints).rotation())
        arc = ArcMove(angle=OPEN_ANGLE - door if is_known else -_FIRST_ANGLE, speed=_DOOR_SPEED)
        moves = Move(position=skills.vector(place), orientation=orientation), arc
        swing = Skill(moves=moves, ik_seed=tuple(joints.tolist()), object_joint=axis)
        planned = self._plan(swing, object_position=np.zeros(1))
        return JointTrajectory.stationary(joints, CLOSED).then(planned, self._limits)

    def _place(self, handle: Array, left: float) -> Array:
        """Position `(3,)` of the hand's site at the handle; where the hand cannot turn, `left` [m] beside it."""
        if self.encoder.turns_hand:
            return handle
        approach = np.array(self._orientation.approach)
        return handle + left * np.cross(UP, approach) + _AHEAD * approach + _ABOVE * np.array(UP)

    def _observed_hinges(self, door: float, handle: Array) -> Array:
        """Position `(3,)` of the hinges [m], about which the handle has come here from its place at the start."""
        angle, start = self._start
        turn = _turn(door - angle)[:2, :2]
        return np.append(np.linalg.solve(np.eye(2) - turn, handle[:2] - turn @ start[:2]), handle[2])


def _turn(angle: float) -> Array:
    """Matrix `(3, 3)` of a rotation about the vertical [rad]."""
    return mink.SO3.from_z_radians(angle).as_matrix()


@functools.cache
def _closed_handle() -> Array:
    """Offset `(3,)` of the handle from the hinges with the door closed, in the default layout [m]."""
    scene = build_microwave_table_scene(visuals=False)
    physics = mjcf.Physics.from_mjcf_model(scene.arena.mjcf_model)
    return physics.bind(GOAL.handle_in(scene)).xpos - physics.bind(GOAL.joints_in(scene)[0]).xanchor
