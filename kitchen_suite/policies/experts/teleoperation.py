"""A person's commands in place of a plan: hand and fingers of the arm follow what is commanded from outside."""

from collections.abc import Mapping
from typing import Any

import dm_env
import mink
import numpy as np
from dm_control import composer
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks
from kitchen_suite.policies.experts.base import Expert, expert_class
from kitchen_suite.policies.experts.skills import CLOSED, OPEN, Array
from kitchen_suite.policies.experts.trajectories import JointTrajectory

# Distance from the hand at which a commanded position is held, so that the arm stops soon after the last command [m].
_LEASH = 0.15


class Teleoperation(Expert):
    """Moves hand and fingers to where they were last commanded, in any control mode of a task that has an expert.

    The speed is limited to what the control mode can follow. Before the first command of an episode, and after `hold`,
    the hand stays where it is.

    Attributes:
      is_idle: whether nothing has been commanded since then.
      is_closed: whether the fingers are commanded to close.
    """

    def __init__(self, expert: Expert) -> None:
        """Takes the robot and its control from the scripted expert of a task."""
        self._expert, self.observation_size = expert, expert.observation_size
        super().__init__(None, expert.encoder)

    @classmethod
    def for_task(cls, task: Any, **options: Any) -> "Teleoperation":
        """Returns the teleoperation of a task; layouts may vary, whatever is observed."""
        return cls(expert_class(task).unchecked(task, **options))

    @classmethod
    def _task_settings(cls, task: Any) -> dict[str, Any]:
        return {}

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
        """Displaces the commanded pose, in the frame of the robot's base: x forward, y to the left, z up.

        Args:
          offset: `(3,)` [m]. The command stays within 0.15 m of the hand.
          turn: `(3,)`, rotation vector [rad].
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
        self._hand = self._kinematics.forward(self.robot_positions(checked)[:7])

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
    """The policy of a person, on time steps of dm_env.

    Attributes:
      arm: that is commanded.
      labels: of the last action: `is_intervention`, always True, and `teleop_action`, the action.
    """

    labels: Mapping[str, Any]

    def __init__(self, task: Any) -> None:
        """Prepares to act in a task."""
        self.arm, self._inputs, self._has_acted = Teleoperation.for_task(task), task.policy_inputs, False

    def __call__(self, timestep: dm_env.TimeStep) -> NDArray[np.float32]:
        self.observe(timestep)
        action = self.arm.act(self._flat(timestep))
        self._has_acted = True
        self.labels = {"is_intervention": True, "teleop_action": action}
        return action

    def observe(self, timestep: dm_env.TimeStep) -> None:
        """Takes a time step without acting, so that commands can be relative to the hand there.

        At the first one of an episode the commands of the last episode end.
        """
        if timestep.first() and self._has_acted:
            self.arm.reset(np.random.default_rng(0))
            self._has_acted = False
        self.arm.observe(self._flat(timestep))

    def _flat(self, timestep: dm_env.TimeStep) -> NDArray:
        return self.arm.without_goals(self._inputs.flatten(timestep.observation).ravel())


def make_policy(environment: composer.Environment, generator: np.random.Generator) -> TeleoperatedPolicy:
    """Builds the policy of a person for an environment of the suite; nothing is drawn from the generator."""
    return TeleoperatedPolicy(environment.task)


def _parts(pose: mink.SE3) -> tuple[Array, Array]:
    return pose.translation().copy(), pose.rotation().wxyz.copy()
