"""Objects as they are observed, and poses of the hand that grasp them or put them down."""

from typing import NamedTuple, Self

import mink
import numpy as np

from kitchen_suite.entities.object_layouts import MAX_OBJECTS, MAX_PLACES, OBJECT_KINDS
from kitchen_suite.entities.places import PLACE_KINDS, ROOM, SURFACES
from kitchen_suite.entities.scenes import robot_base
from kitchen_suite.policies.experts import skills
from kitchen_suite.policies.experts.skills import HandOrientation, Move, Skill
from kitchen_suite.tasks.pick_and_place.mdp import OBJECT_SIZE, OBJECT_SLICES, PLACE_SIZE, PLACE_SLICES, SLICES
from kitchen_suite.types import Array

UP = np.array([0.0, 0.0, 1.0])

FROM_ABOVE = SURFACES | {"drawer"}  # Kinds of places that the hand reaches from above.
_LEAST_BEFORE = 0.33  # Least distance from the robot's axis at which the hand turns towards a place with a front [m].
CARRY_SPEED = 0.1  # Speed of the hand with an object, also where it puts it down [m/s].
_APPROACH_SPEED = 0.25  # Speed of the hand towards an object, and away from it [m/s].
_CLOSE_STEPS, _OPEN_STEPS, _REST_STEPS = 9, 6, 3  # Control steps in which fingers close and open, and the hand rests.
_RAISED = 0.02  # Height above its support at which an object is moved into a place with a front, or out of it [m].
_LEAVING = 0.12  # How far the hand moves back from what it has let go [m].
# Distances beyond the hand's site of the middle of the fingers' pads, and of their outer parts [m].
_PADS, _TIPS = 0.023, 0.03
_UPRIGHT = 0.95  # Least cosine of the tilt of an object that stands.
_ALIGNED = (0.0, 0.2, -0.2)  # Azimuths beside flat sides, which closing fingers turn to themselves [rad].
_HALF_STEEP = 0.75  # Pitch from which the hand comes half from above [rad].
FAR, LIFT = 0.1, 0.1  # Distances before a grasp and above it [m].

# Azimuths of the hand relative to the usual one that are tried [rad].
TURNS = tuple(np.radians([0.0, 20.0, -20.0, 45.0, -45.0]).tolist())


class Thing(NamedTuple):
    """An object, as it is observed.

    Attributes:
      row: of the observation's objects.
      kind: one of `OBJECT_KINDS`.
      base: middle of its lower face, `(3,)` [m].
      x_axis: its x axis, `(3,)`.
      is_upright: whether it stands.
      goal_kind: one of `PLACE_KINDS`; empty where it is not requested.
      goal: middle of the support of its place, `(3,)` [m].
      goal_half_size: half sizes of its place, `(3,)` [m].
      within: support and half sizes of the place with a front in which it stands, `(2, 3)` [m]; None for none.
    """

    row: int
    kind: str
    base: Array
    x_axis: Array
    is_upright: bool
    goal_kind: str
    goal: Array
    goal_half_size: Array
    within: Array | None

    @property
    def is_done(self) -> bool:
        """Whether it is where it is to be."""
        offset = np.abs(self.base - self.goal)
        inside = offset[:2] <= self.goal_half_size[:2] + 0.002
        return bool(inside.all() and -0.02 < self.base[2] - self.goal[2] < 0.06)


def things(observation: Array) -> list[Thing]:
    """Returns the objects of a flat observation, requested ones first."""
    found = []
    rows = observation[SLICES["objects"]].reshape(MAX_OBJECTS, OBJECT_SIZE)
    fronts = _places_with_fronts(observation)
    for number, row in enumerate(rows):
        part = {name: row[where] for name, where in OBJECT_SLICES.items()}
        if not part["kind"].any():
            continue
        centre = part["position"] + robot_base()
        requested = part["requested"][0] > 0.5
        kind = OBJECT_KINDS[int(part["kind"].argmax())]
        inside = [place for place in fronts if (np.abs(centre - place[0])[:2] < place[1, :2]).all()]
        inside = [place for place in inside if 0.0 < centre[2] - place[0, 2] < ROOM]
        found.append(
            Thing(
                row=number,
                kind=kind,
                base=_base(kind, centre, part["x_axis"], part["z_axis"], part["half_size"]),
                x_axis=part["x_axis"],
                is_upright=bool(part["z_axis"][2] > _UPRIGHT),
                goal_kind=PLACE_KINDS[int(part["goal_kind"].argmax())] if requested else "",
                goal=part["goal_position"] + robot_base(),
                goal_half_size=part["goal_half_size"],
                within=next(iter(inside), None),
            )
        )
    return found


def _places_with_fronts(observation: Array) -> list[Array]:
    """Returns the supports and half sizes `(2, 3)` of the cabinets and microwaves of a flat observation [m]."""
    rows = observation[SLICES["places"]].reshape(MAX_PLACES, PLACE_SIZE)
    found = []
    for row in rows:
        kind = row[PLACE_SLICES["kind"]]
        if kind.any() and PLACE_KINDS[int(kind.argmax())] not in FROM_ABOVE:
            found.append(np.stack([row[PLACE_SLICES["position"]] + robot_base(), row[PLACE_SLICES["half_size"]]]))
    return found


# Where the box of a mug is beside its frame, because of the handle [m].
_MUG_OFFSET = 0.016


def _base(kind: str, centre: Array, x_axis: Array, z_axis: Array, half_size: Array) -> Array:
    """Returns the origin of an object's frame, from the middle of its box."""
    offset = _MUG_OFFSET if kind == "mug" else 0.0
    base: Array = centre - z_axis * half_size[2] - x_axis * offset
    return base


