"""A person's commands in place of a plan: hand and fingers of the arm follow what is commanded from outside."""

from collections.abc import Callable, Mapping
from typing import Any

import dm_env
import mink
import numpy as np
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks
from kitchen_suite.entities.arms import FRANKA
from kitchen_suite.policies.experts.base import Expert, expert_class
from kitchen_suite.policies.experts.skills import CLOSED, OPEN
from kitchen_suite.policies.experts.trajectories import JointTrajectory
from kitchen_suite.types import Array

# Distance from the hand at which a commanded position is held, so that the arm stops soon after the last command [m].
_LEASH = 0.15

# Mean position of the fingers below which they are taken to be closed, around something if need be [m].
_CLOSED_BELOW = 0.032


class Teleoperation(Expert):
    """Moves hand and fingers to where they were last commanded, in any control mode of a task that has an expert.

    The speed is limited to what the control mode can follow. Before the first command of an episode, and after `hold`,
    the hand stays where it is.

    Attributes:
      is_idle: whether nothing has been commanded since then.
      is_closed: whether the fingers are commanded to close.
      fingers: their positions `(2,)` [m] at the last observation.
    """

    fingers: Array

    def __init__(self, expert: Expert) -> None:
        """Takes the robot and its control from the scripted expert of a task."""
        self._expert, self.observation_size = expert, expert.observation_size
        super().__init__(None, expert.encoder)

    @classmethod
    def for_task(cls, task: Any, **options: Any) -> "Teleoperation":
        """Returns the teleoperation of a task; layouts may vary, whatever is observed."""
        if task.robot.specification.name != FRANKA:
            raise ValueError(f"a person can move the Franka alone, not robot {task.robot.mjcf_model.model!r}")
        return cls(expert_class(task).unchecked(task, **options))

    def without_goals(self, flat: NDArray) -> NDArray:
        return self._expert.without_goals(flat)

    def reset(self, generator: np.random.Generator) -> None:
        super().reset(generator)
        self.is_closed = False
        self.hold()

    def hold(self) -> None:
        """Makes the hand stay where it is; the fingers stay as they are commanded."""
        self._command: mink.SE3 | None = None
        self._is_new = self.is_idle = True

    def rest(self) -> None:
        """Says that nothing is to be done until the next command, which is relative to the last one."""
        self.is_idle = True

    def resume(self) -> None:
        """Goes on from the last observation, after steps that were not commanded here: holds as the fingers are."""
        self.is_closed = bool(self.fingers.mean() < _CLOSED_BELOW)
        self.hold()

    @property
    def command(self) -> tuple[Array, Array] | None:
        """Commanded position `(3,)` [m] and orientation `(4,)` of the hand, as quaternion w, x, y, z; None for none."""
        return None if self._command is None else _parts(self._command)

    @property
    def hand(self) -> tuple[Array, Array]:
        """Pose of the hand at the last observation, as `command`."""
        return _parts(self._hand)

    def move_to(self, position: ArrayLike, orientation: ArrayLike) -> None:
        """Commands a pose of the hand in the world: position `(3,)` [m], and quaternion `(4,)` w, x, y, z."""
        place, turn = checks.vector(position, 3, "position"), checks.vector(orientation, 4, "orientation")
        if not np.linalg.norm(turn) > 0.0:
            raise ValueError(f"orientation must not be zero, got {checks.shown(orientation)}")
        rotation = mink.SO3(turn / np.linalg.norm(turn))
        self._command = mink.SE3.from_rotation_and_translation(rotation, place)
        self._is_new, self.is_idle = True, False

    def nudge(self, offset: ArrayLike, turn: ArrayLike = (0.0, 0.0, 0.0)) -> None:
        """Displaces the commanded pose by an offset `(3,)` [m] and a rotation vector `(3,)` [rad].

        They are in the frame of the robot's base: x forward, y to the left, z up. The command stays within 0.15 m of
        the hand.
        """
        present, base = self._hand if self._command is None else self._command, self._kinematics.base.rotation()
        rotation = mink.SO3.exp(base.apply(checks.vector(turn, 3, "turn"))) @ present.rotation()
        away = present.translation() + base.apply(checks.vector(offset, 3, "offset")) - self._hand.translation()
        distance = float(np.linalg.norm(away))
        away *= min(1.0, _LEASH / max(distance, _LEASH))
        self.move_to(self._hand.translation() + away, rotation.wxyz)

    def grasp(self, close: bool) -> None:
        """Closes the fingers, or opens them."""
        self.is_closed, self._is_new, self.is_idle = close, True, False

    def observe(self, observation: ArrayLike) -> None:
        """Takes the pose of the hand from an observation, to which nudges are relative."""
        checked = checks.vector(observation, self.observation_size, "observation")
        positions = self.robot_positions(checked)
        arm = self._kinematics.arm
        self._hand, self.fingers = self._kinematics.forward(positions[arm]), positions[arm.stop :]

    def robot_positions(self, observation: Array) -> Array:
        return self._expert.robot_positions(observation)

    def _next_trajectory(self, observation: Array, joints: Array) -> JointTrajectory | None:
        if not self._is_new and self._trajectory is not None:
            return None
        self._is_new = False
        fingers = CLOSED if self.is_closed else OPEN
        here = JointTrajectory.stationary(joints, fingers)
        if self._command is None:
            return here
        start = joints if self._trajectory is None else self._target
        there = self._kinematics.inverse(self._command, start=start)
        return here.then(JointTrajectory.stationary(there, fingers), self._limits)


