"""Skills for the kitchen's tasks beyond the reference's seven; their figures were found by search in simulation."""

import math
from collections.abc import Mapping
from types import MappingProxyType

import mink
import numpy as np

from kitchen_suite.policies.experts.kitchen_skills import (
    AT_RESET,
    DOWN,
    FIXED_SKILLS,
    KNOB,
    RIGHT,
    SKILLS,
    STRICT_SKILLS,
    TIP,
    UP,
    carry,
    direction,
    pull,
    push,
    turn_knob,
)
from kitchen_suite.policies.experts.skills import (
    CLOSED,
    OPEN,
    ArcMove,
    HandOrientation,
    Move,
    Prismatic,
    Revolute,
    Skill,
    Vector,
)

# Positions of the left and right knobs along x, and heights of the lower and upper ones [m].
_LEFT, _RIGHT = -0.256, -0.133
_LOW, _HIGH = 2.226, 2.34

_AT_KNOBS = (-0.89, -0.78, 1.25, -2.28, 0.2, 1.46, 2.0)
_AT_LEFT_DOOR = (-1.0, -0.6, 0.6, -1.0, -0.2, 1.5, 1.2)

_LEFT_DOOR = Revolute(elements=(0,), anchor=(-0.984, 0.71, 2.6), axis=UP)


def _turn_knob_back(x: float, height: float, orientation: HandOrientation) -> Skill:
    """Skill that turns a knob back by pushing the lower end of its bar around from the left to the right.

    The finger tips begin above that end, wherever it stands, so the poses do not follow the knob.
    """
    y, lever = 0.65, 0.048
    # From the vertical, to the right.
    angles = np.radians(np.linspace(-55.0, -270.0, 12)).tolist()
    tips: list[Vector] = [(x + lever * math.sin(angle), y, height + lever * math.cos(angle)) for angle in angles]
    free = (tips[0][0], y - 0.06, tips[0][2])
    return Skill(
        moves=push(free, *tips, orientation=orientation, speed=0.07),
        ik_seed=_AT_KNOBS,
        retreat=(0.0, -0.04, 0.0),
    )


def _swing_shut(
    bar: Vector,
    door: Revolute,
    orientation: HandOrientation,
    *,
    opening: float,
    hand_rotation_ratio: float,
    ik_seed: tuple[float, ...],
    retreat: Vector,
) -> Skill:
    """Skill that grasps the upright bar of an open door and swings the door shut.

    Args:
      bar: a point on the bar when the door is closed [m].
      door: its joint.
      orientation: of the hand at the grasp, at the usual opening.
      opening: angle of the door there [rad].
      hand_rotation_ratio: see `ArcMove`.
      ik_seed: see `Skill`.
      retreat: see `Skill`.
    """
    back = mink.SO3.exp(-opening * np.array(door.axis))
    at_closed_door = HandOrientation.from_rotation(back @ orientation.rotation)
    return Skill(
        moves=pull(bar, at_closed_door, ArcMove(angle=0.0, hand_rotation_ratio=hand_rotation_ratio, speed=1.0)),
        ik_seed=ik_seed,
        object_joint=door,
        retreat=retreat,
        release_steps=3,
    )


def _push_left_door(orientation: HandOrientation, free: Vector = (-0.56, 0.42, 2.40)) -> Skill:
    """Skill that pushes the left door, which stands ajar, wide open from behind its edge.

    Args:
      orientation: of the hand.
      free: position of the finger tips before they move behind the door [m].
    """
    height = 2.44
    return Skill(
        moves=push(
            *(free, (-0.60, 0.55, height)),
            *((-0.68, 0.51, height), (-0.77, 0.45, height), (-0.85, 0.37, height)),
            orientation=orientation,
            speed=0.3,
        ),
        ik_seed=_AT_LEFT_DOOR,
        retreat=(0.1, -0.1, 0.0),
    )


