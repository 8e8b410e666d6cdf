"""Skills for the seven tasks of the reference in the kitchen; their figures were found by search in simulation."""

import dataclasses
import math
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

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

# Directions in the world; the robot faces y.
RIGHT: Vector = (1.0, 0.0, 0.0)
DOWN: Vector = (0.0, 0.0, -1.0)
UP: Vector = (0.0, 0.0, 1.0)
BACK: Vector = (0.0, -1.0, 0.0)

# Distance from the hand's site to the finger tips [m].
TIP = 0.05


def direction(yaw: float, pitch: float) -> Vector:
    """Unit vector straight ahead, turned to the right by yaw and up by pitch [degrees]."""
    yaw, pitch = math.radians(yaw), math.radians(pitch)
    return math.sin(yaw) * math.cos(pitch), math.cos(yaw) * math.cos(pitch), math.sin(pitch)


def push(*tips: Vector, orientation: HandOrientation, fingers: float = CLOSED, speed: float) -> tuple[Move, ...]:
    """Moves that bring the finger tips to positions [m]: in free space, at the object, and then along the push."""
    free, start, *rest = (orientation.standoff_position(tip, TIP) for tip in tips)
    return (
        Move(position=free, orientation=orientation, fingers=fingers, in_free_space=True),
        Move(position=start, orientation=orientation, fingers=fingers),
        *(Move(position=position, orientation=orientation, fingers=fingers, speed=speed) for position in rest),
    )


def pull(bar: Vector, orientation: HandOrientation, arc: ArcMove) -> tuple[Move | ArcMove, ...]:
    """Moves that grasp the upright bar of a door and swing the door open."""
    far, near, at = (orientation.standoff_position(bar, distance) for distance in (0.13, 0.08, 0.01))
    return (
        Move(position=far, orientation=orientation, fingers=OPEN, in_free_space=True),
        Move(position=near, orientation=orientation, fingers=OPEN),
        Move(position=at, orientation=orientation, fingers=OPEN),
        Move(position=at, orientation=orientation, fingers=CLOSED, settle_steps=4),
        arc,
    )


def carry(bar: Vector, orientation: HandOrientation, *, lift: float, displacement: Vector) -> tuple[Move, ...]:
    """Moves that grasp a level bar, lift it [m] and carry it along a displacement [m]."""
    far, near, at = (orientation.standoff_position(bar, distance) for distance in (0.15, 0.09, 0.01))
    up = (at[0], at[1], at[2] + lift)
    to = (up[0] + displacement[0], up[1] + displacement[1], up[2] + displacement[2])
    return (
        Move(position=far, orientation=orientation, fingers=OPEN, in_free_space=True),
        Move(position=near, orientation=orientation, fingers=OPEN),
        Move(position=at, orientation=orientation, fingers=OPEN),
        Move(position=at, orientation=orientation, fingers=CLOSED, settle_steps=5),
        Move(position=up, orientation=orientation, fingers=CLOSED),
        Move(position=to, orientation=orientation, fingers=CLOSED, speed=0.4),
    )


def turn_knob(height: float, orientation: HandOrientation, angle: float, *, x: float = -0.256) -> Skill:
    """Skill that turns the knob at a height [m] by pushing the upper end of its bar to the right, to an angle [rad]."""
    # Centre of the bar, and distance to the left of it and above it at which the finger tips push its upper end [m].
    y, lever = 0.65, 0.03
    tip = (x - lever, y, height + lever)
    free = (x - lever, y - 0.06, height + lever)
    return Skill(
        moves=(
            *push(free, tip, orientation=orientation, speed=1.0),
            ArcMove(angle=angle, speed=1.5),
        ),
        ik_seed=(-0.89, -0.78, 1.25, -2.28, 0.2, 1.46, 2.0),
        object_joint=Revolute(elements=(0,), anchor=(x, y, height), axis=BACK),
        retreat=(0.0, -0.04, 0.0),
    )


