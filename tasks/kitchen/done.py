"""A parameter of the kitchen: which tasks are done at the start of an episode."""

from collections.abc import Callable, Collection, Mapping

import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities.parameters import Elements, Parameter, Quantity
from kitchen_suite.entities.scenes.scene import Scene
from kitchen_suite.tasks.goals import Goal
from kitchen_suite.tasks.kitchen.goals import DEFAULT_TASKS, GOALS

# Whether each of the default tasks is done at the start; without effect on those that move the same joints as
# asked ones, and on those that would be in their way.
DONE = "tasks/done"

# The open door of the hinge cabinet stands before the handle of the slide cabinet.
_IN_THE_WAY = {"slide cabinet": "hinge cabinet"}


def may_be_done(asked: Collection[str]) -> dict[str, Goal]:
    """Returns the goals of the tasks that may be done at the start where some are asked, by task."""
    in_the_way = {_IN_THE_WAY[task] for task in asked if task in _IN_THE_WAY}
    moved = [GOALS[task] for task in asked]
    return {
        task: GOALS[task]
        for task in DEFAULT_TASKS
        if task not in in_the_way and not any(GOALS[task].shares_joints(goal) for goal in moved)
    }


def done_parameter(scene: Scene, tasks: Callable[[], Mapping[str, Goal]]) -> Parameter:
    """Returns the parameter that completes some tasks at the start.

    Args:
      scene: with the goals' props.
      tasks: returns the goals of the tasks that it can complete in the episode that starts; it ignores others.
    """
    joints = {task: GOALS[task].joints_in(scene) for task in DEFAULT_TASKS}
    elements = tuple(joint for task in tasks() for joint in joints[task])

    def write(physics: mjcf.Physics, elements: Elements, value: NDArray[np.float64]) -> None:
        del elements
        goals = tasks()
        for task, is_done in zip(DEFAULT_TASKS, value > 0.5, strict=True):
            if is_done and task in goals:
                physics.bind(joints[task]).qpos = goals[task].value

    quantity = Quantity(
        read=lambda physics, elements: np.zeros(len(DEFAULT_TASKS)),
        write=write,
        model_fields=(),
        shape=(len(DEFAULT_TASKS),),
        non_negative=True,
    )
    return Parameter(name=DONE, unit="0 or 1", quantity=quantity, elements=elements)
