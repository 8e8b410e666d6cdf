"""What the hand does for each of the kitchen's seven tasks: figures found by search in simulation."""

import math
from collections.abc import Mapping
from types import MappingProxyType

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
from kitchen_suite.tasks.kitchen.goals import GOALS

# Directions; the robot looks along y.
_RIGHT: Vector = (1.0, 0.0, 0.0)
_DOWN: Vector = (0.0, 0.0, -1.0)
_UP: Vector = (0.0, 0.0, 1.0)
_BACK: Vector = (0.0, -1.0, 0.0)

# From the hand's site to the tips of the fingers [m].
_TIP = 0.05


def _aim(yaw: float, pitch: float) -> Vector:
    """Direction turned from straight ahead to the right and up [degrees]."""
    yaw, pitch = math.radians(yaw), math.radians(pitch)
    return math.sin(yaw) * math.cos(pitch), math.cos(yaw) * math.cos(pitch), math.sin(pitch)


def _push(*tips: Vector, hand: HandOrientation, fingers: float = CLOSED, speed: float) -> tuple[Move, ...]:
    """Moves that bring the finger tips before a thing, to it, and then on from place to place."""
    before, start, *rest = (hand.before(tip, _TIP) for tip in tips)
    return (
        Move(to=before, hand=hand, fingers=fingers, free=True),
        Move(to=start, hand=hand, fingers=fingers),
        *(Move(to=place, hand=hand, fingers=fingers, speed=speed) for place in rest),
    )


def _knob(task: str, height: float) -> Skill:
    """Turns the knob at a height [m]: the upper end of its bar is pushed to the right."""
    # From the middle of the bar to the finger tips, left of its upper end [m].
    reach, x, y = 0.03, -0.256, 0.65
    tip = (x - reach, y, height + reach)
    before = (x - reach, y - 0.06, height + reach)
    # The knob is damped: the path runs ahead of it, and stops where the goal is passed.
    return Skill(
        steps=(
            *_push(before, tip, hand=HandOrientation(approach=_aim(4, -22), spread=_DOWN), speed=1.0),
            ArcMove(to=-1.3, speed=1.5),
        ),
        posture=(-0.89, -0.78, 1.25, -2.28, 0.2, 1.46, 2.0),
        thing=Revolute(elements=GOALS[task].elements[:1], about=(x, y, height), axis=_BACK),
        retreat=(0.0, -0.04, 0.0),
    )


def _pull(bar: Vector, hand: HandOrientation, swing: ArcMove) -> tuple[Move | ArcMove, ...]:
    """Takes an upright bar between the fingers and leads it round its door's hinge."""
    far, near, at = (hand.before(bar, distance) for distance in (0.13, 0.08, 0.01))
    return (
        Move(to=far, hand=hand, fingers=OPEN, free=True),
        Move(to=near, hand=hand, fingers=OPEN),
        Move(to=at, hand=hand, fingers=OPEN),
        Move(to=at, hand=hand, fingers=CLOSED, settle=4),
        swing,
    )


# In the order that makes the way of the hand short.
SKILLS: Mapping[str, Skill] = MappingProxyType(
    {
        # Two fingers side by side, low down: one alone would turn it, and high up it would fall.
        "kettle": Skill(
            steps=_push(
                (-0.275, 0.150, 1.70),
                (-0.275, 0.205, 1.70),
                (-0.275, 0.360, 1.70),
                (-0.260, 0.620, 1.70),
                hand=HandOrientation(approach=_aim(15, -15), spread=_RIGHT),
                fingers=OPEN,
                speed=0.5,
            ),
            posture=(-0.40, -1.18, 2.43, -2.6, -0.1, 1.23, 2.3),
            thing=Prismatic(elements=GOALS["kettle"].elements[:3], start=(-0.269, 0.35, 1.62)),
            retreat=(0.0, -0.05, 0.05),
        ),
        # The hand comes from the right, so that the right finger hooks behind the bar.
        "microwave": Skill(
            steps=_pull(
                (-0.642, 0.492, 1.87),
                HandOrientation(approach=_aim(-30, -15), spread=_RIGHT),
                ArcMove(to=-1.0, twist=-0.2, speed=1.0),
            ),
            posture=(-1.0, -1.5, 1.95, -1.8, 0.0, 1.4, 1.7),
            thing=Revolute(elements=GOALS["microwave"].elements, about=(-1.1276, 0.455, 1.79), axis=_UP),
            retreat=(0.05, -0.10, 0.0),
            release=3,
        ),
        "bottom burner": _knob("bottom burner", 2.226),
        "top burner": _knob("top burner", 2.34),
        "slide cabinet": Skill(
            steps=_push(
                (-0.185, 0.565, 2.475),
                (-0.160, 0.635, 2.475),
                (0.280, 0.635, 2.475),
                hand=HandOrientation(approach=_aim(0, -20), spread=_DOWN),
                speed=0.8,
            ),
            posture=(-0.83, -0.83, 0.88, -2.07, 0.8, 1.12, 2.2),
            thing=Prismatic(elements=GOALS["slide cabinet"].elements, start=(0.0,)),
            retreat=(0.0, -0.05, 0.0),
        ),
        "light switch": Skill(
            steps=_push(
                (-0.310, 0.560, 2.28),
                (-0.315, 0.620, 2.28),
                (-0.500, 0.620, 2.28),
                hand=HandOrientation(approach=_aim(-10, -10), spread=_RIGHT),
                speed=0.6,
            ),
            posture=(-0.87, -0.78, 1.22, -2.15, 1.2, 1.1, 1.6),
            retreat=(0.0, -0.05, 0.0),
        ),
        # The hand comes from the left, so that the left finger hooks behind the bar; the bar turns between the fingers.
        "hinge cabinet": Skill(
            steps=_pull(
                (-0.526, 0.582, 2.56),
                HandOrientation(approach=_aim(10, 8), spread=_RIGHT),
                ArcMove(to=1.45, twist=-0.15, speed=1.0),
            ),
            posture=(-1.18, -1.05, 1.3, -1.35, -0.2, 0.93, 1.2),
            thing=Revolute(elements=GOALS["hinge cabinet"].elements[1:], about=(-0.224, 0.71, 2.6), axis=_UP),
            retreat=(0.10, -0.10, 0.0),
            release=3,
        ),
    }
)
