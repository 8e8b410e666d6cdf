"""The cabinet's control mode: joint offsets of the Panda and a gripper logit, as position targets."""

from typing import Any

import numpy as np
from dm_control import mjcf
from dm_env import specs
from numpy.typing import NDArray

from kitchen_suite import checks
from kitchen_suite.entities import PANDA
from kitchen_suite.entities.robots.franka import Franka
from kitchen_suite.tasks.mdp import ActionMode
from kitchen_suite.tasks.simulation import Simulation, columns

GRIPPER_MODES = ("sampled", "deterministic")

# Limits of the Panda's seven arm joints and of its left finger [rad, m].
JOINT_LOW, JOINT_HIGH = np.transpose([actuator.range for actuator in PANDA.joint_actuators[:8]]).copy()

ACTION_SIZE = JOINT_LOW.size

_ARM_LOW, _ARM_HIGH = JOINT_LOW[:7], JOINT_HIGH[:7]

# Targets of both fingers [m].
GRIPPER_CLOSED, GRIPPER_OPEN = float(JOINT_LOW[7]), float(JOINT_HIGH[7])


class JointOffset(ActionMode):
    """`joint_offset`: offsets of the seven joints from their present positions, and log odds of closing the gripper.

    Attributes:
      gripper: one of `GRIPPER_MODES`.
      draws: whether closing is sampled with the probability of the gripper logit, or decided by its sign.
    """

    name = "joint_offset"
    formula = (
        f"ctrl[:7] = clip(q + action[:7], low, high), with the joint positions q, low = {_ARM_LOW.tolist()} and high = "
        f"{_ARM_HIGH.tolist()}; both fingers: {GRIPPER_CLOSED:g} (closed) if u < 1 / (1 + exp(-action[7])), else "
        f"{GRIPPER_OPEN:g}, with u drawn from U(0, 1) (gripper 'sampled') or 0.5 ('deterministic')"
    )

    def __init__(self, *, gripper: str = "sampled") -> None:
        """Takes one of `GRIPPER_MODES`.

        Raises:
          TypeError: it is no string.
          ValueError: it is unknown.
        """
        self.gripper = checks.choice(gripper, GRIPPER_MODES, "gripper")
        self.draws = self.gripper == "sampled"

    def bind(self, physics: mjcf.Physics, robot: Franka, timestep: float) -> None:
        del timestep
        self._joint_qpos = columns(physics.bind(robot.joints).qposadr)

    def spec(self, robot: Franka) -> specs.Array:
        """Seven joint offsets [rad] and the gripper logit (log odds of closing); unbounded, but finite."""
        # The last element moves both fingers.
        names = "\t".join(actuator.full_identifier for actuator in robot.actuators[:ACTION_SIZE])
        return specs.Array((ACTION_SIZE,), np.float64, name=names)

    def control(
        self,
        simulation: Simulation,
        state: Any,
        command: tuple[()],
        action: NDArray[np.float64],
        draw: NDArray[np.float64] | float,
    ) -> tuple[NDArray[np.float64], tuple[()]]:
        del state
        positions = simulation.read("qpos", self._joint_qpos)
        target = np.empty(positions.shape)
        target[..., :7] = arm_target(positions[..., :7], action[..., :7])
        target[..., 7:] = gripper_target(action[..., 7:], np.asarray(draw)[..., np.newaxis])
        return target, command


def arm_target(positions: NDArray[np.float64], action: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the targets of the arm's actuators.

    Args:
      positions: `(..., 7)`, present joint positions [rad].
      action: `(..., 7)`, offsets from these positions, unbounded [rad].

    Returns:
      `(..., 7)` targets, clipped to the joint limits [rad].
    """
    return np.minimum(np.maximum(positions + action, _ARM_LOW), _ARM_HIGH)


def closing_probability(action: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """Probability `(...)` that a gripper logit `(...)` closes the gripper: 1 / (1 + exp(-logit)), without overflow."""
    return np.exp(-np.logaddexp(0.0, np.negative(action)))


def gripper_target(action: NDArray[np.float64] | float, draw: NDArray[np.float64] | float = 0.5) -> NDArray[np.float64]:
    """Returns the target of both fingers.

    Args:
      action: `(...)`, gripper logit, unbounded.
      draw: `(...)`, from U(0, 1); its median makes the gripper deterministic: it closes on positive logits.

    Returns:
      `(...)` targets [m]: closed if `draw` is below the closing probability, otherwise open.
    """
    return np.where(draw < closing_probability(action), GRIPPER_CLOSED, GRIPPER_OPEN)
