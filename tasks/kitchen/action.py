"""The kitchen's action mode: nine joint velocities, as position targets."""

import dataclasses
from typing import ClassVar

import numpy as np
from dm_control import mjcf
from dm_env import specs
from numpy.typing import NDArray

from kitchen_suite.entities.robots.franka import Franka
from kitchen_suite.tasks.kitchen import noise
from kitchen_suite.tasks.kitchen.state import KitchenState
from kitchen_suite.tasks.simulation import Simulation

PHYSICS_TIMESTEP = 0.002  # [s]
CONTROL_TIMESTEP = 0.08  # [s]
FEEDBACKS = ("observed", "true", "target")

# Bounds of commanded velocities [rad/s, m/s] and positions [rad, m]; as in the reference, where they differ a little
# from the joint limits.
VELOCITY_LIMIT = 10.0
POSITION_LOW = np.array([-2.9, -1.8, -2.9, -3.1, -2.9, 0.0, -2.9, 0.0, 0.0])
POSITION_HIGH = np.array([2.9, 1.8, 2.9, 0.0, 2.9, 3.8, 2.9, 0.04, 0.04])


@dataclasses.dataclass(frozen=True, kw_only=True)
class JointVelocity:
    """Nine joint velocities, integrated over the control step from present positions.

    Attributes:
      velocity_scale: velocity that a unit of action stands for [rad/s, m/s].
      feedback: one of `FEEDBACKS`: the positions from which velocities are integrated.
    """

    velocity_scale: float
    feedback: str
    draws: ClassVar[bool] = False

    def bind(self, physics: mjcf.Physics, robot: Franka) -> None:
        """Does nothing: the state has the positions."""

    def spec(self, robot: Franka) -> specs.BoundedArray:
        """Nine joint velocities, as a share of `velocity_scale`; values outside [-1, 1] are clipped."""
        names = [actuator.full_identifier for actuator in robot.actuators]
        ones = np.ones(len(names))
        return specs.BoundedArray(ones.shape, ones.dtype, minimum=-ones, maximum=ones, name="\t".join(names))

    def control(
        self,
        simulation: Simulation,
        state: KitchenState,
        action: NDArray[np.float64],
        draw: NDArray[np.float64] | float,
    ) -> NDArray[np.float64]:
        """Returns targets `(..., 9)` of the robot's actuators [rad, m] for an action `(..., 9)`; draws nothing."""
        del simulation, draw
        return position_target(
            self._feedback_positions(state), action, velocity_scale=self.velocity_scale, timestep=CONTROL_TIMESTEP
        )

    def _feedback_positions(self, state: KitchenState) -> NDArray[np.float64]:
        """Positions `(..., 9)` from which the velocities of the next action are integrated [rad, m]."""
        if self.feedback == "target":
            return state.target
        if self.feedback == "true":
            return state.positions
        return state.positions + state.noise[..., noise.SLICES[0]]


def position_target(
    positions: NDArray[np.float64],
    action: NDArray[np.float64],
    *,
    velocity_scale: float,
    timestep: float,
) -> NDArray[np.float64]:
    """Returns the joint positions to be reached at the end of a control step.

    Args:
      positions: `(..., 9)`, joint positions from which the velocities are integrated [rad, m].
      action: `(..., 9)`, clipped to [-1, 1].
      velocity_scale: velocity that a unit of action stands for [rad/s, m/s].
      timestep: length of the control step [s].

    Returns:
      `(..., 9)` targets of the position actuators [rad, m].
    """
    velocity = np.minimum(np.maximum(action, -1.0), 1.0) * velocity_scale
    if velocity_scale > VELOCITY_LIMIT:
        velocity = np.minimum(np.maximum(velocity, -VELOCITY_LIMIT), VELOCITY_LIMIT)
    return np.minimum(np.maximum(positions + velocity * timestep, POSITION_LOW), POSITION_HIGH)
