"""Motions of the hand that skills for the kitchen are made of."""

import math

from kitchen_suite.policies.experts.skills import (
    CLOSED,
    OPEN,
    ArcMove,
    HandOrientation,
    Move,
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