class End(NamedTuple):
    """A pose of the hand at the beginning or at the end of a carry.

    Attributes:
      pitch: of the approach below the horizontal [rad].
      azimuth: direction of the approach seen from above [rad].
      at: position of the hand, `(3,)` [m].
      start: position from which the hand moves straight there, `(3,)` [m].
      has_front: whether it is in a place with a front.
      joints: joint positions of the arm at the start, `(7,)` [rad].
    """

    pitch: float
    azimuth: float
    at: Array
    start: Array
    has_front: bool
    joints: Array

    @classmethod
    def make(cls, pitch: float, azimuth: float, at: Array, entry: float, start: Array) -> Self:
        """Returns a pose without joint positions; `entry` is the distance from the front, 0 for a place without one."""
        return cls(pitch, azimuth, at, _outside(at, azimuth, entry) if entry else start, entry > 0.0, np.zeros(7))

    @property
    def hand(self) -> HandOrientation:
        """Orientation of the hand."""
        return orientation(self.azimuth, self.pitch)

    def pose(self, position: Array) -> mink.SE3:
        """Returns the pose of the hand at a position in this orientation."""
        return mink.SE3.from_rotation_and_translation(self.hand.rotation, position)

    def grasping(self) -> Skill:
        """Returns the motions that grasp an object here and lift it."""
        moves = [
            _move(self.start, self, skills.OPEN, settle=_REST_STEPS, free=True),
            _move(self.at, self, skills.OPEN, speed=_APPROACH_SPEED, settle=_REST_STEPS),
            _move(self.at, self, skills.CLOSED, settle=_CLOSE_STEPS),
        ]
        if self.has_front:
            moves.append(_move(self.at + _RAISED * UP, self, skills.CLOSED, speed=CARRY_SPEED))
            moves.append(_move(self.start, self, skills.CLOSED, speed=CARRY_SPEED))
        else:
            moves.append(_move(self.at + LIFT * UP, self, skills.CLOSED, speed=CARRY_SPEED))
        return Skill(moves=tuple(moves), ik_seed=tuple(self.joints.tolist()))

    def placing(self) -> Skill:
        """Returns the motions that put an object down here, let it go and leave."""
        away = self.at - _LEAVING * np.array(self.hand.approach)
        moves = [_move(self.start, self, skills.CLOSED, settle=_REST_STEPS)]
        if self.has_front:
            moves.append(_move(self.at + _RAISED * UP, self, skills.CLOSED, speed=CARRY_SPEED))
        moves += [
            _move(self.at, self, skills.CLOSED, speed=CARRY_SPEED, settle=_REST_STEPS),
            _move(self.at, self, skills.OPEN, settle=_OPEN_STEPS),
            _move(away, self, skills.OPEN, speed=_APPROACH_SPEED),
        ]
        if self.has_front:
            moves.append(_move(self.start, self, skills.OPEN, speed=_APPROACH_SPEED))
        return Skill(moves=tuple(moves), ik_seed=tuple(self.joints.tolist()))


def orientation(azimuth: float, pitch: float) -> HandOrientation:
    """Returns the orientation of a hand whose fingers open sideways, by the direction of its approach [rad]."""
    ahead = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    approach = np.cos(pitch) * ahead - np.sin(pitch) * UP
    return HandOrientation(approach=skills.vector(approach), spread=skills.vector(np.cross(UP, ahead)))


def _move(
    position: Array, end: End, fingers: float, *, speed: float = 0.5, settle: int = 0, free: bool = False
) -> Move:
    return Move(
        position=skills.vector(position),
        orientation=end.hand,
        fingers=fingers,
        speed=speed,
        settle_steps=settle,
        in_free_space=free,
    )


def hold(thing: Thing, pitch: float) -> tuple[Array, list[float]]:
    """Returns the hand's position relative to an object's base, in the frame of the hand's azimuth, and azimuths [rad].

    A can and a bottle are grasped from any side, a carton across its short side, a mug by its handle, which the tips of
    the fingers hold so that they do not touch its wall.
    """
    radial = azimuth_of(thing.base - robot_base())
    axis = float(np.arctan2(thing.x_axis[1], thing.x_axis[0]))
    depth, azimuths = _PADS, [radial + turn for turn in TURNS]
    match thing.kind:
        case "can":
            held = (0.0, 0.0, 0.05)
        case "bottle":
            # By its neck from above.
            held = (0.0, 0.0, 0.13 if pitch > _HALF_STEEP else 0.05)
        case "carton":
            held = (0.0, 0.0, 0.045)
            ahead = axis if np.cos(axis - radial) > 0.0 else axis + np.pi
            azimuths = [ahead + turn for turn in _ALIGNED]
        case _:
            held = (-0.068, 0.0, 0.044)
            depth, azimuths = _TIPS, [axis + np.pi + turn for turn in _ALIGNED]
    approach = np.array([np.cos(pitch), 0.0, -np.sin(pitch)])
    return np.array(held) - depth * approach, azimuths


def _outside(point: Array, azimuth: float, distance: float) -> Array:
    """Returns the point at a distance before one in a place with a front, from which the hand moves straight in [m]."""
    ahead = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    along = float((point - robot_base()) @ ahead)
    return point - min(distance, max(along - _LEAST_BEFORE, 0.1)) * ahead + _RAISED * UP


def azimuth_of(vector: Array) -> float:
    """Returns the direction of a vector, seen from above [rad]."""
    return float(np.arctan2(vector[1], vector[0]))
