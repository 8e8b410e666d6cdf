"""The controller that runs every skill: it follows a path of joint positions, and sees whether that is possible."""

import abc
import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks
from kitchen_suite.policies.experts.trajectories import JointTrajectory

# How far a joint may be behind before its path waits for it [rad], and for how long it waits [control steps].
_MOST_LAG = 0.25
_PATIENCE = 12


@dataclasses.dataclass(frozen=True, kw_only=True)
class MotionStyle:
    """How an expert moves; what makes demonstrations differ.

    Attributes:
      speed: share of the expert's greatest speed, above 0 and at most 1.
      action_noise: standard deviation of normal noise on the arm's seven elements of the action, in their unit.
      jitter: half width of the uniform displacement, along each axis, of places before things [m].
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
    """Acts on nothing but observations; one instance serves one episode at a time.

    Subclasses tell what an observation means, where to go next, and which action takes the joints somewhere.
    """

    # Numbers in an observation, bounds of each element of the action.
    observation_size: int
    _low: float
    _high: float

    def __init__(self, style: MotionStyle | None) -> None:
        if not isinstance(style, MotionStyle | None):
            raise TypeError(f"style must be a MotionStyle, got {style!r}")
        self._style = style or MotionStyle()
        self.reset(np.random.default_rng(0))

    def reset(self, generator: np.random.Generator) -> None:
        """Begins an episode.

        Args:
          generator: what jitter and noise are drawn from; without them nothing is.
        """
        self._generator = generator
        self._path: JointTrajectory | None = None
        self._time, self._waited = 0.0, 0

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
        joints = self._joints(observation)
        if (path := self._new_path(observation, joints)) is not None:
            self._path, self._time, self._waited, self._target = path, 0.0, 0, joints
        if np.max(np.abs(self._target - joints)) < _MOST_LAG:
            self._time, self._waited = self._time + self._style.speed, 0
        else:
            self._waited += 1
        self._target, fingers = self._current_path.at(self._time)
        action = self._action(observation, joints, self._target, fingers)
        if self._style.action_noise:
            action[: joints.size] += self._style.action_noise * self._generator.standard_normal(joints.size)
        return np.clip(action, self._low, self._high).astype(np.float32)

    @property
    def _current_path(self) -> JointTrajectory:
        assert self._path is not None, "the first observation makes a path"
        return self._path

    def _has_ended(self, linger: float) -> bool:
        """Whether the path ended so many control steps ago, or cannot be followed."""
        return self._time >= self._current_path.duration + linger or self._waited >= _PATIENCE

    def _offsets(self, count: int) -> NDArray[np.float64]:
        """Draws displacements `(count, 3)` [m]."""
        if not self._style.jitter:
            return np.zeros((count, 3))
        return self._generator.uniform(-self._style.jitter, self._style.jitter, (count, 3))

    @abc.abstractmethod
    def _joints(self, observation: NDArray[np.float64]) -> NDArray[np.float64]:
        """Positions `(7,)` of the arm's joints [rad]."""

    @abc.abstractmethod
    def _new_path(self, observation: NDArray[np.float64], joints: NDArray[np.float64]) -> JointTrajectory | None:
        """A path from where the joints are, if it is time for one, as at the first call; else None to go on."""

    @abc.abstractmethod
    def _action(
        self, observation: NDArray[np.float64], joints: NDArray[np.float64], target: NDArray[np.float64], fingers: float
    ) -> NDArray[np.float64]:
        """The action that takes joints and fingers to a target at the end of the control step, as far as it can."""
