"""Reach in a layout: the end effector can be brought to every handle within the limits of the arm's joints."""

from collections.abc import Sequence

import mujoco
import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities.robots.franka import Franka
from kitchen_suite.tasks.control_modes.servos import ARM_SIZE
from kitchen_suite.tasks.simulation import columns

# Distance from a handle at which it counts as reached [m].
TOLERANCE = 0.005

# Damping of the least squares: bounds joint steps near singular configurations.
_DAMPING = 0.05
# Greatest numbers of steps in the default layout, from the robot's start, and from there in another one.
_FIRST_STEPS, _STEPS = 200, 15


class Reach:
    """Inverse kinematics of the end effector's position, by damped least squares with joint limits."""

    def __init__(
        self, physics: mjcf.Physics, robot: Franka, handles: Sequence[mjcf.Element], data: mujoco.MjData
    ) -> None:
        """Finds joint positions for each handle in the default layout.

        Args:
          physics: the compiled scene.
          robot: robot that acts.
          handles: sites to be reached.
          data: kinematics of the default layout, the robot at its start; its arm is moved.

        Raises:
          ValueError: a handle cannot be reached.
        """
        self._model = physics.model.ptr
        joints = physics.bind(robot.joints[:ARM_SIZE])
        self._qpos, self._dofs = columns(joints.qposadr), columns(joints.dofadr)
        self._low, self._high = np.transpose(joints.range)
        self._hand, self._handles = (physics.bind(each).element_id for each in (robot.end_effector, handles))
        start = np.clip(data.qpos[self._qpos], self._low, self._high)
        self._jacobian = np.zeros((3, self._model.nv))
        self._solutions = []
        for handle, element in zip(self._handles, handles, strict=True):
            if (solution := self._solve(data, handle, start, _FIRST_STEPS)) is None:
                raise ValueError(f"the robot cannot reach {element.full_identifier} in the default layout")
            self._solutions.append(solution)

    def reaches_all(self, data: mujoco.MjData) -> bool:
        """Whether all handles can be reached in the layout of some kinematics; moves the arm of `data`."""
        pairs = zip(self._handles, self._solutions, strict=True)
        return all(self._solve(data, handle, solution, _STEPS) is not None for handle, solution in pairs)

    def _solve(
        self, data: mujoco.MjData, handle: int, start: NDArray[np.float64], steps: int
    ) -> NDArray[np.float64] | None:
        """Returns joint positions `(7,)` with the end effector at a handle [rad]; None if none are found."""
        target, joints = data.site_xpos[handle].copy(), start
        for _ in range(steps):
            data.qpos[self._qpos] = joints
            mujoco.mj_kinematics(self._model, data)
            error = target - data.site_xpos[self._hand]
            if np.linalg.norm(error) <= TOLERANCE:
                return joints
            joints = self._step(data, joints, error)
        return None

    def _step(
        self, data: mujoco.MjData, joints: NDArray[np.float64], error: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Returns joint positions nearer to the handle; joints that would leave their range stay at its end."""
        mujoco.mj_comPos(self._model, data)
        mujoco.mj_jacSite(self._model, data, self._jacobian, None, self._hand)
        jacobian, free, moved = self._jacobian[:, self._dofs], np.ones(joints.size, bool), joints
        for _ in range(joints.size):
            moving = jacobian * free
            rest = error - jacobian @ (moved - joints)
            step = moving.T @ np.linalg.solve(moving @ moving.T + _DAMPING**2 * np.eye(3), rest)
            wanted = moved + step
            moved = np.clip(wanted, self._low, self._high)
            if (beyond := wanted != moved).any():
                free &= ~beyond
            else:
                break
        return moved
