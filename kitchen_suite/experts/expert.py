"""The controller that runs any skill: it follows a path, sees when its aim is reached, and tries again if it is not."""

import abc
import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks
from kitchen_suite.experts.planning import Path

# How far a joint may be behind the path before the path waits for it [rad].
_PATIENCE = 0.25


@dataclasses.dataclass(frozen=True, kw_only=True)
class Style:
    """How an expert moves; what makes demonstrations differ.

    Attributes:
      speed: share of the greatest speed; at most 1.
      action_noise: standard deviation of the noise on actions, as a share of what one step may do.
      jitter: half width of the uniform displacement of places in free space, along each axis [m].
    """

    speed: float = 1.0
    action_noise: float = 0.0
    jitter: float = 0.0

    def __post_init__(self) -> None:
        if checks.number(self.speed, "speed", positive=True) > 1.0:
            raise ValueError(f"speed must be at most 1, got {self.speed!r}")
        checks.number(self.action_noise, "action_noise")
        checks.number(self.jitter, "jitter")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Seen:
    """What an observation tells of the robot.

    Attributes:
      joints: `(7,)`, positions of the arm's joints [rad].
      fingers: `(k,)`, opening of each finger that is seen [m].
    """

    joints: NDArray[np.float64]
    fingers: NDArray[np.float64]


class Expert(abc.ABC):
    """Acts in one episode after the other, on nothing but observations."""

    def __init__(self, style: Style | None = None) -> None:
        self._style = style or Style()
        self.reset(np.random.default_rng(0))

    def reset(self, generator: np.random.Generator) -> None:
        """Begins an episode.

        Args:
          generator: where jitter and noise are drawn from.
        """
        self._generator = generator
        self._path: Path | None = None
        self._time = 0.0

    def act(self, observation: ArrayLike) -> NDArray[np.float32]:
        """Chooses the next action.

        Args:
          observation: the flat observation of the environment.

        Returns:
          The action, in single precision and within its bounds.
        """
        observation = np.asarray(observation, np.float64)
        seen = self._see(observation)
        if (path := self._next_path(observation, seen)) is not None:
            self._path, self._time, self._reference = path, 0.0, seen.joints
        if np.max(np.abs(self._reference - seen.joints)) < _PATIENCE:
            self._time += self._style.speed
        self._reference, fingers = self._path.at(self._time)
        action = self._command(seen, self._reference, fingers)
        if self._style.action_noise:
            action = action + self._style.action_noise * self._noise_scale * self._generator.standard_normal(action.size)
        return np.minimum(np.maximum(action, self._low), self._high).astype(np.float32)

    @property
    def _over(self) -> bool:
        """Whether the path has ended."""
        return self._path is None or self._time >= self._path.duration
