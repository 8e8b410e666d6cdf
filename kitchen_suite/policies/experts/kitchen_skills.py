"""Skills for the kitchen's tasks, in one table by task; their figures were found by search in simulation."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType

import mink
import numpy as np

from kitchen_suite.kitchen_tasks import DEFAULT_TASKS
from kitchen_suite.policies.experts.skills import (
    CLOSED,
    OPEN,
    UNLIMITED,
    ArcMove,
    HandOrientation,
    Move,
    Prismatic,
    Revolute,
    Skill,
)
from kitchen_suite.types import Array, Vector

# Directions in the world; the robot faces y.
RIGHT: Vector = (1.0, 0.0, 0.0)
DOWN: Vector = (0.0, 0.0, -1.0)
UP: Vector = (0.0, 0.0, 1.0)
BACK: Vector = (0.0, -1.0, 0.0)

TIP = 0.05  # Distance from the hand's site to the finger tips [m].


def direction(yaw: float, pitch: float) -> Vector:
    """Unit vector straight ahead, turned to the right by yaw and up by pitch [degrees]."""
    yaw, pitch = math.radians(yaw), math.radians(pitch)
    return math.sin(yaw) * math.cos(pitch), math.cos(yaw) * math.cos(pitch), math.sin(pitch)


def push(
    tips: Sequence[Vector], orientation: HandOrientation, *, fingers: float = CLOSED, speed: float
) -> tuple[Move, ...]:
    """Moves that bring the finger tips to positions [m]: in free space, at the object, and then along the push."""
    free, start, *rest = (orientation.standoff_position(tip, TIP) for tip in tips)
    return (
        Move(position=free, orientation=orientation, fingers=fingers, in_free_space=True),
        Move(position=start, orientation=orientation, fingers=fingers),
        *(Move(position=position, orientation=orientation, fingers=fingers, speed=speed) for position in rest),
    )


def grasp(
    bar: Vector, orientation: HandOrientation, distances: Vector, *, settle_steps: int, speed: float = UNLIMITED
) -> tuple[Move, ...]:
    """Moves that bring the open hand to a point on a bar [m], in free space at first, and close the fingers around it.

    The site's distances from the point are those far from it, near it and at the grasp [m]. The speed limit is that of
    the last motion [m/s]; the fingers close in `settle_steps` control steps.
    """
    far, near, at = (orientation.standoff_position(bar, distance) for distance in distances)
    return (
        Move(position=far, orientation=orientation, fingers=OPEN, in_free_space=True),
        Move(position=near, orientation=orientation, fingers=OPEN),
        Move(position=at, orientation=orientation, fingers=OPEN, speed=speed),
        Move(position=at, orientation=orientation, fingers=CLOSED, settle_steps=settle_steps),
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Door:
    """A door that the hand swings by its upright bar.

    Attributes:
      bar: a point on the bar when the door is closed [m].
      anchor: a point on the hinges' axis, in the world [m].
      hand_rotation_ratio: see `ArcMove`.
      retreat: see `Skill`.
    """

    bar: Vector
    anchor: Vector
    hand_rotation_ratio: float
    retreat: Vector

    def opened(
        self, angle: float, orientation: HandOrientation, ik_seed: tuple[float, ...], *, element: int = 0
    ) -> Skill:
        """Skill that grasps the bar of the closed door and swings the door open to an angle [rad].

        The orientation is that of the hand at the grasp. `element` is the index of the door's angle among the positions
        of the joints of the task's goal.
        """
        moves = grasp(self.bar, orientation, (0.13, 0.08, 0.01), settle_steps=4)
        return Skill(
            moves=(*moves, ArcMove(angle=angle, hand_rotation_ratio=self.hand_rotation_ratio, speed=1.0)),
            ik_seed=ik_seed,
            object_joint=Revolute(elements=(element,), anchor=self.anchor, axis=UP),
            retreat=self.retreat,
            release_steps=3,
        )

    def shut(self, opening: float, orientation: HandOrientation, ik_seed: tuple[float, ...]) -> Skill:
        """Skill that grasps the bar of the door at its usual opening [rad] and swings the door shut.

        The orientation is that of the hand at the grasp, at that opening.
        """
        back = mink.SO3.exp(-opening * np.array(UP))
        return self.opened(0.0, HandOrientation.from_rotation(back @ orientation.rotation), ik_seed)


# Positions of the left and right knobs along x, of all along y, and heights of the lower and upper ones [m].
_LEFT, _RIGHT, _Y, _LOW, _HIGH = -0.256, -0.133, 0.65, 2.226, 2.34

# Joint positions from which inverse kinematics starts [rad].
_AT_KNOBS = (-0.89, -0.78, 1.25, -2.28, 0.2, 1.46, 2.0)
_AT_LEFT_DOOR = (-1.0, -0.6, 0.6, -1.0, -0.2, 1.5, 1.2)

_AT_KETTLE = (-0.4, -1.18, 2.43, -2.6, -0.1, 1.23, 2.3)
_AT_MICROWAVE = (-1.0, -1.5, 1.95, -1.8, 0.0, 1.4, 1.7)

_MICROWAVE = Door(
    bar=(-0.642, 0.492, 1.87), anchor=(-1.1276, 0.455, 1.79), hand_rotation_ratio=-0.2, retreat=(0.05, -0.10, 0.0)
)
_HINGE_CABINET = Door(
    bar=(-0.526, 0.582, 2.56), anchor=(-0.224, 0.71, 2.6), hand_rotation_ratio=-0.15, retreat=(0.10, -0.10, 0.0)
)


def _kettle(x: float, y: float) -> Prismatic:
    """The joint of a kettle that stands at x and y at the start [m]."""
    return Prismatic(elements=(0, 1, 2), initial_position=(x, y, 1.62))


def _carry_kettle(
    x: float,
    y: float,
    orientation: HandOrientation,
    ik_seed: tuple[float, ...],
    *,
    lift: float,
    displacement: Vector,
    retreat: Vector,
) -> Skill:
    """Skill that grasps the handle of a kettle that stands at x and y, lifts it and carries it [m]."""
    moves = grasp((x, y, 1.879), orientation, (0.15, 0.09, 0.01), settle_steps=5)
    hand_x, hand_y, hand_z = moves[-1].position
    up = (hand_x, hand_y, hand_z + lift)
    to = (up[0] + displacement[0], up[1] + displacement[1], up[2] + displacement[2])
    return Skill(
        moves=(
            *moves,
            Move(position=up, orientation=orientation, fingers=CLOSED),
            Move(position=to, orientation=orientation, fingers=CLOSED, speed=0.4),
        ),
        ik_seed=ik_seed,
        object_joint=_kettle(x, y),
        retreat=retreat,
        release_steps=4,
    )


def turn_knob(x: float, height: float, orientation: HandOrientation, angle: float) -> Skill:
    """Skill that turns the knob at x and a height [m] by pushing the upper end of its bar to the right, to an angle."""
    # Distance to the left of the bar's centre and above it at which the finger tips push its upper end [m].
    lever = 0.03
    tip = (x - lever, _Y, height + lever)
    free = (x - lever, _Y - 0.06, height + lever)
    return Skill(
        moves=(*push((free, tip), orientation, speed=1.0), ArcMove(angle=angle, speed=1.5)),
        ik_seed=_AT_KNOBS,
        object_joint=Revolute(elements=(0,), anchor=(x, _Y, height), axis=BACK),
        retreat=(0.0, -0.04, 0.0),
    )


def turn_knob_back(x: float, height: float, orientation: HandOrientation) -> Skill:
    """Skill that turns a knob back by pushing the lower end of its bar around from the left to the right.

    The finger tips begin above that end, wherever it stands, so the poses do not follow the knob.
    """
    lever = 0.048
    # From the vertical, to the right.
    angles = np.radians(np.linspace(-55.0, -270.0, 12)).tolist()
    tips: list[Vector] = [(x + lever * math.sin(angle), _Y, height + lever * math.cos(angle)) for angle in angles]
    free = (tips[0][0], _Y - 0.06, tips[0][2])
    return Skill(moves=push((free, *tips), orientation, speed=0.07), ik_seed=_AT_KNOBS, retreat=(0.0, -0.04, 0.0))


def _push_left_door(orientation: HandOrientation, free: Vector = (-0.56, 0.42, 2.40)) -> Skill:
    """Skill that pushes the left door, which stands ajar, wide open from behind; the tips begin at `free` [m]."""
    height = 2.44
    behind = ((-0.60, 0.55, height), (-0.68, 0.51, height), (-0.77, 0.45, height), (-0.85, 0.37, height))
    return Skill(moves=push((free, *behind), orientation, speed=0.3), ik_seed=_AT_LEFT_DOOR, retreat=(0.1, -0.1, 0.0))


def _open_left_door(orientation: HandOrientation, behind: HandOrientation) -> Skill:
    """Skill that opens the left door, most of whose arc is out of reach of a grasp.

    The hand grasps the lower end of the bar with the finger tips, pulls the door ajar, and then pushes it from behind,
    where its orientation is `behind`.
    """
    aside = behind.standoff_position((-0.70, 0.36, 2.42), TIP)
    moves: tuple[Move | ArcMove, ...] = (
        *grasp((-0.683, 0.581, 2.46), orientation, (0.15, 0.09, 0.045), settle_steps=4, speed=0.3),
        ArcMove(angle=-0.6, speed=0.6),
        Move(position=aside, orientation=behind, fingers=OPEN, speed=0.2),
    )
    return Skill(
        moves=(*moves, *_push_left_door(behind).moves),
        ik_seed=_AT_LEFT_DOOR,
        object_joint=Revolute(elements=(0,), anchor=(-0.984, 0.71, 2.6), axis=UP),
        retreat=(0.1, -0.1, 0.0),
        release_steps=3,
    )


def _close_left_door(orientation: HandOrientation) -> Skill:
    """Skill that closes the left door: the finger tips drag its edge to the right, and then push its face."""
    height, below = 2.425, 2.40
    tips = (
        *((-0.84, 0.26, below), (-0.88, 0.325, height), (-0.87, 0.36, height), (-0.80, 0.42, height)),
        *((-0.72, 0.47, height), (-0.72, 0.36, below), (-0.83, 0.37, below), (-0.835, 0.40, height)),
        *((-0.78, 0.48, height), (-0.72, 0.56, height), (-0.69, 0.63, height), (-0.68, 0.66, height)),
    )
    return Skill(moves=push(tips, orientation, speed=0.2), ik_seed=_AT_LEFT_DOOR, retreat=(0.05, -0.10, 0.0))


def _push_switch(tips: Vector, orientation: HandOrientation) -> Skill:
    """Skill that pushes the light switch aside; `tips` are x in free space, beside it, and at the end [m]."""
    free, start, end = tips
    return Skill(
        moves=push(((free, 0.56, 2.28), (start, 0.62, 2.28), (end, 0.62, 2.28)), orientation, speed=0.6),
        ik_seed=(-0.87, -0.78, 1.22, -2.15, 1.2, 1.1, 1.6),
        retreat=(0.0, -0.05, 0.0),
    )


def _skills(orientations: Mapping[str, HandOrientation], *, knob_angle: float) -> dict[str, Skill]:
    """Builds the skills by task, in an order with short motions, in which open doors are in no other task's way.

    Orientations are those of the hand by task. Knobs that are turned on are damped and lag behind the hand, so that
    their target angle is beyond the goal [rad].
    """
    return {
        "close microwave": _MICROWAVE.shut(-0.75, orientations["close microwave"], _AT_MICROWAVE),
        "close hinge cabinet": _HINGE_CABINET.shut(
            1.45, orientations["close hinge cabinet"], (-0.5, -1.05, 1.3, -1.8, -0.2, 0.93, 1.2)
        ),
        "close left hinge cabinet": _close_left_door(orientations["close left hinge cabinet"]),
        # Two fingers side by side, low on the kettle: one finger would turn it, a push high up would tip it over.
        "kettle": Skill(
            moves=push(
                ((-0.275, 0.150, 1.70), (-0.275, 0.205, 1.70), (-0.275, 0.360, 1.70), (-0.260, 0.620, 1.70)),
                orientations["kettle"],
                fingers=OPEN,
                speed=0.5,
            ),
            ik_seed=_AT_KETTLE,
            object_joint=_kettle(-0.269, 0.35),
            retreat=(0.0, -0.05, 0.05),
        ),
        "return kettle": _carry_kettle(
            -0.23,
            0.75,
            orientations["return kettle"],
            _AT_KETTLE,
            lift=0.03,
            displacement=(-0.04, -0.40, 0.0),
            retreat=(0.0, -0.10, 0.0),
        ),
        # The hand comes from the right, so that the right finger hooks behind the bar.
        "microwave": _MICROWAVE.opened(-1.0, orientations["microwave"], _AT_MICROWAVE),
        "bottom burner": turn_knob(_LEFT, _LOW, orientations["knob"], knob_angle),
        "bottom right burner": turn_knob(_RIGHT, _LOW, orientations["knob"], knob_angle),
        "turn off bottom burner": turn_knob_back(_LEFT, _LOW, orientations["knob"]),
        "turn off bottom right burner": turn_knob_back(_RIGHT, _LOW, orientations["knob"]),
        "top burner": turn_knob(_LEFT, _HIGH, orientations["knob"], knob_angle),
        "top right burner": turn_knob(_RIGHT, _HIGH, orientations["knob"], knob_angle),
        "turn off top burner": turn_knob_back(_LEFT, _HIGH, orientations["knob"]),
        "turn off top right burner": turn_knob_back(_RIGHT, _HIGH, orientations["knob"]),
        "slide cabinet": Skill(
            moves=push(
                ((-0.185, 0.565, 2.475), (-0.160, 0.635, 2.475), (0.280, 0.635, 2.475)),
                orientations["slide cabinet"],
                speed=0.8,
            ),
            ik_seed=(-0.83, -0.83, 0.88, -2.07, 0.8, 1.12, 2.2),
            object_joint=Prismatic(elements=(0,), initial_position=(0.0,)),
            retreat=(0.0, -0.05, 0.0),
        ),
        # The hand comes from below, so that it does not touch the bar on its way to the right of it.
        "close slide cabinet": Skill(
            moves=push(
                ((0.40, 0.45, 2.38), (0.40, 0.56, 2.475), (0.39, 0.635, 2.475), (-0.08, 0.635, 2.475)),
                orientations["close slide cabinet"],
                speed=0.4,
            ),
            ik_seed=(-0.4, -0.83, 0.88, -2.07, 0.8, 1.12, 2.2),
            retreat=(0.0, -0.05, 0.0),
        ),
        "light switch": _push_switch((-0.310, -0.315, -0.500), orientations["light switch"]),
        "turn off light switch": _push_switch((-0.49, -0.485, -0.30), orientations["turn off light switch"]),
        "left hinge cabinet": _open_left_door(orientations["left hinge cabinet"], orientations["behind left door"]),
        # The hand comes from the left, so that the left finger hooks behind the bar; the bar turns between the fingers.
        "hinge cabinet": _HINGE_CABINET.opened(
            1.45, orientations["hinge cabinet"], (-1.18, -1.05, 1.3, -1.35, -0.2, 0.93, 1.2), element=1
        ),
    }


_ORIENTATIONS = {
    "knob": HandOrientation(approach=direction(4, -22), spread=DOWN),
    "kettle": HandOrientation(approach=direction(15, -15), spread=RIGHT),
    "microwave": HandOrientation(approach=direction(-30, -15), spread=RIGHT),
    "slide cabinet": HandOrientation(approach=direction(0, -20), spread=DOWN),
    "light switch": HandOrientation(approach=direction(-10, -10), spread=RIGHT),
    "hinge cabinet": HandOrientation(approach=direction(10, 8), spread=RIGHT),
    "left hinge cabinet": HandOrientation(approach=direction(-50, 35), spread=RIGHT),
    "behind left door": HandOrientation(approach=direction(-50, 35), spread=DOWN),
    "close left hinge cabinet": HandOrientation(approach=direction(-50, 0), spread=DOWN),
    "close hinge cabinet": HandOrientation(approach=direction(-20, 8), spread=RIGHT),
    "close microwave": HandOrientation(approach=direction(-30, -15), spread=RIGHT),
    "close slide cabinet": HandOrientation(approach=direction(-15, -20), spread=DOWN),
    "turn off light switch": HandOrientation(approach=direction(10, -10), spread=RIGHT),
    "return kettle": HandOrientation(approach=direction(20, 0), spread=UP),
}

# Target angles of knobs, which are damped and lag behind the hand; the second is for a hand that cannot turn, whose
# fingers, side by side, push a knob less far [rad].
KNOB_ANGLE, FIXED_KNOB_ANGLE = -1.3, -1.8

SKILLS: Mapping[str, Skill] = MappingProxyType(_skills(_ORIENTATIONS, knob_angle=KNOB_ANGLE))
"""Skills of all tasks."""

STRICT_SKILLS: Mapping[str, Skill] = MappingProxyType(
    {
        **SKILLS,
        # The kettle is pushed straighter, and as far as its goal.
        "kettle": dataclasses.replace(
            SKILLS["kettle"],
            moves=push(
                ((-0.300, 0.150, 1.70), (-0.300, 0.205, 1.70), (-0.300, 0.360, 1.70), (-0.290, 0.655, 1.70)),
                HandOrientation(approach=direction(7, -15), spread=RIGHT),
                fingers=OPEN,
                speed=0.5,
            ),
        ),
    }
)
"""Skills for strict success."""

# The hand's orientation at a reset: 4 degrees to the right, 3 degrees up.
AT_RESET = HandOrientation(approach=(0.0735, 0.9960, 0.0517), spread=(0.9967, -0.0752, 0.0319))

FIXED_SKILLS: Mapping[str, Skill] = MappingProxyType(
    {
        task: skill.with_orientation(AT_RESET) if task in DEFAULT_TASKS else skill
        for task, skill in _skills(dict.fromkeys(_ORIENTATIONS, AT_RESET), knob_angle=FIXED_KNOB_ANGLE).items()
    }
)
"""Skills in which the hand keeps its orientation at a reset.

