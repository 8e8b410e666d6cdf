"""The cabinet's expert, which approaches a drawer's handle, grasps it and pulls."""

import dataclasses
import functools
import math
from collections.abc import Callable
from typing import Any

import mink
import numpy as np

from kitchen_suite import checks
from kitchen_suite.entities import PANDA, OpenCabinetArena, Robot, SiteArena
from kitchen_suite.entities.cabinet import DRAWERS
from kitchen_suite.policies.experts.base import Expert, MotionStyle
from kitchen_suite.policies.experts.encoders import ArmModel, make_encoder
from kitchen_suite.policies.experts.kinematics import ARM, ArmKinematics
from kitchen_suite.policies.experts.skills import CLOSED, OPEN, HandOrientation, Move, Skill
from kitchen_suite.policies.experts.trajectories import JointTrajectory, plan
from kitchen_suite.tasks.control_modes.joints import DEFAULT_POSE, JOINT_HIGH, JOINT_LOW
from kitchen_suite.tasks.control_modes.registry import OFFSET_MODES, make_mode
from kitchen_suite.tasks.open_cabinet.mdp import CONTROL_TIMESTEP
from kitchen_suite.tasks.open_cabinet.observation import SIZE, SLICES
from kitchen_suite.tasks.open_cabinet.rewards import SUCCESS_OPENING
from kitchen_suite.tasks.open_cabinet.task import OpenCabinetTask
from kitchen_suite.types import Array, Vector

# Speeds of the hand towards the handle and while pulling [m/s]; at higher speeds the lower handle slips out.
_APPROACH_SPEED, _PULL_SPEED = 0.18, 0.2
# Control steps to close the fingers on the handle, and to open them.
_CLOSING_STEPS, _OPENING_STEPS = 40, 30
# Distance from the handle at which the straight approach begins, and distance to pull [m].
_STANDOFF, _PULL = 0.08, 0.36
# Downward tilt of the hand [degrees]: only with it the arm can pull the lower handle all the way without bending its
# elbow (joint 4) to the limit.
_TILTS = {"top": 0.0, "bottom": 40.0}

# Observed opening at which the expert stops [m]; noise may make the opening look larger than it is.
_ENOUGH = SUCCESS_OPENING + 0.02
_SETTLE_STEPS = 40  # Control steps from the end of a trajectory to a new attempt: the drawer lags behind the hand.

# Distance between hand and handle beyond which the grasp has failed [m]: half a pad is 0.01; noise may add as much.
_SLIP = 0.04


def _pull_skill(drawer: str) -> Skill:
    """Skill that opens a drawer, in its handle's frame: z points into the cabinet, y up."""
    tilt = math.radians(_TILTS[drawer])
    approach: Vector = (0.0, -math.sin(tilt), math.cos(tilt))
    hand = HandOrientation(approach=approach, spread=(0.0, 1.0, 0.0))
    return Skill(
        moves=(
            Move(position=(0.0, 0.0, -_STANDOFF), fingers=OPEN, in_free_space=True, orientation=hand),
            Move(position=(0.0, 0.0, 0.0), fingers=OPEN, speed=_APPROACH_SPEED, orientation=hand),
            Move(position=(0.0, 0.0, 0.0), fingers=CLOSED, settle_steps=_CLOSING_STEPS, orientation=hand),
            Move(position=(0.0, 0.0, -_PULL), fingers=CLOSED, speed=_PULL_SPEED, orientation=hand),
        ),
        ik_seed=tuple(DEFAULT_POSE[ARM].tolist()),
        retreat=(_STANDOFF, 0.0, 0.0),
        release_steps=_OPENING_STEPS,
    )


