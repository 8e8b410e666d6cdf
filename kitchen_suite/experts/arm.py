"""What an expert knows of its robot: a kinematic model of its own, built from the same entities as the scene."""

import functools

import mink
import mujoco
import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities import CabinetArena, Franka, KitchenArena
from kitchen_suite.entities.calibration_panda import PANDA
from kitchen_suite.tasks.drawer_control import GRIPPER_OPEN

ARM = slice(0, 7)
JOINTS = 7

# The elbow is free to swing while the hand stays: how much staying weighs against the hand's errors.
_POSTURE_COST = 3e-3
# A radian of misplaced orientation weighs as much as so many metres of misplaced position.
_ORIENTATION_COST = 0.3
# Where an inverse kinematics stops: the step is this small [rad], or this many were made.
_CONVERGED = 1e-4
_MOST_STEPS = 60
_DAMPING = 1e-6


@functools.cache
def _model(domain: str) -> tuple[mujoco.MjModel, str]:
    """The robot alone in its room, and the name of the site between its fingers."""
    if domain == "kitchen":
        room, robot = KitchenArena(visuals=False), Franka(visuals=False)
        room.place(robot)
    else:
        room, robot = CabinetArena(visuals=False), Franka(PANDA, visuals=False)
        room.attach(robot, room.robot_place)
    physics = mjcf.Physics.from_mjcf_model(room.mjcf_model)
    return physics.model.ptr, robot.end_effector.full_identifier


class Arm:
    """Forward and inverse kinematics of the arm's seven joints, and the torques that hold it up."""

    def __init__(self, domain: str) -> None:
        """Takes the robot of `kitchen` or of `open_cabinet`; the models are shared by all arms."""
        self._model, self._site = _model(domain)
        self._configuration = mink.Configuration(self._model)
        self._hand = mink.FrameTask(self._site, "site", 1.0, _ORIENTATION_COST, lm_damping=1e-3)
        self._posture = mink.PostureTask(self._model, cost=_POSTURE_COST)
        self._limits = [mink.ConfigurationLimit(self._model)]
        self._low, self._high = self._model.jnt_range[ARM].T
        self._bias = np.zeros(self._model.nv)

    def pose(self, joints: NDArray[np.float64]) -> mink.SE3:
        """Where the site between the fingers is, in the world, for joint positions `(7,)` [rad]."""
        self._update(joints)
        return self._configuration.get_transform_frame_to_world(self._site, "site")

    def gravity(self, joints: NDArray[np.float64]) -> NDArray[np.float64]:
        """Torques `(7,)` that hold the arm still at joint positions `(7,)` [N m]."""
        self._update(joints)
        mujoco.mj_rne(self._model, self._configuration.data, 0, self._bias)
        return self._bias[ARM].copy()

    def reach(self, pose: mink.SE3, *, start: NDArray[np.float64]) -> NDArray[np.float64]:
        """Joint positions `(7,)` that bring the site to a pose, the nearest to `start` [rad]."""
        self._hand.set_target(pose)
        self._posture.set_target(self._full(start))
        self._update(np.clip(start, self._low, self._high))
        for _ in range(_MOST_STEPS):
            step = mink.solve_ik(
                self._configuration, [self._hand, self._posture], 1.0, "daqp", damping=_DAMPING, limits=self._limits
            )
            self._configuration.integrate_inplace(step, 1.0)
            if np.abs(step).max() < _CONVERGED:
                break
        return self._configuration.q[ARM].copy()

    def _update(self, joints: NDArray[np.float64]) -> None:
        self._configuration.update(self._full(joints))

    def _full(self, joints: NDArray[np.float64]) -> NDArray[np.float64]:
        full = np.full(self._model.nq, GRIPPER_OPEN)
        full[ARM] = joints
        return full