def _skills(orientations: Mapping[str, HandOrientation], *, knob_angle: float) -> Mapping[str, Skill]:
    """Builds the skills by task, in an order with short motions between the tasks.

    Args:
      orientations: of the hand, by task.
      knob_angle: target angle of the knobs [rad]. They are damped and lag behind the hand, so it is beyond the goal.
    """
    skills = {
        # Two fingers side by side, low on the kettle: one finger would turn it, a push high up would tip it over.
        "kettle": Skill(
            moves=push(
                (-0.275, 0.150, 1.70),
                (-0.275, 0.205, 1.70),
                (-0.275, 0.360, 1.70),
                (-0.260, 0.620, 1.70),
                orientation=orientations["kettle"],
                fingers=OPEN,
                speed=0.5,
            ),
            ik_seed=(-0.40, -1.18, 2.43, -2.6, -0.1, 1.23, 2.3),
            object_joint=Prismatic(elements=(0, 1, 2), initial_position=(-0.269, 0.35, 1.62)),
            retreat=(0.0, -0.05, 0.05),
        ),
        # The hand comes from the right, so that the right finger hooks behind the bar.
        "microwave": Skill(
            moves=pull(
                (-0.642, 0.492, 1.87),
                orientations["microwave"],
                ArcMove(angle=-1.0, hand_rotation_ratio=-0.2, speed=1.0),
            ),
            ik_seed=(-1.0, -1.5, 1.95, -1.8, 0.0, 1.4, 1.7),
            object_joint=Revolute(elements=(0,), anchor=(-1.1276, 0.455, 1.79), axis=UP),
            retreat=(0.05, -0.10, 0.0),
            release_steps=3,
        ),
        "bottom burner": turn_knob(2.226, orientations["bottom burner"], knob_angle),
        "top burner": turn_knob(2.34, orientations["top burner"], knob_angle),
        "slide cabinet": Skill(
            moves=push(
                (-0.185, 0.565, 2.475),
                (-0.160, 0.635, 2.475),
                (0.280, 0.635, 2.475),
                orientation=orientations["slide cabinet"],
                speed=0.8,
            ),
            ik_seed=(-0.83, -0.83, 0.88, -2.07, 0.8, 1.12, 2.2),
            object_joint=Prismatic(elements=(0,), initial_position=(0.0,)),
            retreat=(0.0, -0.05, 0.0),
        ),
        "light switch": Skill(
            moves=push(
                (-0.310, 0.560, 2.28),
                (-0.315, 0.620, 2.28),
                (-0.500, 0.620, 2.28),
                orientation=orientations["light switch"],
                speed=0.6,
            ),
            ik_seed=(-0.87, -0.78, 1.22, -2.15, 1.2, 1.1, 1.6),
            retreat=(0.0, -0.05, 0.0),
        ),
        # The hand comes from the left, so that the left finger hooks behind the bar; the bar turns between the fingers.
        "hinge cabinet": Skill(
            moves=pull(
                (-0.526, 0.582, 2.56),
                orientations["hinge cabinet"],
                ArcMove(angle=1.45, hand_rotation_ratio=-0.15, speed=1.0),
            ),
            ik_seed=(-1.18, -1.05, 1.3, -1.35, -0.2, 0.93, 1.2),
            object_joint=Revolute(elements=(1,), anchor=(-0.224, 0.71, 2.6), axis=UP),
            retreat=(0.10, -0.10, 0.0),
            release_steps=3,
        ),
    }
    return MappingProxyType(skills)


KNOB = HandOrientation(approach=direction(4, -22), spread=DOWN)

SKILLS = _skills(
    {
        "kettle": HandOrientation(approach=direction(15, -15), spread=RIGHT),
        "microwave": HandOrientation(approach=direction(-30, -15), spread=RIGHT),
        "bottom burner": KNOB,
        "top burner": KNOB,
        "slide cabinet": HandOrientation(approach=direction(0, -20), spread=DOWN),
        "light switch": HandOrientation(approach=direction(-10, -10), spread=RIGHT),
        "hinge cabinet": HandOrientation(approach=direction(10, 8), spread=RIGHT),
    },
    knob_angle=-1.3,
)

