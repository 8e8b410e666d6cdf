"""The controller that all experts share: it follows a joint trajectory, and detects when the arm cannot follow."""

import abc
import dataclasses
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks
from kitchen_suite.policies.experts.trajectories import JointTrajectory

# A joint farther than this from its target [rad] halts the trajectory, which fails after this many control steps.
_MAX_LAG = 0.25
_MAX_HALTED_STEPS = 12


@dataclasses.dataclass(frozen=True, kw_only=True)
class MotionStyle:
    """Variation of an expert's motions, for diverse demonstrations.

    Attributes:
      speed: fraction of the expert's greatest speed, above 0 and at most 1.
      action_noise: standard deviation of normal noise on the arm's seven elements of the action, in their unit.
      jitter: half width of the uniform displacement, along each axis, of the hand's poses in free space [m].
    """

    speed: float = 1.0
    action_noise: float = 0.0
    jitter: float = 0.0

    def __post_init__(self) -> None:
        if checks.number(self.speed, "speed", positive=True) > 1.0:
            raise ValueError(f"speed must be at most 1, got {self.speed!r}")
        checks.number(self.action_noise, "action_noise")
        checks.number(self.jitter, "jitter")


class Expert(abc.ABC):
    """A policy on observations alone; one instance plays one episode at a time.

    Subclasses read the observation, plan the trajectories, and compute the actions that follow them.
    """

    # Elements of an observation, bounds of each element of the action.
    observation_size: int
    _low: float
    _high: float

    def __init__(self, style: MotionStyle | None) -> None:
        if not isinstance(style, MotionStyle | None):
            raise TypeError(f"style must be a MotionStyle, got {style!r}")
        self._style = style or MotionStyle()
        self.reset(np.random.default_rng(0))

    @classmethod
    @abc.abstractmethod
    def for_task(cls, task: Any, **options: Any) -> Self:
        """Builds the expert for a task from the task's settings; it never reads the physics.

        Args:
          task: of the expert's domain.
          **options: arguments of the class; they replace the settings of the task.

        Raises:
          TypeError: an argument is unknown or of the wrong type.
          ValueError: an option has a value that the expert rejects.
        """

    def reset(self, generator: np.random.Generator) -> None:
        """Begins an episode.

        Args:
          generator: source of jitter and action noise; a style without them draws nothing.
        """
        self._generator = generator
        self._trajectory: JointTrajectory | None = None
        self._time, self._halted_steps = 0.0, 0

    def act(self, observation: ArrayLike) -> NDArray[np.float32]:
        """Chooses the next action.

        Args:
          observation: the flat observation of the environment, without goals.

        Returns:
          The action, within its bounds.

        Raises:
          TypeError: the observation does not hold real numbers.
          ValueError: it has the wrong shape, or is not finite.
        """
        observation = checks.vector(observation, self.observation_size, "observation")
        joints = self._arm_positions(observation)
        if (trajectory := self._next_trajectory(observation, joints)) is not None:
            self._trajectory, self._time, self._halted_steps, self._target = trajectory, 0.0, 0, joints
        if np.max(np.abs(self._target - joints)) < _MAX_LAG:
            self._time, self._halted_steps = self._time + self._style.speed, 0
        else:
            self._halted_steps += 1
        self._target, fingers = self._current_trajectory.at(self._time)
        action = self._compute_action(observation, joints, self._target, fingers)
        if self._style.action_noise:
            action[: joints.size] += self._style.action_noise * self._generator.standard_normal(joints.size)
        return np.clip(action, self._low, self._high).astype(np.float32)

    @property
    def _current_trajectory(self) -> JointTrajectory:
        assert self._trajectory is not None, "the first observation starts a trajectory"
        return self._trajectory

    @property
    def _current_fingers(self) -> float:
        """Opening of each finger that the trajectory has at present [m]."""
        _, fingers = self._current_trajectory.at(self._time)
        return fingers

    def _has_ended(self, settle_steps: float) -> bool:
        """Whether the trajectory ended at least `settle_steps` control steps ago, or the arm cannot follow it."""
        return self._time >= self._current_trajectory.duration + settle_steps or self._halted_steps >= _MAX_HALTED_STEPS

    def _draw_offsets(self, count: int) -> NDArray[np.float64]:
        """Draws displacements `(count, 3)` of poses in free space [m]."""
        if not self._style.jitter:
            return np.zeros((count, 3))
        return self._generator.uniform(-self._style.jitter, self._style.jitter, (count, 3))

    @abc.abstractmethod
    def _arm_positions(self, observation: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the observed positions `(7,)` of the arm's joints [rad]."""

    @abc.abstractmethod
    def _next_trajectory(self, observation: NDArray[np.float64], joints: NDArray[np.float64]) -> JointTrajectory | None:
        """Returns a trajectory from the present joint positions, or None to continue the current one.

        The first call of an episode must return one.
        """

    @abc.abstractmethod
    def _compute_action(
        self, observation: NDArray[np.float64], joints: NDArray[np.float64], target: NDArray[np.float64], fingers: float
    ) -> NDArray[np.float64]:
        """Returns the action that moves joints and fingers to their targets within a control step, before clipping."""
