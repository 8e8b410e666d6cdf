"""The goals of the kitchen's props: the seven of the reference, three like them, and ten that undo these."""

import itertools
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from dm_control import mjcf
from numpy.typing import ArrayLike, NDArray

from kitchen_suite.entities import KITCHEN_FRANKA, Scene
from kitchen_suite.entities.joints import addresses
from kitchen_suite.entities.robot import Robot
from kitchen_suite.kitchen_tasks import DEFAULT_TASKS, FURTHER_TASKS, REVERSES
from kitchen_suite.tasks.goals import OPEN_MICROWAVE, Goal, GoalSet
from kitchen_suite.tasks.kitchen.observed_props import OBJECT_STARTS, OBSERVED_PROPS
from kitchen_suite.types import Array

INITIAL_QPOS = np.array([*KITCHEN_FRANKA.home.values(), *OBJECT_STARTS])


def initial_qpos(robot: Robot) -> Array:
    """Returns the positions of robot and objects at the start of an episode [rad, m, quaternion]."""
    return np.array([*robot.home, *OBJECT_STARTS])


class Start(NamedTuple):
    """Where the joints of a goal start an episode.

    Attributes:
      prop: name of the prop.
      columns: `(k,)`, indices in qpos.
      positions: `(k,)`, positions at the start [rad, m, quaternion].
      low: `(k,)`, least positions to which variations of the start may displace the joints.
      high: `(k,)`, greatest ones.
    """

    prop: str
    columns: NDArray[np.int64]
    positions: Array
    low: Array
    high: Array

    def allows(self, qpos: Array) -> bool:
        """Whether the joints are within their bounds."""
        positions = qpos[self.columns]
        return bool(((self.low <= positions) & (positions <= self.high)).all())


def starts(goals: GoalSet, scene: Scene, physics: mjcf.Physics) -> dict[str, Start]:
    """Returns the starts of the goals that have one, by task; hinges and slides start within their ranges."""
    found: dict[str, Start] = {}
    for task, goal in zip(goals.tasks, goals.goals, strict=True):
        if goal.start is None:
            continue
        joints, positions = goal.joints_in(scene), np.array(goal.start)
        columns, _ = addresses(physics, joints)
        if len(joints) == positions.size:
            low, high = physics.bind(joints).range.T
            positions = np.clip(positions, low, high)
        else:
            # A kettle that starts on a burner stays on it: half of the distance between burners [m].
            reach = np.array([0.2] * 3 + [np.inf] * 4)
            low, high = positions - reach, positions + reach
        found[task] = Start(goal.prop, columns, positions, low, high)
    return found


def _burner(position: str, knob: int) -> Goal:
    """Returns the goal that turns a burner on, such as the `bottom left` one."""
    return Goal(
        prop="oven",
        joints=(f"knob_Joint_{knob}", f"{position.replace(' ', '_')}_burner"),
        value=(-0.88 if position.startswith("bottom") else -0.92, -0.01),
        handle=f"knob_{knob}",
        instructions=(
            f"turn on the {position} burner",
            f"switch on the {position} burner",
            f"turn the knob of the {position} burner",
            f"light the {position} burner of the stove",
        ),
    )


def _burner_off(position: str) -> tuple[str, ...]:
    return (
        f"turn off the {position} burner",
        f"switch off the {position} burner",
        f"turn the knob of the {position} burner back",
        f"put out the {position} burner of the stove",
    )


def _hinge_door(side: str, verb: str, pull: str, end: str) -> tuple[str, ...]:
    """Returns instructions that open or close a door of the hinge cabinet."""
    return (
        f"{verb} the {side} door of the hinge cabinet",
        f"{verb} the hinge cabinet on its {side} side",
        f"{pull} the {side} door of the hinge cabinet {end}",
        f"swing the {side} door of the hinge cabinet {end}",
    )


# Distance below which a task counts as complete, over all joints of the task together [rad, m]; as in the reference.
THRESHOLD = 0.3