Where a door is swung shut, the hand begins in that orientation.
"""


# The hand comes from the left; pushes would have to come from the right, around the kettle.
_FROM_LEFT = HandOrientation(approach=direction(49, -1), spread=UP)

# Skills for a kettle on one of the right burners, from near to far.
KETTLE_SKILLS = tuple(
    _carry_kettle(-0.269, 0.35, _FROM_LEFT, ik_seed, lift=0.02, displacement=displacement, retreat=(-0.07, -0.07, 0.0))
    for ik_seed, displacement in (
        ((-1.09, -1.12, 2.46, -2.96, -0.98, 0.93, 1.76), (-0.36, 0.36, 0.0)),
        ((-1.97, -1.70, 1.85, -1.88, -0.56, 1.36, 0.79), (-0.38, -0.03, 0.0)),
    )
)

# The kettle is on one of the right burners if its x is beyond this, and on the far one if its y is too [m].
_RIGHT_BURNERS, _FAR_BURNER = -0.05, 0.57

_IN_THE_WAY = 0.2  # Angle from which the right door of the hinge cabinet is in the way of the hand [rad].
_BESIDE_DOOR = (0.0, 0.40, 2.33)  # A place of the hand to the right of that door and below it [m].

# Angle beyond which the left door, which the strict goal of `hinge cabinet` has closed, is pushed shut at first [rad].
_NOT_SHUT = -0.04
_SHUT_LEFT_DOOR = Skill(
    moves=push(
        ((-0.70, 0.42, 2.425), (-0.70, 0.50, 2.425), (-0.69, 0.60, 2.425), (-0.68, 0.66, 2.425)),
        HandOrientation(approach=direction(-20, 0), spread=DOWN),
        speed=0.4,
    ),
    ik_seed=_AT_LEFT_DOOR,
    retreat=(0.05, -0.10, 0.0),
)

# Angle from which the left door is pushed and no longer pulled open [rad].
_AJAR = -0.35
_AJAR_SKILL = _push_left_door(HandOrientation(approach=direction(-35, 35), spread=DOWN), (-0.52, 0.40, 2.38))


def adapted(
    skill: Skill, task: str, kettle: Array, left_door: float, right_door: float, *, shuts_left_door: bool
) -> Skill:
    """Returns the skill of a task, or another one where kettle `(3,)` [m] and doors [rad] stand elsewhere.

    `shuts_left_door` says whether `hinge cabinet` begins with the left door, where that is open.
    """
    if task == "kettle" and kettle[0] > _RIGHT_BURNERS:
        return KETTLE_SKILLS[int(kettle[1] > _FAR_BURNER)]
    if task == "slide cabinet" and right_door >= _IN_THE_WAY:
        beside = dataclasses.replace(skill.lines[0], position=_BESIDE_DOOR)
        return dataclasses.replace(skill, moves=(beside, *skill.moves))
    if task == "hinge cabinet" and shuts_left_door and left_door < _NOT_SHUT:
        return _SHUT_LEFT_DOOR
    return _AJAR_SKILL if task == "left hinge cabinet" and left_door < _AJAR else skill