class DrawerExpert(Expert):
    """Opens a drawer of the cabinet and holds it open.

    On the way to a standoff before the handle it averages the observed poses of the handle. Then it moves in, grasps
    and pulls. If the handle slips out, or the drawer is not open at the end, it starts again.
    """

    control_modes = OFFSET_MODES
    observation_size = SIZE

    def __init__(
        self,
        drawer: str = "top",
        *,
        style: MotionStyle | None = None,
        control_mode: str = "joint_offset",
        **control_options: Any,
    ) -> None:
        """Builds an expert for a drawer, `top` or `bottom`; other arguments as of every `Expert`."""
        self._skill = _pull_skill(checks.choice(drawer, DRAWERS, "drawer"))
        mode = make_mode(control_mode, OFFSET_MODES, control_options)
        super().__init__(style, make_encoder(mode, panda_model(OpenCabinetArena)))

    @classmethod
    def _task_settings(cls, task: OpenCabinetTask) -> dict[str, Any]:
        return {"drawer": task.drawer}

    def reset(self, generator: np.random.Generator) -> None:
        super().reset(generator)
        # Otherwise the hand approaches the standoff, and the handle's pose is observed.
        self._is_pulling = False

    def robot_positions(self, observation: Array) -> Array:
        fraction = (observation[SLICES["joint_positions"]] + 1.0) / 2.0
        return JOINT_LOW + fraction * (JOINT_HIGH - JOINT_LOW)

    def _next_trajectory(self, observation: Array, joints: Array) -> JointTrajectory | None:
        if self._trajectory is None:
            self._initial_rotation = self._kinematics.forward(joints).rotation()
            return JointTrajectory.stationary(joints, OPEN).then(self._plan_approach(observation, joints), self._limits)
        return (self._continue_pull if self._is_pulling else self._continue_approach)(observation, joints)

    def _continue_approach(self, observation: Array, joints: Array) -> JointTrajectory | None:
        """Observes the handle; returns the trajectory that grasps and pulls when the approach has ended."""
        self._handle_poses.append(self._handle_pose(observation, joints).wxyz_xyz)
        if not self._has_ended(0) or _is_open(observation):
            return None
        self._is_pulling = True
        mean = np.mean(self._handle_poses, axis=0)
        handle = mink.SE3.from_rotation_and_translation(mink.SO3(wxyz=mean[:4]).normalize(), mean[4:])
        pull = plan(self._kinematics, self._limits, self._skill_at(handle), frame=handle)
        return JointTrajectory.stationary(joints, OPEN).then(pull, self._limits)

    def _continue_pull(self, observation: Array, joints: Array) -> JointTrajectory | None:
        """Returns a retreat and a new approach if the pull has failed."""
        # Whether the handle is no longer between the closed fingers.
        has_slipped = self._current_fingers == CLOSED and np.linalg.norm(observation[SLICES["handle_offset"]]) > _SLIP
        if not (has_slipped or self._has_ended(_SETTLE_STEPS)) or _is_open(observation):
            return None
        approach = self._plan_approach(observation, joints)
        return self._plan_retreat(joints).then(approach, self._limits)

    def _plan_approach(self, observation: Array, joints: Array) -> JointTrajectory:
        """Begins an approach; returns the trajectory to the standoff before the handle."""
        handle = self._handle_pose(observation, joints)
        self._is_pulling, self._handle_poses = False, [handle.wxyz_xyz]
        skill = self._skill_at(handle)
        return self._plan(dataclasses.replace(skill, moves=skill.moves[:1]), frame=handle)

    def _skill_at(self, handle: mink.SE3) -> Skill:
        """The skill for a handle's pose in the world."""
        if self.encoder.turns_hand:
            return self._skill
        rotation = handle.rotation().inverse() @ self._initial_rotation
        return self._skill.with_orientation(HandOrientation.from_rotation(rotation))

    def _handle_pose(self, observation: Array, joints: Array) -> mink.SE3:
        """Pose of the handle in the world, from its observed offset from the hand."""
        hand = self._kinematics.forward(joints)
        rotation = _handle_rotation(observation[SLICES["handle_orientation_offset"]], hand.rotation())
        position = hand.translation() + observation[SLICES["handle_offset"]]
        return mink.SE3.from_rotation_and_translation(rotation, position)


@functools.cache
def panda_model(build_arena: Callable[..., SiteArena]) -> ArmModel:
    """The Panda in an arena, with control steps of 0.01 s; shared by all instances."""
    return ArmModel(
        kinematics=ArmKinematics(build_arena, PANDA),
        gains=Robot(PANDA, visuals=False).gains,
        joint_response=1.0,
        hand_response=1.0,
        # 1.2 rad/s; the cabinet's task ends an episode at 5.
        joint_speed=(0.012,) * 7,
        timestep=CONTROL_TIMESTEP,
    )


def _is_open(observation: Array) -> bool:
    return bool(observation[SLICES["drawer_position"]][0] >= _ENOUGH)


def _handle_rotation(offset: Array, hand: mink.SO3) -> mink.SO3:
    """Rotation of the handle in the world, with a quaternion w that is not negative, so that rotations have a mean.

    The offset is the observed difference of the handle's and the hand's quaternion, x, y, z, w.
    """
    x, y, z, w = offset
    difference = np.array([w, x, y, z])
    # The hand's quaternion in the difference may be q or -q, which are the same rotation. The sum with the right one is
    # the handle's quaternion, of length 1.
    candidates = [difference + hand.wxyz, difference - hand.wxyz]
    handle = min(candidates, key=lambda quaternion: abs(np.linalg.norm(quaternion) - 1.0))
    return mink.SO3(wxyz=handle * np.sign(handle[0])).normalize()
