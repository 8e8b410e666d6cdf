"""The arm as a chain of hinges that carries the end effector: its pose, and servo targets that move it."""

import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities.robots.franka import Franka
from kitchen_suite.tasks.control_modes import inverse_kinematics, poses
from kitchen_suite.tasks.control_modes.servos import ARM_SIZE, ArmServos
from kitchen_suite.tasks.simulation import Simulation, columns

# Time constant with which the end effector approaches its target: at least this long [s], and this many control steps.
# Longer, and it lags behind; shorter, and the servos' torques reach their limits.
_LEAST_RESPONSE, _RESPONSE_STEPS = 0.05, 1.25

# Rate at which the null space of the end effector's pose returns to the posture of the reset [1/s].
_POSTURE_RATE = 0.25


class Arm:
    """Kinematics of the arm in a compiled scene, for one simulation or many.

    Attributes:
      servos: of its joints.
    """

    def __init__(self, physics: mjcf.Physics, robot: Franka, timestep: float) -> None:
        """Looks up joints, end effector and base.

        Args:
          physics: the compiled scene.
          robot: the robot; attached to a frame of its own.
          timestep: length of a control step [s].
        """
        self.servos = ArmServos(physics, robot)
        site, base = robot.end_effector, mjcf.get_attachment_frame(robot.mjcf_model)
        self._joints = columns(physics.bind(robot.joints[:ARM_SIZE]).element_id)
        self._site, self._body, self._base = (
            np.atleast_1d(physics.bind(element).element_id) for element in (site, site.parent, base)
        )
        self._site_quat = np.array(physics.bind(site).quat)
        self._response = max(_LEAST_RESPONSE, _RESPONSE_STEPS * timestep)

    def pose(self, simulation: Simulation) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Returns the end effector's position `(..., 3)` [m] and orientation `(..., 4)` in the world."""
        body = simulation.read("xquat", self._body)[..., 0, :]
        return simulation.read("site_xpos", self._site)[..., 0, :], poses.product(body, self._site_quat)

    def base_pose(self, simulation: Simulation) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Returns the base's position `(..., 3)` [m] and orientation `(..., 4)` in the world."""
        return simulation.read("xpos", self._base)[..., 0, :], simulation.read("xquat", self._base)[..., 0, :]

    def target(
        self, simulation: Simulation, error: NDArray[np.float64], posture: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Returns targets `(..., 7)` of the arm's servos that move the end effector towards its target [rad].

        Args:
          simulation: the physics.
          error: `(..., 6)`, the target's offset from the end effector in the world: position [m], rotation vector.
          posture: `(..., 7)`, joint positions to which the null space returns [rad].
        """
        servos, present = self.servos, self.servos.positions(simulation)
        # A joint that stands beyond its limit may stay there.
        low, high = np.minimum(servos.low - present, 0.0), np.maximum(servos.high - present, 0.0)
        step = inverse_kinematics.joint_step(
            inverse_kinematics.jacobian(
                simulation.read("site_xpos", self._site)[..., 0, :],
                simulation.read("xanchor", self._joints),
                simulation.read("xaxis", self._joints),
            ),
            error,
            posture=self._response * _POSTURE_RATE * (posture - present),
            low=low,
            high=high,
        )
        # All joints then move with the same time constant, and the end effector on a straight line.
        return servos.target(simulation, present + servos.lag / self._response * step)
