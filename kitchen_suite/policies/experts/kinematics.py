"""What an expert knows of its robot: a kinematic model of its own, built from the same entities as the scene."""

import functools

import mink
import mujoco
import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities import PANDA, Franka, KitchenArena, OpenCabinetArena

# The arm's joints among those of the robot; the fingers' come after them.
ARM = slice(0, 7)

# A hand turned by a radian is as bad as one that is so far off [m].
_ORIENTATION_COST = 0.3
# The elbow is free to swing while the hand stays: a radian of that is as bad as a hand so far off [m].
_MOTION_COST = 3e-3
# Inverse kinematics stops at steps as small as this [rad], or after so many.
_CONVERGED = 1e-4
_MOST_STEPS = 60
# Keep it from leaping near singular positions: of the hand's error, and of the whole problem.
_HAND_DAMPING, _DAMPING = 1e-3, 1e-6


@functools.cache
def _model(domain: str) -> tuple[mujoco.MjModel, str]:
    """The robot alone in its room, and the name of its hand's site; shared by all arms."""
    if domain == "kitchen":
        kitchen, robot = KitchenArena(visuals=False), Franka(visuals=False)
        kitchen.place(robot)
        room = kitchen.mjcf_model
    else:
        cabinet_room, robot = OpenCabinetArena(visuals=False), Franka(PANDA, visuals=False)
        cabinet_room.attach(robot, cabinet_room.robot_site)
        room = cabinet_room.mjcf_model
    return mjcf.Physics.from_mjcf_model(room).model.ptr, robot.end_effector.full_identifier


class ArmKinematics:
    """Forward and inverse kinematics of the arm's seven joints, and the torques that hold it up."""

    def __init__(self, domain: str) -> None:
        """Takes the robot of the domain `kitchen` or `open_cabinet`."""
        self._model, self._site = _model(domain)
        self._configuration = mink.Configuration(self._model)
        self._hand = mink.FrameTask(self._site, "site", 1.0, _ORIENTATION_COST, lm_damping=_HAND_DAMPING)
        self._stay = mink.PostureTask(self._model, cost=_MOTION_COST)
        self._limits = [mink.ConfigurationLimit(self._model)]
        self._low, self._high = self._model.jnt_range[ARM].T
        self._bias = np.zeros(self._model.nv)

    def forward(self, joints: NDArray[np.float64]) -> mink.SE3:
        """Where the hand's site is in the world, for joint positions `(7,)` [rad]."""
        self._configuration.update(self._positions(joints))
        return self._configuration.get_transform_frame_to_world(self._site, "site")

    def gravity(self, joints: NDArray[np.float64]) -> NDArray[np.float64]:
        """Torques `(7,)` that hold the arm still at joint positions `(7,)` [N m]."""
        self._configuration.update(self._positions(joints))
        mujoco.mj_rne(self._model, self._configuration.data, 0, self._bias)
        return self._bias[ARM].copy()

    def inverse(self, pose: mink.SE3, *, start: NDArray[np.float64]) -> NDArray[np.float64]:
        """Joint positions `(7,)` that bring the site to a pose, not far from `start` [rad]."""
        positions = self._positions(np.clip(start, self._low, self._high))
        self._configuration.update(positions)
        self._hand.set_target(pose)
        self._stay.set_target(positions)
        tasks = [self._hand, self._stay]
        for _ in range(_MOST_STEPS):
            # Over a second, velocities are steps.
            step = mink.solve_ik(self._configuration, tasks, 1.0, "daqp", damping=_DAMPING, limits=self._limits)
            self._configuration.integrate_inplace(step, 1.0)
            if np.abs(step).max() < _CONVERGED:
                break
        return self._configuration.q[ARM].copy()

    def _positions(self, joints: NDArray[np.float64]) -> NDArray[np.float64]:
        """Positions of all joints, the fingers closed."""
        return np.concatenate([joints, np.zeros(self._model.nq - joints.size)])
