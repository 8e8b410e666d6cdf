"""Control modes of the joints: offsets from positions, absolute targets, and changes of the last targets."""

from typing import Any, NamedTuple

import mujoco
import numpy as np
from dm_control import mjcf
from dm_env import specs

from kitchen_suite import checks
from kitchen_suite.entities.arms.franka import PANDA, PANDA_JOINT_LIMITS
from kitchen_suite.entities.robot import Robot
from kitchen_suite.tasks.control_modes.action_mode import ActionMode, unit_spec
from kitchen_suite.tasks.simulation import Simulation, as_columns
from kitchen_suite.types import Array

GRIPPER_MODES = ("sampled", "deterministic")

# Limits of the Panda's seven arm joints and of its left finger [rad, m].
JOINT_LOW, JOINT_HIGH = PANDA_JOINT_LIMITS[:, :8]

ACTION_SIZE = JOINT_LOW.size

_ARM_LOW, _ARM_HIGH = JOINT_LOW[:7], JOINT_HIGH[:7]

GRIPPER_CLOSED = PANDA.closed  # Target of both fingers to close the gripper [m].
GRIPPER_OPEN = PANDA.open  # Target of both fingers to open the gripper [m].

# Joint positions from which episodes of the Panda start [rad; fingers: m].
DEFAULT_POSE = np.array([*PANDA.home.values()])

ARM_SIZE = 7

# Greatest distance of a target from its joint [rad]: nothing winds up against obstacles.
TARGET_DISTANCE = 0.3

# Least share of its greatest torque that a servo is taken to have for a change of velocity.
_LEAST_ROOM = 0.2

# Greatest speed that a unit of action may stand for [rad/s, m/s], several times that of the robot.
MAX_SPEED = 10.0


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
        """Sets how the gripper follows the last element of the action.

        Args:
          gripper: `sampled`, which closes with the probability of which the last element is the log odds, or
            `deterministic`, which closes where that probability is above one half.
        """
        self.gripper = checks.choice(gripper, GRIPPER_MODES, "gripper")
        self.draws = self.gripper == "sampled"

    def bind(self, physics: mjcf.Physics, robot: Robot, timestep: float) -> None:
        self._joint_qpos = as_columns(physics.bind(robot.joints).qposadr)

    def spec(self, robot: Robot) -> specs.Array:
        """Seven joint offsets [rad] and the gripper logit (log odds of closing); unbounded, but finite."""
        # The last element moves both fingers.
        names = "\t".join(actuator.full_identifier for actuator in robot.actuators[:ACTION_SIZE])
        return specs.Array((ACTION_SIZE,), np.float64, name=names)

    def control(
        self, simulation: Simulation, state: Any, command: tuple[()], action: Array, draw: Array | float
    ) -> tuple[Array, tuple[()]]:
        positions = simulation.read("qpos", self._joint_qpos)
        target = np.empty(positions.shape)
        target[..., :7] = arm_target(positions[..., :7], action[..., :7])
        target[..., 7:] = gripper_target(action[..., 7:], np.asarray(draw)[..., np.newaxis])
        return target, command


def arm_target(positions: Array, action: Array) -> Array:
    """Returns the targets of the arm's actuators.

    Args:
      positions: `(..., 7)`, present joint positions [rad].
      action: `(..., 7)`, offsets from these positions, unbounded [rad].

    Returns:
      `(..., 7)` targets, clipped to the joint limits [rad].
    """
    return np.minimum(np.maximum(positions + action, _ARM_LOW), _ARM_HIGH)


def closing_probability(action: Array | float) -> Array:
    """Probability `(...)` that a gripper logit `(...)` closes the gripper: 1 / (1 + exp(-logit)), without overflow."""
    return np.exp(-np.logaddexp(0.0, np.negative(action)))


