"""What the hand does for each of the kitchen's seven tasks."""

import math
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from kitchen_suite.experts.skills import CLOSED, DOWN, LEFT, OPEN, RIGHT, Hinge, Move, Skill, Slide, Swing, Vector

# From the site between the fingers to their tips [m].
_TIP = 0.05


def _aim(yaw: float, pitch: float) -> Vector:
    """Direction that is turned from straight ahead to the right and up [degrees]."""
    yaw, pitch = math.radians(yaw), math.radians(pitch)
    return math.sin(yaw) * math.cos(pitch), math.cos(yaw) * math.cos(pitch), math.sin(pitch)


def _back(point: Vector, approach: Vector, distance: float) -> Vector:
    """Where the site is to be so that a point lies so far before it [m]."""
    x, y, z = np.array(point) - distance * np.array(approach)
    return float(x), float(y), float(z)


def _push(*tips: Vector, approach: Vector, spread: Vector, fingers: float = CLOSED, speed: float) -> tuple[Move, ...]:
    """Brings the finger tips before something, to it, and then slowly along a line of places."""
    places = [_back(tip, approach, _TIP) for tip in tips]
    before, start, *rest = (
        Move(to=place, approach=approach, spread=spread, fingers=fingers) for place in places
    )
    return (
        dataclasses_replace(before, free=True),
        start,
        *(dataclasses_replace(move, speed=speed) for move in rest),
    )


def _knob(height: float) -> Skill:
    """Turns a knob of the oven by the upper end of its bar, from the left."""
    approach = _aim(7, -22)
    hinge_point = (-0.256, 0.65, height)
    start = (-0.256 - 0.036, 0.65, height + 0.036)
    place = _back(start, approach, _TIP)
    before = _back((start[0], start[1] - 0.06, start[2]), approach, _TIP)
    element = {2.226: 2, 2.34: 6}[height]
    return Skill(
        steps=(
            Move(to=before, approach=approach, spread=DOWN, free=True),
            Move(to=place, approach=approach, spread=DOWN),
            Swing(to=-1.3, twist=0.0, speed=1.6),
        ),
        posture=(-0.89, -0.78, 1.25, -2.28, 0.2, 1.46, 2.0),
        thing=Hinge(element=element, about=hinge_point, axis=(0.0, -1.0, 0.0)),
        retreat=(0.0, -0.04, 0.0),
    )


def _grasp(bar, approach, spread, depth, swing, posture, hinge, retreat):
    before, at = _back(bar, approach, 0.11), _back(bar, approach, depth)
    hand = {"approach": approach, "spread": spread}
    return Skill(
        steps=(
            Move(to=before, fingers=OPEN, free=True, **hand),
            Move(to=at, fingers=OPEN, **hand),
            Move(to=at, fingers=CLOSED, settle=3, **hand),
            swing,
        ),
        posture=posture,
        thing=hinge,
        retreat=retreat,
        release=3,
    )


import dataclasses

dataclasses_replace = dataclasses.replace

SKILLS: Mapping[str, Skill] = MappingProxyType(
    {
        "kettle": Skill(
            steps=_push(
                (-0.27, 0.175, 1.71), (-0.27, 0.205, 1.71), (-0.27, 0.36, 1.71), (-0.25,.62, 1.71),
                approach=_aim(15, -29), spread=RIGHT, fingers=OPEN, speed=0.5,
            ),
            posture=(-0.40, -1.18, 2.43, -2.6, -0.1, 1.23, 2.3),
            thing=Slide(elements=(14, 15, 16), start=(-0.269, 0.35, 1.62)),
            retreat=(0.0, -0.05, 0.05),
        ),
        "microwave": _grasp(
            (-0.642, 0.492, 1.88), _aim(-18, -10), RIGHT, 0.02,
            Swing(to=-1.0, twist=0.2, speed=1.0),
            (-1.0, -1.5, 1.95, -1.8, 0.0, 1.4, 1.7),
            Hinge(element=13, about=(-1.1276, 0.455, 1.79), axis=(0.0, 0.0, 1.0)),
            (0.05, -0.10, 0.0),
        ),
        "bottom burner": _knob(2.226),
        "top burner": _knob(2.34),
        "slide cabinet": Skill(
            steps=_push(
                (-0.185, 0.565, 2.475), (-0.16, 0.635, 2.475), (0.0, 0.635, 2.475), (0.28, 0.635, 2.475),
                approach=_aim(0, -20), spread=DOWN, speed=0.8,
            ),
            posture=(-0.83, -0.83, 0.88, -2.07, 0.8, 1.12, 2.2),
            thing=Slide(elements=(10,), start=(0.0,)),
            retreat=(0.0, -0.05, 0.0),
        ),
        "light switch": Skill(
            steps=_push(
                (-0.315, 0.575, 2.28), (-0.315, 0.62, 2.28), (-0.50, 0.62, 2.28),
                approach=_aim(-10, -10), spread=RIGHT, speed=0.6,
            ),
            posture=(-0.87, -0.78, 1.22, -2.15, 1.2, 1.1, 1.6),
            retreat=(0.0, -0.05, 0.0),
        ),
        "hinge cabinet": _grasp(
            (-0.526, 0.582, 2.55), _aim(8, 8), RIGHT, 0.02,
            Swing(to=1.45, twist=0.1, speed=1.0),
            (-1.18, -1.05, 1.3, -1.35, -0.2, 0.93, 1.2),
            Hinge(element=12, about=(-0.224, 0.71, 2.6), axis=(0.0, 0.0, 1.0)),
            (0.05, -0.10, 0.0),
        ),
    }
)

# In which order to do them: the hand's way is short.
ORDER = tuple(SKILLS)
