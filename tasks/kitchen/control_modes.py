"""The kitchen's own control modes: nine joint velocities, or positions, as targets of the servos."""

import functools
from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np
from dm_control import mjcf
from dm_env import specs
from numpy.typing import NDArray

from kitchen_suite import checks
from kitchen_suite.entities.robot import Robot
from kitchen_suite.tasks.control_modes.action_mode import ActionMode, unit_spec
from kitchen_suite.tasks.control_modes.registry import SHARED_MODES
from kitchen_suite.tasks.kitchen.mdp import KitchenState
from kitchen_suite.tasks.kitchen.observation import FRANKA_SLICES
from kitchen_suite.tasks.simulation import Simulation
from kitchen_suite.types import Array

PHYSICS_TIMESTEP = 0.002  # [s]
CONTROL_TIMESTEP = 0.08  # [s]

# Positions from which the next action starts: those last observed, with their noise; the true ones; the last targets.
FEEDBACKS = ("observed", "true", "target")

# Bounds of commanded velocities [rad/s, m/s] and positions [rad, m]; as in the reference, where they differ a little
# from the joint limits.
VELOCITY_LIMIT = 10.0
POSITION_LOW = np.array([-2.9, -1.8, -2.9, -3.1, -2.9, 0.0, -2.9, 0.0, 0.0])
POSITION_HIGH = np.array([2.9, 1.8, 2.9, 0.0, 2.9, 3.8, 2.9, 0.04, 0.04])


class _KitchenMode(ActionMode):
    """A control mode that depends on the length of the control step."""

    # Before a scene is compiled.
    _timestep = CONTROL_TIMESTEP

    def bind(self, physics: mjcf.Physics, robot: Robot, timestep: float) -> None:
        self._timestep = timestep


class JointVelocity(_KitchenMode):
    """`joint_velocity`: nine joint velocities, integrated over the control step from present positions."""

    name = "joint_velocity"
    formula = (
        "ctrl = clip(q + clip(clip(action, -1, 1) * velocity_scale, -10, 10) * control_timestep, low, high), with the "
        "nine joint positions q last observed, noise included (feedback 'observed'), the true ones ('true') or the "
        f"last ctrl ('target'), low = {POSITION_LOW.tolist()} and high = {POSITION_HIGH.tolist()}"
    )

    def __init__(self, *, velocity_scale: float = 2.0, feedback: str = "observed") -> None:
        """Sets the velocity and the feedback.

        Args:
          velocity_scale: velocity that a unit of action stands for [rad/s, m/s].
          feedback: positions from which the action starts: `observed` last, the `true` ones, or the last `target`.
        """
        self.velocity_scale = checks.number(velocity_scale, "velocity_scale")
        self.feedback = checks.choice(feedback, FEEDBACKS, "feedback")

    def spec(self, robot: Robot) -> specs.BoundedArray:
        """Nine joint velocities, as a share of `velocity_scale`; values outside [-1, 1] are clipped."""
        return unit_spec([actuator.full_identifier for actuator in robot.actuators])

    def control(
        self, simulation: Simulation, state: KitchenState, command: tuple[()], action: Array, draw: Array | float
    ) -> tuple[Array, tuple[()]]:
        positions = feedback_positions(state, self.feedback)
        target = position_target(positions, action, velocity_scale=self.velocity_scale, timestep=self._timestep)
        return target, command


class KitchenJointPosition(_KitchenMode):
    """`joint_position`: nine joint positions; as Diffusion Policy's kitchen, but in an order that rounds nothing."""

    name = "joint_position"
    formula = (
        "ctrl = clip(clip(action, q - 10 * control_timestep, q + 10 * control_timestep), low, high), with the nine "
        "joint positions q last observed, noise included (feedback 'observed'), the true ones ('true') or the last "
        f"ctrl ('target'), low = {POSITION_LOW.tolist()} and high = {POSITION_HIGH.tolist()}"
    )

    def __init__(self, *, feedback: str = "observed") -> None:
        """Sets the feedback.

        Args:
          feedback: positions from which the action starts: `observed` last, the `true` ones, or the last `target`.
            Targets are at most 10 rad/s, or m/s, away from these.
        """
        self.feedback = checks.choice(feedback, FEEDBACKS, "feedback")

    def spec(self, robot: Robot) -> specs.BoundedArray:
        """Nine joint positions [rad, m]; values outside the bounds are clipped."""
        names = "\t".join(actuator.full_identifier for actuator in robot.actuators)
        return specs.BoundedArray(
            POSITION_LOW.shape, np.float64, minimum=POSITION_LOW, maximum=POSITION_HIGH, name=names
        )

    def conversion(self, mode: str) -> Callable[[NDArray, NDArray], Array] | None:
        return functools.partial(_observed_target, self._timestep) if mode == JointVelocity.name else None

    def control(
        self, simulation: Simulation, state: KitchenState, command: tuple[()], action: Array, draw: Array | float
    ) -> tuple[Array, tuple[()]]:
        positions, step = feedback_positions(state, self.feedback), VELOCITY_LIMIT * self._timestep
        near = np.minimum(np.maximum(action, positions - step), positions + step)
        return np.minimum(np.maximum(near, POSITION_LOW), POSITION_HIGH), command


# Control modes of the kitchen by name; the first is the default.
CONTROL_MODES: Mapping[str, Callable[..., ActionMode]] = MappingProxyType(
    {"joint_velocity": JointVelocity, "joint_position": KitchenJointPosition, **SHARED_MODES}
)


def feedback_positions(state: KitchenState, feedback: str) -> Array:
    """Returns the joint positions `(..., 9)` from which the next action starts, by one of `FEEDBACKS` [rad, m]."""
    if feedback == "target":
        return state.target
    if feedback == "true":
        return state.positions
    return state.positions + state.noise[..., FRANKA_SLICES.robot_positions]


def _observed_target(timestep: float, state: NDArray, action: NDArray) -> Array:
    """Returns the targets `(9,)` of `joint_velocity`, with its defaults, given the observed state [rad, m]."""
    scale, action = JointVelocity().velocity_scale, np.asarray(action, np.float64)
    return position_target(state[FRANKA_SLICES.robot_positions], action, velocity_scale=scale, timestep=timestep)


def position_target(positions: Array, action: Array, *, velocity_scale: float, timestep: float) -> Array:
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
