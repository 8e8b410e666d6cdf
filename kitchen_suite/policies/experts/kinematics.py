"""Kinematics of the experts' arm, on a model built from the same entities as the scene."""

from collections.abc import Callable

import mink
import mujoco
import numpy as np
from dm_control import mjcf

from kitchen_suite.entities.robot import Robot, RobotSpec
from kitchen_suite.entities.scenes import SiteArena
from kitchen_suite.types import Array

ARM = slice(0, 7)  # The Franka's arm's joints among the robot's; the fingers' joints follow.

# Costs of the hand's orientation error and, as the arm is redundant, of joint motion: one radian costs as much as a
# position error of this size [m].
_ORIENTATION_COST, _POSTURE_COST = 0.3, 3e-3
# Inverse kinematics stops at an iteration whose joint step is this small [rad], or after this many iterations.
_TOLERANCE, _MAX_ITERATIONS = 1e-4, 60
# Damping near singular configurations: of the hand's task, and of the whole problem.
_HAND_DAMPING, _DAMPING = 1e-3, 1e-6


class ArmKinematics:
    """Forward and inverse kinematics of the arm's joints, gravity torques, and the base's pose in the world.

    Shapes are those of an arm of seven joints.

    Attributes:
      arm: the arm's joints among the robot's.
      base: pose of the base.
    """

    def __init__(self, build_arena: Callable[..., SiteArena], spec: RobotSpec) -> None:
        """Builds the kinematics of a robot at its site in an arena of a class."""
        arena = build_arena(visuals=False)
        robot = Robot(spec, visuals=False)
        arena.attach_robot(robot)
        self._model = mjcf.Physics.from_mjcf_model(arena.mjcf_model).model.ptr
        self.arm, self._site = slice(0, robot.arm_size), robot.end_effector.full_identifier
        self._configuration = mink.Configuration(self._model)
        base = mjcf.get_attachment_frame(robot.mjcf_model).full_identifier
        self.base = self._configuration.get_transform_frame_to_world(base, "body")
        self._hand_task = mink.FrameTask(self._site, "site", 1.0, _ORIENTATION_COST, lm_damping=_HAND_DAMPING)
        self._posture_task = mink.PostureTask(self._model, cost=_POSTURE_COST)
        self._joint_limits = [mink.ConfigurationLimit(self._model)]
        self._low, self._high = self._model.jnt_range[self.arm].T
        self._bias = np.zeros(self._model.nv)

    def forward(self, joints: Array) -> mink.SE3:
        """Pose of the hand's site in the world at joint positions `(7,)` [rad]."""
        self._configuration.update(self._with_closed_fingers(joints))
        return self._configuration.get_transform_frame_to_world(self._site, "site")

    def gravity(self, joints: Array) -> Array:
        """Torques `(7,)` that hold the arm still at joint positions `(7,)` [N m]."""
        self._configuration.update(self._with_closed_fingers(joints))
        mujoco.mj_rne(self._model, self._configuration.data, 0, self._bias)
        return self._bias[self.arm].copy()

    def inverse(self, pose: mink.SE3, *, start: Array) -> Array:
        """Joint positions `(7,)` that bring the site to a pose in the world, near `start` [rad]."""
        positions = self._with_closed_fingers(np.clip(start, self._low, self._high))
        self._configuration.update(positions)
        self._hand_task.set_target(pose)
        self._posture_task.set_target(positions)
        tasks = [self._hand_task, self._posture_task]
        for _ in range(_MAX_ITERATIONS):
            # With a time step of 1 s, velocities are joint steps.
            step = mink.solve_ik(self._configuration, tasks, 1.0, "daqp", damping=_DAMPING, limits=self._joint_limits)
            self._configuration.integrate_inplace(step, 1.0)
            if np.abs(step).max() < _TOLERANCE:
                break
        return self._configuration.q[self.arm].copy()

    def _with_closed_fingers(self, joints: Array) -> Array:
        """Positions of all joints, those of the fingers closed."""
        return np.concatenate([joints, np.zeros(self._model.nq - joints.size)])