# The values are those of gymnasium-robotics 1.4.2. The right knobs have the goals of the left ones in their row. The
# reference has no goal of the left door: this value is that of RoboHive's environments `FK1_LdoorOpen` (v4).
_FORWARD = {
    "bottom burner": _burner("bottom left", 2),
    "top burner": _burner("top left", 4),
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
        instructions=_hinge_door("right", "open", "pull", "open"),
    ),
    "microwave": Goal(prop="microwave", value=(-0.75,), instructions=OPEN_MICROWAVE),
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
    "bottom right burner": _burner("bottom right", 1),
    "top right burner": _burner("top right", 3),
    "left hinge cabinet": Goal(
        prop="hinge_cabinet",
        joints=("left_hinge_cabinet",),
        value=(-1.25,),
        handle="left_handle",
        instructions=_hinge_door("left", "open", "pull", "open"),
    ),
}

# Instructions of the tasks that undo these.
_REVERSE_INSTRUCTIONS = {
    "close microwave": (
        "close the microwave door",
        "close the microwave",
        "push the door of the microwave shut",
        "swing the microwave door shut",
    ),
    "close slide cabinet": (
        "close the slide cabinet",
        "slide the cabinet door shut",
        "slide the door of the cabinet to the left",
        "push the sliding door of the cabinet shut",
    ),
    "close hinge cabinet": _hinge_door("right", "close", "push", "shut"),
    "close left hinge cabinet": _hinge_door("left", "close", "push", "shut"),
    "turn off light switch": (
        "turn off the light switch",
        "switch off the light",
        "flip the light switch on the hood back",
        "turn off the light above the stove",
    ),
    "return kettle": (
        "move the kettle back to the bottom left burner",
        "put the kettle back on the bottom left burner",
        "place the kettle on the bottom left burner",
        "return the kettle to the bottom left burner",
    ),
    "turn off bottom burner": _burner_off("bottom left"),
    "turn off top burner": _burner_off("top left"),
    "turn off bottom right burner": _burner_off("bottom right"),
    "turn off top right burner": _burner_off("top right"),
}


def _reverse(task: str) -> Goal:
    """Returns the goal that undoes another one: it starts there, and leads to the initial state."""
    forward = _FORWARD[REVERSES[task]]
    # The goal of `hinge cabinet` is for both of its doors, of which the right one comes last.
    joints = ("right_hinge_cabinet",) if task == "close hinge cabinet" else forward.joints
    starts_by_joint = {joint.name: joint.start for joint in OBSERVED_PROPS[forward.prop]}
    value = tuple(number for name in joints or starts_by_joint for number in starts_by_joint[name])
    return Goal(
        prop=forward.prop,
        joints=joints,
        value=value,
        start=forward.value[-len(value) :],
        handle=forward.handle,
        instructions=_REVERSE_INSTRUCTIONS[task],
    )


_ALL = {**_FORWARD, **{task: _reverse(task) for task in REVERSES}}

GOALS: Mapping[str, Goal] = MappingProxyType({name: _ALL[name] for name in (*DEFAULT_TASKS, *FURTHER_TASKS)})
"""The goals of all twenty tasks of the kitchen, by the task's name with spaces."""

# Handles whose sites the hand cannot reach: the left door is moved at the lower end of its bar, and at its edge.
OUT_OF_REACH = frozenset({"left_handle"})

# Pairs of tasks that cannot be requested together, as a prop would have to be in two positions; with the reason.
_EXCLUSIVE: Mapping[frozenset[str], str] = MappingProxyType(
    {
        **{frozenset(pair): f"{pair[0]!r} undoes {pair[1]!r}" for pair in REVERSES.items()},
        frozenset(("hinge cabinet", "left hinge cabinet")): "the goal of 'hinge cabinet' has the left door closed",
    }
)


def build_goals(tasks: Sequence[str], values: Mapping[str, ArrayLike] | None = None) -> GoalSet:
    """Collects the goals of tasks as `GoalSet.build` does; raises a ValueError if two of them exclude each other."""
    goals = GoalSet.build(GOALS, tasks, values)
    for one, other in itertools.combinations(goals.tasks, 2):
        if reason := _EXCLUSIVE.get(frozenset((one, other))):
            raise ValueError(f"tasks {one!r} and {other!r} cannot be asked together: {reason}")
    return goals