class TeleoperatedPolicy:
    """The policy of a person, on time steps of dm_env; another policy may act until the person takes over.

    Attributes:
      arm: that is commanded; a command takes over.
      labels: of the last action, by the names of gym-hil: `is_intervention`, whether the person chose it, and
        `teleop_action`, the action.
    """

    labels: Mapping[str, Any]

    def __init__(self, task: Any, other: Callable[[dm_env.TimeStep], ArrayLike] | None = None) -> None:
        """Prepares to act in a task, after another policy if one is given."""
        self.arm, self._inputs, self._other = Teleoperation.for_task(task), task.policy_inputs, other
        self._has_acted = False
        self._begin()

    @property
    def is_persons(self) -> bool:
        """Whether the person acts."""
        return self._has_taken_over or not self.arm.is_idle

    def __call__(self, timestep: dm_env.TimeStep) -> NDArray[np.float32]:
        self.observe(timestep)
        is_persons = self._has_taken_over = self.is_persons
        action = self.arm.act(self._flat(timestep)) if is_persons else self._others_action(timestep)
        self._has_acted = True
        self.labels = {"is_intervention": is_persons, "teleop_action": action}
        return action

    def take_over(self) -> None:
        """Lets the person act, who has commanded nothing yet: the hand stays where it is."""
        self._has_taken_over = True
        self.arm.hold()

    @property
    def can_hand_back(self) -> bool:
        """Whether there is another policy, which could act in place of the person, who acts."""
        return self._other is not None and self.is_persons

    def hand_back(self) -> None:
        """Lets the other policy act again, as if an episode began; nothing changes where there is none."""
        self.arm.hold()
        self._begin()

    def observe(self, timestep: dm_env.TimeStep) -> None:
        """Takes a time step without acting, so that commands can be relative to the hand there.

        At the first one of an episode the commands of the last episode end.
        """
        if timestep.first() and self._has_acted:
            self.arm.reset(np.random.default_rng(0))
            self._has_acted = False
            self._begin()
        self.arm.observe(self._flat(timestep))

    def _begin(self) -> None:
        self._has_taken_over, self._is_first = self._other is None, True

    def _others_action(self, timestep: dm_env.TimeStep) -> NDArray[np.float32]:
        assert self._other
        if self._is_first:
            timestep = timestep._replace(step_type=dm_env.StepType.FIRST)
        self._is_first = False
        # Recordings keep float32.
        return np.asarray(self._other(timestep), np.float32)

    def _flat(self, timestep: dm_env.TimeStep) -> NDArray:
        return self.arm.without_goals(self._inputs.flatten(timestep.observation).ravel())


def _parts(pose: mink.SE3) -> tuple[Array, Array]:
    return pose.translation().copy(), pose.rotation().wxyz.copy()