def _open_left_door(orientation: HandOrientation, behind: HandOrientation) -> Skill:
    """Skill that opens the left door, most of whose arc is out of reach of a grasp.

    The hand grasps the lower end of the bar with the finger tips, pulls the door ajar, and then pushes it from behind.

    Args:
      orientation: of the hand at the grasp.
      behind: of the hand behind the door.
    """
    bar: Vector = (-0.683, 0.581, 2.46)
    far, near, at = (orientation.standoff_position(bar, distance) for distance in (0.15, 0.09, 0.045))
    aside = behind.standoff_position((-0.70, 0.36, 2.42), TIP)
    moves = (
        Move(position=far, orientation=orientation, fingers=OPEN, in_free_space=True),
        Move(position=near, orientation=orientation, fingers=OPEN),
        Move(position=at, orientation=orientation, fingers=OPEN, speed=0.3),
        Move(position=at, orientation=orientation, fingers=CLOSED, settle_steps=4),
        ArcMove(angle=-0.6, speed=0.6),
        Move(position=aside, orientation=behind, fingers=OPEN, speed=0.2),
    )
    return Skill(
        moves=(*moves, *_push_left_door(behind).moves),
        ik_seed=_AT_LEFT_DOOR,
        object_joint=_LEFT_DOOR,
        retreat=(0.1, -0.1, 0.0),
        release_steps=3,
    )


def _close_left_door(orientation: HandOrientation) -> Skill:
    """Skill that closes the left door: the finger tips drag its edge to the right, and then push its face."""
    height, below = 2.425, 2.40
    return Skill(
        moves=push(
            *((-0.84, 0.26, below), (-0.88, 0.325, height), (-0.87, 0.36, height), (-0.80, 0.42, height)),
            *((-0.72, 0.47, height), (-0.72, 0.36, below), (-0.83, 0.37, below), (-0.835, 0.40, height)),
            *((-0.78, 0.48, height), (-0.72, 0.56, height), (-0.69, 0.63, height), (-0.68, 0.66, height)),
            orientation=orientation,
            speed=0.2,
        ),
        ik_seed=_AT_LEFT_DOOR,
        retreat=(0.05, -0.10, 0.0),
    )


def _skills(orientations: Mapping[str, HandOrientation], *, knob_angle: float) -> Mapping[str, Skill]:
    """Builds the skills by task.

    Args:
      orientations: of the hand, by task.
      knob_angle: target angle of knobs that are turned on [rad].
    """
    skills = {
        "bottom right burner": turn_knob(_LOW, orientations["bottom right burner"], knob_angle, x=_RIGHT),
        "top right burner": turn_knob(_HIGH, orientations["top right burner"], knob_angle, x=_RIGHT),
        "turn off bottom burner": _turn_knob_back(_LEFT, _LOW, orientations["turn off bottom burner"]),
        "turn off top burner": _turn_knob_back(_LEFT, _HIGH, orientations["turn off top burner"]),
        "turn off bottom right burner": _turn_knob_back(_RIGHT, _LOW, orientations["turn off bottom right burner"]),
        "turn off top right burner": _turn_knob_back(_RIGHT, _HIGH, orientations["turn off top right burner"]),
        "left hinge cabinet": _open_left_door(orientations["left hinge cabinet"], orientations["behind left door"]),
        "close left hinge cabinet": _close_left_door(orientations["close left hinge cabinet"]),
        "close hinge cabinet": _swing_shut(
            (-0.526, 0.582, 2.56),
            Revolute(elements=(0,), anchor=(-0.224, 0.71, 2.6), axis=UP),
            orientations["close hinge cabinet"],
            opening=1.45,
            hand_rotation_ratio=-0.15,
            ik_seed=(-0.5, -1.05, 1.3, -1.8, -0.2, 0.93, 1.2),
            retreat=(0.10, -0.10, 0.0),
        ),
        "close microwave": _swing_shut(
            (-0.642, 0.492, 1.87),
            Revolute(elements=(0,), anchor=(-1.1276, 0.455, 1.79), axis=UP),
            orientations["close microwave"],
            opening=-0.75,
            hand_rotation_ratio=-0.2,
            ik_seed=(-1.0, -1.5, 1.95, -1.8, 0.0, 1.4, 1.7),
            retreat=(0.05, -0.10, 0.0),
        ),
        # The hand comes from below, so that it does not touch the bar on its way to the right of it.
        "close slide cabinet": Skill(
            moves=push(
                *((0.40, 0.45, 2.38), (0.40, 0.56, 2.475), (0.39, 0.635, 2.475), (-0.08, 0.635, 2.475)),
                orientation=orientations["close slide cabinet"],
                speed=0.4,
            ),
            ik_seed=(-0.4, -0.83, 0.88, -2.07, 0.8, 1.12, 2.2),
            retreat=(0.0, -0.05, 0.0),
        ),
        "turn off light switch": Skill(
            moves=push(
                *((-0.49, 0.56, 2.28), (-0.485, 0.62, 2.28), (-0.30, 0.62, 2.28)),
                orientation=orientations["turn off light switch"],
                speed=0.6,
            ),
            ik_seed=(-0.87, -0.78, 1.22, -2.15, 1.2, 1.1, 1.6),
            retreat=(0.0, -0.05, 0.0),
        ),
        "return kettle": Skill(
            moves=carry(
                (-0.23, 0.75, 1.879), orientations["return kettle"], lift=0.03, displacement=(-0.04, -0.40, 0.0)
            ),
            ik_seed=(-0.4, -1.18, 2.43, -2.6, -0.1, 1.23, 2.3),
            object_joint=Prismatic(elements=(0, 1, 2), initial_position=(-0.23, 0.75, 1.62)),
            retreat=(0.0, -0.10, 0.0),
            release_steps=4,
        ),
    }
    return MappingProxyType(skills)


