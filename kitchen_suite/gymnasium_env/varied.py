"""Variations of a Gymnasium environment: its arguments, its space of values, and the options of its resets."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces

from kitchen_suite.environment import Environment
from kitchen_suite.tasks.base import SuiteTask
from kitchen_suite.tasks.varied_task import VariedTask

# Options of `reset`: of every environment, of single ones alone, and of vectorised ones alone.
VARIATION, VARIATION_VALUES = "variation", "variation_values"
STATE, RESET_MASK = "state", "reset_mask"

# Key of infos that hold strings.
VARIATION_SPLIT = "variation_split"


@dataclasses.dataclass(frozen=True, kw_only=True)
class VariationSettings:
    """Arguments of the Gymnasium environments that choose what varies from episode to episode.

    See docs/variations.md for all parameters.

    Attributes:
      variations: names of groups, such as `start`, alone, in a sequence or joined by commas; or distributions by
        parameter, also as JSON describes them. Nothing varies when None.
      variation_split: `seen` or `held_out`: which distributions the groups have.
    """

    variations: Any = None
    variation_split: str = "seen"

    def task_options(self) -> dict[str, Any]:
        """Returns the arguments of the task that differ from its defaults."""
        values = ((field.name, getattr(self, field.name), field.default) for field in dataclasses.fields(self))
        return {name: value for name, value, default in values if value is not default}


def space_of(task: VariedTask) -> spaces.Dict:
    """Returns the space of the parameters that vary in a task, by name."""
    boxes: dict[str, spaces.Space] = {
        name: spaces.Box(varied.low, varied.high, varied.default.shape, np.float64)
        for name, varied in task.wanted_variations.items()
    }
    return spaces.Dict(boxes)


def request(task: SuiteTask, options: Mapping[str, Any]) -> None:
    """Makes a task's next reset follow the options of a reset.

    Raises as `VariedTask.variation_request` and `OptionedTask.reset_request`; the task is unchanged then.
    """
    own = task.reset_request(options)
    chosen = task.variation_request(options.get(VARIATION), options.get(VARIATION_VALUES))
    task.request_variation(chosen)
    task.request_reset(own)


class VariedEnv:
    """An environment with the variations of its task."""

    _environment: Environment

    @property
    def variation_space(self) -> spaces.Dict:
        """Ranges of the parameters that vary, by name; empty if nothing varies."""
        return space_of(self._environment.task)

    @property
    def variation_values(self) -> dict[str, Any]:
        """Values of these parameters in the present episode, in fresh arrays."""
        return self._environment.task.variation_values

    @property
    def variation_split(self) -> str:
        """`seen` or `held_out`."""
        return self._environment.task.variation_split
