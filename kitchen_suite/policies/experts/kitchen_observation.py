"""The kitchen's observation as its expert reads it: positions of objects, and the tasks asked."""

import functools
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.entities import Scene, build_kitchen_scene
from kitchen_suite.tasks.kitchen import noise
from kitchen_suite.tasks.kitchen.goals import GOALS

_, _, _OBJECTS, _ = noise.SLICES


@functools.cache
def scene() -> Scene:
    """The kitchen without visuals, shared by all instances."""
    return build_kitchen_scene(visuals=False)


@functools.cache
def _elements() -> Mapping[str, NDArray[np.int64]]:
    """Indices of the positions of each goal's joints among the object positions of the observation, by task."""
    return {task: goal.elements_in(scene()) for task, goal in GOALS.items()}


def achieved(task: str, observation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Positions of the joints of a task's goal in an observation [rad, m, quaternion]."""
    return observation[_OBJECTS][_elements()[task]]


def asked(order: Sequence[str], tasks: Sequence[str], requested: NDArray[np.float64]) -> tuple[str, ...]:
    """Returns the tasks of `order` that an observation `requested_tasks` `(n,)` of the `n` tasks asks for."""
    wanted = {task for task, is_asked in zip(tasks, requested > 0.5, strict=True) if is_asked}
    return tuple(task for task in order if task in wanted)