_ORIENTATIONS = {
    "bottom right burner": KNOB,
    "top right burner": KNOB,
    "turn off bottom burner": KNOB,
    "turn off top burner": KNOB,
    "turn off bottom right burner": KNOB,
    "turn off top right burner": KNOB,
    "left hinge cabinet": HandOrientation(approach=direction(-50, 35), spread=RIGHT),
    "behind left door": HandOrientation(approach=direction(-50, 35), spread=DOWN),
    "close left hinge cabinet": HandOrientation(approach=direction(-50, 0), spread=DOWN),
    "close hinge cabinet": HandOrientation(approach=direction(-20, 8), spread=RIGHT),
    "close microwave": HandOrientation(approach=direction(-30, -15), spread=RIGHT),
    "close slide cabinet": HandOrientation(approach=direction(-15, -20), spread=DOWN),
    "turn off light switch": HandOrientation(approach=direction(10, -10), spread=RIGHT),
    "return kettle": HandOrientation(approach=direction(20, 0), spread=UP),
}

# An order with short motions between the tasks, in which open doors are in no other task's way.
_ORDER = (
    *("close microwave", "close hinge cabinet", "close left hinge cabinet", "kettle", "return kettle", "microwave"),
    *("bottom burner", "bottom right burner", "turn off bottom burner", "turn off bottom right burner"),
    *("top burner", "top right burner", "turn off top burner", "turn off top right burner"),
    *("slide cabinet", "close slide cabinet", "light switch", "turn off light switch"),
    *("left hinge cabinet", "hinge cabinet"),
)


def _ordered(*tables: Mapping[str, Skill]) -> Mapping[str, Skill]:
    skills = {task: skill for table in tables for task, skill in table.items()}
    return MappingProxyType({task: skills[task] for task in _ORDER})


_FURTHER_SKILLS = _skills(_ORIENTATIONS, knob_angle=-1.3)

# Skills of all tasks; those for strict success; and those in which the hand keeps its orientation at a reset.
ALL_SKILLS = _ordered(SKILLS, _FURTHER_SKILLS)
ALL_STRICT_SKILLS = _ordered(STRICT_SKILLS, _FURTHER_SKILLS)
ALL_FIXED_SKILLS = _ordered(FIXED_SKILLS, _skills(dict.fromkeys(_ORIENTATIONS, AT_RESET), knob_angle=-1.8))

# Angle from which the left door is pushed and no longer pulled open [rad].
_AJAR = -0.35
_AJAR_SKILL = _push_left_door(HandOrientation(approach=direction(-35, 35), spread=DOWN), (-0.52, 0.40, 2.38))


def left_door_skill(door: float) -> Skill | None:
    """Returns the skill that opens the left door of the hinge cabinet where it stands ajar.

    Args:
      door: its angle [rad].

    Returns:
      The skill, or None where the door is nearly closed.
    """
    return _AJAR_SKILL if door < _AJAR else None