def gripper_target(action: Array | float, draw: Array | float = 0.5) -> Array:
    """Returns the target of both fingers.

    Args:
      action: `(...)`, gripper logit, unbounded.
      draw: `(...)`, from U(0, 1); its median makes the gripper deterministic: it closes on positive logits.

    Returns:
      `(...)` targets [m]: closed if `draw` is below the closing probability, otherwise open.
    """
    return np.where(draw < closing_probability(action), GRIPPER_CLOSED, GRIPPER_OPEN)


class ArmServos:
    """Joint positions of the arm, and the targets of its servos.

    Attributes:
      low, high: `(7,)`, joint limits [rad].
      lag: `(7,)`, time constants with which the joints follow their targets [s].
      light: `(7,)` bool, whether a servo's greatest torque is less than a quarter of the strongest one's.
      have_feedback: whether the servos damp the joints' velocities themselves, within their greatest torques.
    """

    def __init__(self, physics: mjcf.Physics, robot: Robot) -> None:
        """Looks up the joints of a robot in a compiled scene."""
        size = robot.arm_size
        joints = physics.bind(robot.joints[:size])
        self.low, self.high = robot.joint_limits[:, :size].copy()
        self._gain = robot.gains
        self.lag = robot.damping / robot.gains
        actuators = physics.bind(robot.actuators[:size])
        self._ctrl_low, self._ctrl_high = np.transpose(actuators.ctrlrange)
        self._damping = robot.damping
        limited = physics.model.actuator_forcelimited[actuators.element_id]
        self._torque = np.where(limited, actuators.forcerange[:, 1], np.inf)
        self.light = self._torque < self._torque.max() / 4.0
        self.have_feedback = bool((physics.model.actuator_biasprm[actuators.element_id, 2] < 0.0).any())
        self._qpos, self._qvel = as_columns(joints.qposadr), as_columns(joints.dofadr)

    def positions(self, simulation: Simulation) -> Array:
        """Returns the present joint positions `(..., 7)` [rad]."""
        return simulation.read("qpos", self._qpos)

    def velocities(self, simulation: Simulation) -> Array:
        """Returns the present joint velocities `(..., 7)` [rad/s]."""
        return simulation.read("qvel", self._qvel)

    def load(self, simulation: Simulation, change: Array) -> Array:
        """Returns the torques `(..., 7)` that a change `(..., 7)` of velocities [rad/s] asks of the servos.

        Each is a multiple of what the servo can exert beside the torques of gravity and motion, which is taken to be at
        least a fifth of its greatest torque; 0 where torques are unlimited.
        """
        bias = simulation.read("qfrc_bias", self._qvel)
        room = np.maximum(self._torque - np.sign(change) * bias, _LEAST_ROOM * self._torque)
        return np.abs(change) * self._damping / room

    def target(self, simulation: Simulation, positions: Array) -> Array:
        """Returns servo targets `(..., 7)` that hold the arm at joint positions `(..., 7)` near the present ones [rad].

        The torques of gravity and motion are compensated: a servo holds a torque by an offset of the torque divided by
        its gain.
        """
        offset = simulation.read("qfrc_bias", self._qvel) / self._gain
        return np.minimum(np.maximum(positions + offset, self._ctrl_low), self._ctrl_high)


class Gripper:
    """The hand, opened and closed by one number: +1 closed, -1 open, linear between."""

    def __init__(self, robot: Robot) -> None:
        """Looks up the targets of the hand's actuators."""
        self.closed, self.open = robot.grip
        self._count = len(robot.actuators) - robot.arm_size

    def target(self, action: Array) -> Array:
        """Returns the targets of the hand's actuators, `(..., 2)` of the Franka [m], for an action `(..., 1)`."""
        middle, half = (self.closed + self.open) / 2.0, (self.closed - self.open) / 2.0
        return np.repeat(middle + half * action, self._count, axis=-1)


