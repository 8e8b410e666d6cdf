"""Control modes of the joints: absolute targets, and changes of the last targets."""

from typing import Any, NamedTuple

import mujoco
import numpy as np
from dm_control import mjcf
from dm_env import specs
from numpy.typing import NDArray

from kitchen_suite import checks
from kitchen_suite.entities.robots.franka import Franka
from kitchen_suite.tasks.control_modes.servos import ARM_SIZE, ArmServos, Gripper
from kitchen_suite.tasks.mdp import ActionMode
from kitchen_suite.tasks.simulation import Simulation

# Greatest distance of a target from its joint [rad]: nothing winds up against obstacles.
TARGET_DISTANCE = 0.3


class JointPosition(ActionMode):
    """`joint_position`: targets of the arm's joints [rad] and of both fingers [m], within the joint limits."""

    name = "joint_position"
    formula = (
        "ctrl[:7] = clip(action[:7], minimum[:7], maximum[:7]); both fingers: clip(action[7], minimum[7], maximum[7])"
    )

    def spec(self, robot: Franka) -> specs.BoundedArray:
        """Seven joint targets [rad] and the fingers' target [m]; values beyond the joint limits are clipped."""
        low, high = np.transpose([actuator.range for actuator in robot.joint_actuators[: ARM_SIZE + 1]])
        names = [actuator.full_identifier for actuator in robot.actuators[: ARM_SIZE + 1]]
        return specs.BoundedArray(low.shape, np.float64, minimum=low, maximum=high, name="\t".join(names))

    def bind(self, physics: mjcf.Physics, robot: Franka, timestep: float) -> None:
        del physics, timestep
        spec = self.spec(robot)
        self._low, self._high = spec.minimum, spec.maximum

    def control(
        self,
        simulation: Simulation,
        state: Any,
        command: tuple[()],
        action: NDArray[np.float64],
        draw: NDArray[np.float64] | float,
    ) -> tuple[NDArray[np.float64], tuple[()]]:
        del simulation, state, draw
        target = np.minimum(np.maximum(action, self._low), self._high)
        return np.concatenate([target, target[..., -1:]], axis=-1), command


class JointCommand(NamedTuple):
    """Commanded joint positions, which `joint_delta` changes.

    Attributes:
      positions: `(..., 7)`, commanded positions of the arm's joints [rad].
    """

    positions: NDArray[np.float64]


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
          joint_speed: joint speed that a unit of action stands for [rad/s].

        Raises:
          TypeError: it is no number.
          ValueError: it is not positive and finite.
        """
        self.joint_speed = checks.number(joint_speed, "joint_speed", positive=True)

    def spec(self, robot: Franka) -> specs.BoundedArray:
        """Seven joint velocities, as a share of `joint_speed`, and the gripper: +1 closed, -1 open; in [-1, 1]."""
        names = [actuator.full_identifier for actuator in robot.actuators[:ARM_SIZE]]
        return unit_spec([*names, "gripper"])

    def bind(self, physics: mjcf.Physics, robot: Franka, timestep: float) -> None:
        self._servos, self._gripper = ArmServos(physics, robot), Gripper(robot)
        self._step = self.joint_speed * timestep

    def start(self, simulation: Simulation) -> JointCommand:
        return JointCommand(np.array(self._servos.positions(simulation)))

    def control(
        self,
        simulation: Simulation,
        state: Any,
        command: JointCommand,
        action: NDArray[np.float64],
        draw: NDArray[np.float64] | float,
    ) -> tuple[NDArray[np.float64], JointCommand]:
        del state, draw
        servos, action = self._servos, np.minimum(np.maximum(action, -1.0), 1.0)
        present = servos.positions(simulation)
        # A joint that stands beyond its limit may stay there.
        low = np.maximum(present - TARGET_DISTANCE, np.minimum(servos.low, present))
        high = np.minimum(present + TARGET_DISTANCE, np.maximum(servos.high, present))
        positions = np.minimum(np.maximum(command.positions + self._step * action[..., :ARM_SIZE], low), high)
        fingers = self._gripper.target(action[..., ARM_SIZE:])
        return np.concatenate([servos.target(simulation, positions), fingers], axis=-1), JointCommand(positions)


def unit_spec(names: list[str]) -> specs.BoundedArray:
    """Returns the spec of an action with named elements in [-1, 1]."""
    ones = np.ones(len(names))
    return specs.BoundedArray(ones.shape, ones.dtype, minimum=-ones, maximum=ones, name="\t".join(names))