# Skills for strict success: the kettle is pushed straighter, and as far as its goal.
_AT_KETTLE = HandOrientation(approach=direction(7, -15), spread=RIGHT)

STRICT_SKILLS = MappingProxyType(
    {
        **SKILLS,
        "kettle": dataclasses.replace(
            SKILLS["kettle"],
            moves=push(
                (-0.300, 0.150, 1.70),
                (-0.300, 0.205, 1.70),
                (-0.300, 0.360, 1.70),
                (-0.290, 0.655, 1.70),
                orientation=_AT_KETTLE,
                fingers=OPEN,
                speed=0.5,
            ),
        ),
    }
)

# The hand's orientation at a reset: 4 degrees to the right, 3 degrees up.
AT_RESET = HandOrientation(approach=(0.0735, 0.9960, 0.0517), spread=(0.9967, -0.0752, 0.0319))

# Skills in which the hand keeps its orientation at a reset. Then the fingers are side by side and push a knob less far.
FIXED_SKILLS = MappingProxyType(
    {
        task: skill.with_orientation(AT_RESET)
        for task, skill in _skills(dict.fromkeys(SKILLS, AT_RESET), knob_angle=-1.8).items()
    }
)


# The hand comes from the left; pushes would have to come from the right, around the kettle.
_FROM_LEFT = HandOrientation(approach=direction(49, -1), spread=UP)


def _carry_skill(ik_seed: tuple[float, ...], displacement: Vector) -> Skill:
    """Skill that carries the kettle by its handle along a displacement [m]."""
    return Skill(
        moves=carry((-0.269, 0.35, 1.879), _FROM_LEFT, lift=0.02, displacement=displacement),
        ik_seed=ik_seed,
        object_joint=Prismatic(elements=(0, 1, 2), initial_position=(-0.269, 0.35, 1.62)),
        retreat=(-0.07, -0.07, 0.0),
        release_steps=4,
    )


# Skills for a kettle on one of the right burners, from near to far.
KETTLE_SKILLS = (
    _carry_skill((-1.09, -1.12, 2.46, -2.96, -0.98, 0.93, 1.76), (-0.36, 0.36, 0.0)),
    _carry_skill((-1.97, -1.70, 1.85, -1.88, -0.56, 1.36, 0.79), (-0.38, -0.03, 0.0)),
)

# The kettle is on one of the right burners if its x is beyond this, and on the far one if its y is too [m].
_RIGHT_BURNERS, _FAR_BURNER = -0.05, 0.57


def kettle_skill(position: NDArray[np.float64]) -> Skill | None:
    """Returns the skill for a kettle at a position `(3,)` on a right burner [m]; None on the left."""
    if position[0] <= _RIGHT_BURNERS:
        return None
    return KETTLE_SKILLS[int(position[1] > _FAR_BURNER)]


# Angle from which the right door of the hinge cabinet is in the way of the hand [rad].
_IN_THE_WAY = 0.2

# A place of the hand to the right of that door and below it [m].
_BESIDE_DOOR = (0.0, 0.40, 2.33)


def slide_skill_beside_door(skill: Skill, door: float) -> Skill | None:
    """Returns a skill for the slide cabinet that goes round the open right door of the hinge cabinet.

    Args:
      skill: of the slide cabinet, for a closed door.
      door: angle of that door [rad].

    Returns:
      The skill, or None where the door is not in the way.
    """
    if door < _IN_THE_WAY:
        return None
    first = next(move for move in skill.moves if isinstance(move, Move))
    return dataclasses.replace(skill, moves=(dataclasses.replace(first, position=_BESIDE_DOOR), *skill.moves))