class JointPosition(ActionMode):
    """`joint_position`: targets of the arm's joints [rad] and of both fingers [m], within the joint limits."""

    name = "joint_position"
    formula = (
        "ctrl[:7] = clip(action[:7], minimum[:7], maximum[:7]); both fingers: clip(action[7], minimum[7], maximum[7])"
    )

    def spec(self, robot: Robot) -> specs.BoundedArray:
        """Seven joint targets [rad] and the fingers' target [m]; values beyond the joint limits are clipped."""
        low, high = robot.joint_limits[:, : ARM_SIZE + 1]
        names = [actuator.full_identifier for actuator in robot.actuators[: ARM_SIZE + 1]]
        return specs.BoundedArray(low.shape, np.float64, minimum=low, maximum=high, name="\t".join(names))

    def bind(self, physics: mjcf.Physics, robot: Robot, timestep: float) -> None:
        spec = self.spec(robot)
        self._low, self._high = spec.minimum, spec.maximum

    def control(
        self, simulation: Simulation, state: Any, command: tuple[()], action: Array, draw: Array | float
    ) -> tuple[Array, tuple[()]]:
        target = np.minimum(np.maximum(action, self._low), self._high)
        return np.concatenate([target, target[..., -1:]], axis=-1), command


class JointCommand(NamedTuple):
    """Commanded joint positions, which `joint_delta` changes.

    Attributes:
      positions: `(..., 7)`, commanded positions of the arm's joints [rad].
    """

    positions: Array


class JointDelta(ActionMode):
    """`joint_delta`: changes of the commanded positions of the arm's joints, and the gripper.

    Commanded positions start at those of the reset, stay within the joint limits and within 0.3 rad of their joints,
    and are held against gravity.
    """

    name = "joint_delta"
    formula = (
        "p = clip(p + joint_speed * control_timestep * clip(action[:7], -1, 1), low, high), at first the joint "
        f"positions q; low and high are the joint limits, brought to at most {TARGET_DISTANCE:g} from q; ctrl[:7] = "
        "clip(p + qfrc_bias / kp, ctrlrange), with qfrc_bias of the present state; both fingers: from open at "
        "action[7] = -1 to closed at 1, linear between"
    )

    stage = mujoco.mjtStage.mjSTAGE_VEL

    def __init__(self, *, joint_speed: float = 1.0) -> None:
        """Sets the speed.

        Args:
          joint_speed: joint speed that a unit of action stands for, at most 10 [rad/s].
        """
        self.joint_speed = checks.number(joint_speed, "joint_speed", positive=True, maximum=MAX_SPEED)

    def spec(self, robot: Robot) -> specs.BoundedArray:
        """Seven joint velocities, as a share of `joint_speed`, and the gripper: +1 closed, -1 open; in [-1, 1]."""
        return unit_spec([*(actuator.full_identifier for actuator in robot.actuators[:ARM_SIZE]), "gripper"])

    def bind(self, physics: mjcf.Physics, robot: Robot, timestep: float) -> None:
        self._servos, self._gripper = ArmServos(physics, robot), Gripper(robot)
        self._step = self.joint_speed * timestep

    def start(self, simulation: Simulation) -> JointCommand:
        return JointCommand(np.array(self._servos.positions(simulation)))

    def control(
        self, simulation: Simulation, state: Any, command: JointCommand, action: Array, draw: Array | float
    ) -> tuple[Array, JointCommand]:
        servos, action = self._servos, np.minimum(np.maximum(action, -1.0), 1.0)
        present = servos.positions(simulation)
        # A joint that stands beyond its limit may stay there.
        low = np.maximum(present - TARGET_DISTANCE, np.minimum(servos.low, present))
        high = np.minimum(present + TARGET_DISTANCE, np.maximum(servos.high, present))
        positions = np.minimum(np.maximum(command.positions + self._step * action[..., :ARM_SIZE], low), high)
        fingers = self._gripper.target(action[..., ARM_SIZE:])
        return np.concatenate([servos.target(simulation, positions), fingers], axis=-1), JointCommand(positions)
