"""The goals of the kitchen's props: the seven of the reference, three like them, and ten that undo these."""

import itertools
from collections.abc import Mapping, Sequence
from types import MappingProxyType

from numpy.typing import ArrayLike

from kitchen_suite.tasks.goals import Goal, GoalSet
from kitchen_suite.tasks.instructions import OPEN_MICROWAVE
from kitchen_suite.tasks.kitchen.reverse_goals import REVERSES, reverse_goals

# Distance below which a task counts as complete, over all joints of the task together [rad, m]; as in the reference.
THRESHOLD = 0.3

# The values are those of gymnasium-robotics 1.4.2.
_ORIGINAL = {
    "bottom burner": Goal(
        prop="oven",
        joints=("knob_Joint_2", "bottom_left_burner"),
        value=(-0.88, -0.01),
        handle="knob_2",
        instructions=(
            "turn on the bottom left burner",
            "switch on the bottom left burner",
            "turn the knob of the bottom left burner",
            "light the bottom left burner of the stove",
        ),
    ),
    "top burner": Goal(
        prop="oven",
        joints=("knob_Joint_4", "top_left_burner"),
        value=(-0.92, -0.01),
        handle="knob_4",
        instructions=(
            "turn on the top left burner",
            "switch on the top left burner",
            "turn the knob of the top left burner",
            "light the top left burner of the stove",
        ),
    ),
    "light switch": Goal(
        prop="hood",
        value=(-0.69, -0.05),
        instructions=(
            "turn on the light switch",
            "switch on the light",
            "flip the light switch on the hood",
            "turn on the light above the stove",
        ),
    ),
    "slide cabinet": Goal(
        prop="slide_cabinet",
        value=(0.37,),
        instructions=(
            "open the slide cabinet",
            "slide the cabinet door open",
            "slide the door of the cabinet to the right",
            "push the sliding door of the cabinet open",
        ),
    ),
    "hinge cabinet": Goal(
        prop="hinge_cabinet",
        value=(0.0, 1.45),
        handle="right_handle",
        instructions=(
            "open the right door of the hinge cabinet",
            "open the hinge cabinet on its right side",
            "pull the right door of the hinge cabinet open",
            "swing the right door of the hinge cabinet open",
        ),
    ),
    "microwave": Goal(
        prop="microwave",
        value=(-0.75,),
        instructions=OPEN_MICROWAVE,
    ),
    "kettle": Goal(
        prop="kettle",
        value=(-0.23, 0.75, 1.62, 0.99, 0.0, 0.0, -0.06),
        instructions=(
            "move the kettle to the top left burner",
            "put the kettle on the top left burner",
            "place the kettle on the top left burner",
            "bring the kettle over to the top left burner",
        ),
    ),
}

# The right knobs have the goals of the left ones in their row. The reference has no goal of the left door: this value
# is that of RoboHive's environments `FK1_LdoorOpen` (v4).
_FURTHER = {
    "bottom right burner": Goal(
        prop="oven",
        joints=("knob_Joint_1", "bottom_right_burner"),
        value=_ORIGINAL["bottom burner"].value,
        handle="knob_1",
        instructions=(
            "turn on the bottom right burner",
            "switch on the bottom right burner",
            "turn the knob of the bottom right burner",
            "light the bottom right burner of the stove",
        ),
    ),
    "top right burner": Goal(
        prop="oven",
        joints=("knob_Joint_3", "top_right_burner"),
        value=_ORIGINAL["top burner"].value,
        handle="knob_3",
        instructions=(
            "turn on the top right burner",
            "switch on the top right burner",
            "turn the knob of the top right burner",
            "light the top right burner of the stove",
        ),
    ),
    "left hinge cabinet": Goal(
        prop="hinge_cabinet",
        joints=("left_hinge_cabinet",),
        value=(-1.25,),
        handle="left_handle",
        instructions=(
            "open the left door of the hinge cabinet",
            "open the hinge cabinet on its left side",
            "pull the left door of the hinge cabinet open",
            "swing the left door of the hinge cabinet open",
        ),
    ),
}

GOALS: Mapping[str, Goal] = MappingProxyType({**_ORIGINAL, **_FURTHER, **reverse_goals({**_ORIGINAL, **_FURTHER})})
"""The goals of all twenty tasks of the kitchen, by the task's name with spaces."""

# Handles whose sites the hand cannot reach: the left door is moved at the lower end of its bar, and at its edge.
OUT_OF_REACH = frozenset({"left_handle"})

DEFAULT_TASKS = tuple(_ORIGINAL)
"""The default of `tasks_to_complete`: the seven tasks of the reference."""

# Pairs of tasks that cannot be asked together, as a prop would have to be in two positions; with the reason.
_EXCLUSIVE: Mapping[frozenset[str], str] = MappingProxyType(
    {
        **{frozenset(pair): f"{pair[0]!r} undoes {pair[1]!r}" for pair in REVERSES.items()},
        frozenset(("hinge cabinet", "left hinge cabinet")): "the goal of 'hinge cabinet' has the left door closed",
    }
)


def build_goals(tasks: Sequence[str], values: Mapping[str, ArrayLike] | None = None) -> GoalSet:
    """Collects the goals of some tasks of the kitchen; arguments as of `GoalSet.build`.

    Raises:
      TypeError: see `GoalSet.build`.
      ValueError: see `GoalSet.build`; or two of the tasks exclude each other.
    """
    goals = GoalSet.build(GOALS, tasks, values)
    for one, other in itertools.combinations(goals.tasks, 2):
        if reason := _EXCLUSIVE.get(frozenset((one, other))):
            raise ValueError(f"tasks {one!r} and {other!r} cannot be asked together: {reason}")
    return goals
