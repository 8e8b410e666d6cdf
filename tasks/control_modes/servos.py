"""The position servos of the Franka's arm and fingers, as control modes see them."""

import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities.robots.franka import Franka
from kitchen_suite.tasks.simulation import Simulation, columns

ARM_SIZE = 7


class ArmServos:
    """Joint positions of the arm, and the targets of its servos.

    Attributes:
      low, high: `(7,)`, joint limits [rad].
      lag: `(7,)`, time constants with which the joints follow their targets [s].
    """

    def __init__(self, physics: mjcf.Physics, robot: Franka) -> None:
        """Looks up the joints of a robot in a compiled scene."""
        actuators, joints = robot.joint_actuators[:ARM_SIZE], physics.bind(robot.joints[:ARM_SIZE])
        self.low, self.high = np.transpose([actuator.range for actuator in actuators])
        self._gain = np.array([actuator.gain for actuator in actuators])
        self.lag = np.array([actuator.damping + actuator.velocity_gain for actuator in actuators]) / self._gain
        self._ctrl_low, self._ctrl_high = np.transpose(physics.bind(robot.actuators[:ARM_SIZE]).ctrlrange)
        self._qpos, self._qvel = columns(joints.qposadr), columns(joints.dofadr)

    def positions(self, simulation: Simulation) -> NDArray[np.float64]:
        """Returns the present joint positions `(..., 7)` [rad]."""
        return simulation.read("qpos", self._qpos)

    def target(self, simulation: Simulation, positions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns servo targets `(..., 7)` that hold the arm at joint positions `(..., 7)` near the present ones [rad].

        The torques of gravity and motion are compensated: a servo holds a torque by an offset of the torque divided by
        its gain.
        """
        offset = simulation.read("qfrc_bias", self._qvel) / self._gain
        return np.minimum(np.maximum(positions + offset, self._ctrl_low), self._ctrl_high)


class Gripper:
    """Both fingers, opened and closed by one number: +1 closed, -1 open, linear between."""

    def __init__(self, robot: Franka) -> None:
        """Looks up the range of the fingers."""
        self.closed, self.open = robot.joint_actuators[-1].range

    def target(self, action: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the targets `(..., 2)` of both fingers [m] for an action `(..., 1)` in [-1, 1]."""
        middle, half = (self.closed + self.open) / 2.0, (self.closed - self.open) / 2.0
        return np.repeat(middle + half * action, 2, axis=-1)
