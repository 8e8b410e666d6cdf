"""The control mode of a Gymnasium environment: its arguments, and its action space."""

import dataclasses
from typing import Any

import numpy as np
from dm_env import specs
from gymnasium import spaces


@dataclasses.dataclass(frozen=True, kw_only=True)
class ControlSettings:
    """Arguments of the Gymnasium environments that choose what the action means.

    See docs/control_modes.md for all modes, and for the arguments that belong to each.

    Attributes:
      control_mode: meaning of the action, such as `ee_delta_pose`; the domain's own when None.
      linear_speed: speed that a unit of action stands for in the modes of the end effector [m/s].
      angular_speed: angular speed that a unit of action stands for in `ee_delta_pose` [rad/s].
      joint_speed: joint speed that a unit of action stands for in `joint_delta` [rad/s].
      frame: `base` or `hand`: the axes of changes in the modes of the end effector.
    """

    control_mode: str | None = None
    linear_speed: float | None = None
    angular_speed: float | None = None
    joint_speed: float | None = None
    frame: str | None = None

    def task_options(self) -> dict[str, Any]:
        """Returns the arguments of the task."""
        return {name: value for name, value in dataclasses.asdict(self).items() if value is not None}


def action_space(spec: specs.Array) -> spaces.Box:
    """Returns the space of actions of a spec, in single precision."""
    bounds = (spec.minimum, spec.maximum) if isinstance(spec, specs.BoundedArray) else (-np.inf, np.inf)
    low, high = (np.broadcast_to(bound, spec.shape).astype(np.float32) for bound in bounds)
    return spaces.Box(low, high, dtype=np.float32)
