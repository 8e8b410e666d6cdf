"""The expert of objects in generated kitchens: it opens what is closed, grasps an object, carries it and lets it go."""

import collections
import functools
import itertools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Self

import mink
import mujoco
import numpy as np
from dm_control import mjcf

from kitchen_suite.entities.generated_kitchen import MAX_PARTS
from kitchen_suite.entities.kitchen_designs import SHOULDER, KitchenDesign
from kitchen_suite.entities.object_layouts import MAX_OBJECTS, MAX_PLACES, OBJECT_KINDS, ObjectLayout
from kitchen_suite.entities.pick_and_place import build_pick_and_place
from kitchen_suite.entities.places import PLACE_KINDS, ROOM, SURFACES
from kitchen_suite.entities.scenes import robot_base
from kitchen_suite.policies.experts import generated_kitchens as kitchens
from kitchen_suite.policies.experts import skills
from kitchen_suite.policies.experts.base import Expert, MotionStyle
from kitchen_suite.policies.experts.encoders import make_encoder
from kitchen_suite.policies.experts.kinematics import ARM
from kitchen_suite.policies.experts.kitchen import arm_model
from kitchen_suite.policies.experts.skills import HandOrientation, Move, Skill
from kitchen_suite.policies.experts.trajectories import (
    OUT_OF_REACH,
    HandSpeedLimits,
    JointSpeedLimits,
    JointTrajectory,
    plan,
)
from kitchen_suite.tasks.control_modes.registry import make_mode
from kitchen_suite.tasks.generated_kitchens.slots import SLOT_SIZE, SLOT_SLICES
from kitchen_suite.tasks.kitchen.control_modes import CONTROL_MODES, POSITION_HIGH, POSITION_LOW
from kitchen_suite.tasks.pick_and_place.mdp import OBJECT_SIZE, OBJECT_SLICES, PLACE_SIZE, PLACE_SLICES, SLICES, size
from kitchen_suite.tasks.pick_and_place.task import PickAndPlaceTask
from kitchen_suite.types import Array

_UP = np.array([0.0, 0.0, 1.0])

FROM_ABOVE = SURFACES | {"drawer"}  # Kinds of places that the hand reaches from above.

_LEAST_BEFORE = 0.33  # Least distance from the robot's axis at which the hand turns towards a place with a front [m].
_FAR, _LIFT = 0.1, 0.1  # Distances before a grasp and above it [m].
_ENTRIES = (0.3, 0.2, 0.4)  # Distances from which the hand moves straight into a place with a front [m].
_ABOVE = 0.006  # Height above its support at which an object is let go [m].
_CARRY_SPEED, _PLACE_SPEED, _APPROACH_SPEED = 0.15, 0.1, 0.25  # Speeds of the hand [m/s].
_JOINT_SHARE = 0.5  # Share of the joints' greatest speeds with which objects are carried.
_TURN_SPEED = 1.2  # Speed with which the hand turns what it carries [rad/s].
_FEW = 3  # Number of joint positions at which the robot may brush against something where it cannot do without.
_LEAST_UPRIGHT = 0.6  # Least cosine of the tilt of what is carried.
_STEP = 0.3  # Greatest motion of a joint in a step of a tree [rad].
_ITERATIONS, _SHORTCUTS = 150, 60  # Numbers of samples by which trees grow, and of shortcuts that are tried.
_CLOSE_STEPS, _OPEN_STEPS, _REST_STEPS = 9, 6, 3  # Control steps in which fingers close and open, and the hand rests.
_ATTEMPTS = 4  # Number of motions that are tried for an object.
_SETTLE_STEPS = 8  # Control steps from the end of a trajectory to the failure of its task.
_NEAR = 0.42  # Distance from the robot's axis at which the hand carries objects past what stands around it [m].

# Pitches of the hand below the horizontal, and azimuths relative to the usual one, that are tried [rad].
_STEEP = tuple(np.radians([90.0, 65.0, 45.0, 25.0]).tolist())
_FLAT = tuple(np.radians([25.0, 12.0, 40.0, 0.0]).tolist())
_TURNS = tuple(np.radians([0.0, 20.0, -20.0, 45.0, -45.0]).tolist())

_ALIGNED = (0.0, 0.2, -0.2)  # Azimuths beside flat sides, which closing fingers turn to themselves [rad].
_STEEPEST, _HALF_STEEP = 1.2, 0.6  # Pitches from which the hand comes from above, and half from above [rad].
_RAISED = 0.02  # Height above its support at which an object is moved into a place with a front, or out of it [m].
_LEAVING = 0.12  # How far the hand moves back from what it has let go [m].
_HAND_LENGTH = 0.2  # From the wrist to the finger tips [m].
_WRIST_REACH = 0.8  # Distance of the wrist from the shoulder beyond which no posture is looked for [m].
_SEEDS = 3  # Number of postures from which inverse kinematics starts for a pose of the hand.
_PER_PITCH = 4  # Number of poses that are kept for a pitch of the hand.
_TRIED = 16  # Number of poses that are tried for a pitch of the hand.
_FOUND = 3  # Number of motions of which the shortest is made.
_MOST = 16  # Number of pairs of a grasp and a place that are tried.
_MARGIN = 0.004  # Distance that counts as a contact of the arm [m].
_CHECKED = 0.1  # Spacing of the joint positions at which a path is checked for collisions [rad].
_DEPTHS = (0.1, 0.07, 0.14)  # Depths behind the front of a place with a front at which an object is put [m].
_FINGER_LENGTH = 0.035  # From the palm to the finger tips, with a gap [m].
_PALM = 0.012  # How far before the axis of a can the hand grasps it from the side [m].
_UPRIGHT = 0.95  # Least cosine of the tilt of an object that stands.
_BESIDE = 0.09  # Distance from the middle of a place at which an object is put beside another one [m].


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
            moves.append(_move(self.at + _RAISED * _UP, self, skills.CLOSED, speed=_CARRY_SPEED))
            moves.append(_move(self.start, self, skills.CLOSED, speed=_CARRY_SPEED))
        else:
            moves.append(_move(self.at + _LIFT * _UP, self, skills.CLOSED, speed=_CARRY_SPEED))
        return Skill(moves=tuple(moves), ik_seed=tuple(self.joints.tolist()))

    def placing(self) -> Skill:
        """Returns the motions that put an object down here, let it go and leave."""
        away = self.at - _LEAVING * np.array(self.hand.approach)
        moves = [_move(self.start, self, skills.CLOSED, settle=_REST_STEPS)]
        if self.has_front:
            moves.append(_move(self.at + _RAISED * _UP, self, skills.CLOSED, speed=_CARRY_SPEED))
        moves += [
            _move(self.at, self, skills.CLOSED, speed=_PLACE_SPEED, settle=_REST_STEPS),
            _move(self.at, self, skills.OPEN, settle=_OPEN_STEPS),
            _move(away, self, skills.OPEN, speed=_APPROACH_SPEED),
        ]
        if self.has_front:
            moves.append(_move(self.start, self, skills.OPEN, speed=_APPROACH_SPEED))
        return Skill(moves=tuple(moves), ik_seed=tuple(self.joints.tolist()))


def orientation(azimuth: float, pitch: float) -> HandOrientation:
    """Returns the orientation of a hand whose fingers open sideways, by the direction of its approach [rad]."""
    ahead = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    approach = np.cos(pitch) * ahead - np.sin(pitch) * _UP
    return HandOrientation(approach=skills.vector(approach), spread=skills.vector(np.cross(_UP, ahead)))


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


def _hold(thing: Thing, pitch: float) -> tuple[Array, list[float]]:
    """Returns the hand's position relative to an object's base, in the frame of the hand's azimuth, and azimuths [rad].

    A can and a bottle are grasped from any side, a carton across its short side, a mug by its handle.
    """
    is_steep = pitch > _HALF_STEEP
    radial = _azimuth(thing.base - robot_base())
    axis = float(np.arctan2(thing.x_axis[1], thing.x_axis[0]))
    sides = [radial + turn for turn in _TURNS]
    # The palm stays clear of what is grasped from the side.
    back = 0.0 if pitch > _STEEPEST else -_PALM
    match thing.kind:
        case "can":
            return np.array([back, 0.0, 0.065]), sides
        case "bottle":
            return np.array([back, 0.0, 0.138 if is_steep else 0.06]), sides
        case "carton":
            ahead = axis if np.cos(axis - radial) > 0.0 else axis + np.pi
            # As far from its end as the palm leaves room beside its upper edge.
            room = (_FINGER_LENGTH - 0.029 * np.sin(pitch)) / max(np.cos(pitch), 0.1)
            return np.array([min(room - 0.055, 0.0), 0.0, 0.06]), [ahead + turn for turn in _ALIGNED]
        case _:
            return np.array([-0.062, 0.0, 0.06 if is_steep else 0.048]), [axis + np.pi + turn for turn in _ALIGNED]


def _outside(point: Array, azimuth: float, distance: float) -> Array:
    """Returns the point at a distance before one in a place with a front, from which the hand moves straight in [m]."""
    ahead = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    along = float((point - robot_base()) @ ahead)
    return point - min(distance, max(along - _LEAST_BEFORE, 0.1)) * ahead + _RAISED * _UP


def _near(point: Array, height: float) -> Array:
    """Returns the point near the robot, in the direction of another one, at a height [m]."""
    offset = point[:2] - robot_base()[:2]
    distance = max(float(np.linalg.norm(offset)), 1e-6)
    return np.append(robot_base()[:2] + offset / distance * min(distance, _NEAR), height)


class ObjectExpert(Expert):
    """Puts the objects that an observation asks for where they are to be, one after the other; repeats what fails."""

    control_modes = CONTROL_MODES

    def __init__(
        self,
        design: KitchenDesign,
        layout: ObjectLayout,
        *,
        num_slots: int = MAX_PARTS,
        style: MotionStyle | None = None,
        control_mode: str = "joint_velocity",
        **control_options: Any,
    ) -> None:
        """Builds an expert for a kitchen of which `num_slots` slots are observed; others as of every `Expert`."""
        self._parts = kitchens.parts_of(design)
        self._kitchen, self.observation_size = _kitchen(design, layout), size(num_slots)
        super().__init__(style, make_encoder(make_mode(control_mode, CONTROL_MODES, control_options), arm_model()))

    @classmethod
    def _task_settings(cls, task: PickAndPlaceTask) -> dict[str, Any]:
        return {"design": task.scene.design, "layout": task.scene.layout, "num_slots": task.mdp.num_slots}

    def reset(self, generator: np.random.Generator) -> None:
        super().reset(generator)
        self._failures: collections.Counter[object] = collections.Counter()
        self._present: object = None

    def robot_positions(self, observation: Array) -> Array:
        return observation[SLICES["joint_positions"]]

    def _next_trajectory(self, observation: Array, joints: Array) -> JointTrajectory | None:
        if self._trajectory is not None:
            if not self._has_ended(_SETTLE_STEPS):
                return None
            self._failures[self._present] += 1
        closed = self._closed_part(observation)
        if closed is not None:
            return self._opening(closed, observation, joints)
        asked = (thing for thing in things(observation) if thing.goal_kind and thing.is_upright and not thing.is_done)
        pending = [thing for thing in asked if self._failures[thing.row] < _ATTEMPTS]
        if not pending:
            return None if self._trajectory is not None else JointTrajectory.stationary(joints, skills.OPEN)
        thing = min(pending, key=lambda each: self._failures[each.row])
        self._present = thing.row
        self._kitchen.see(observation)
        motion = self._kitchen.motion(thing, joints, self.encoder.limits, self._failures[thing.row])
        # Others are looked for in the next attempt.
        return motion or JointTrajectory.stationary(joints, self._fingers)

    @property
    def _fingers(self) -> float:
        return skills.OPEN if self._trajectory is None else self._current_fingers

    def _closed_part(self, observation: Array) -> Array | None:
        """Returns the slot of a part that has to be opened first; None if there is none."""
        rows = observation[SLICES["slots"]].reshape(-1, SLOT_SIZE)
        for row in rows:
            is_requested = row[SLOT_SLICES["requested"].start] > 0.5
            if is_requested and row[SLOT_SLICES["opening"].start] < kitchens.OPENED:
                return row
        return None

    def _opening(self, row: Array, observation: Array, joints: Array) -> JointTrajectory:
        """Returns the trajectory that opens a part, after the retreat from what was moved before."""
        target = self._parts.find(row)
        opening = float(row[SLOT_SLICES["opening"].start])
        motions = self._parts.motions(target, round(opening, 1), self.encoder)
        motion = motions[self._failures[target] % len(motions)]
        rest = JointTrajectory.stationary(joints, skills.OPEN)
        trajectory = rest if self._present is None else self._plan_retreat(joints)
        self._present, self._skill = target, motion.skill
        planned = self._plan(motion.skill, frame=motion.frame, object_position=motion.position)
        way, _ = self._parts.path(trajectory.knots[-1], planned.knots[0], target, opening, self.encoder.turns_hand)
        for knot in way:
            trajectory = trajectory.then(JointTrajectory.stationary(knot, skills.OPEN), self._limits)
        return trajectory.then(planned, self._limits)


class PlannedEnd(NamedTuple):
    """A grasp or a place with the motions there.

    Attributes:
      end: pose of the hand.
      trajectory: from before it on.
      touches: number of joint positions at which the robot touches something.
    """

    end: End
    trajectory: JointTrajectory
    touches: int

    def distance(self, place: "PlannedEnd") -> float:
        """Returns the greatest motion of a joint from the end of this one to the start of another one [rad]."""
        return float(np.abs(self.trajectory.knots[-1] - place.trajectory.knots[0]).max())


def _slowed(limits: JointSpeedLimits) -> HandSpeedLimits:
    """Returns limits of the joints' speeds, and of the hand's, with which objects are carried."""
    return HandSpeedLimits(
        joint_speed=tuple((_JOINT_SHARE * np.array(limits.joint_speed)).tolist()),
        timestep=limits.timestep,
        kinematics=arm_model().kinematics,
        linear_speed=_CARRY_SPEED,
        angular_speed=_TURN_SPEED,
    )


# A tree of joint positions `(7,)`, each with the index of the one before it.
Tree = list[tuple[Array, int]]


def _extend(tree: Tree, sample: Array, free: Callable[[Array, Array], bool]) -> int | None:
    """Grows a tree by a step towards a sample; returns the index of the new node, None if something is in the way."""
    nearest = int(np.argmin([np.abs(node - sample).max() for node, _ in tree]))
    start = tree[nearest][0]
    distance = float(np.abs(sample - start).max())
    end = sample if distance <= _STEP else start + (sample - start) * _STEP / distance
    if not free(start, end):
        return None
    tree.append((end, nearest))
    return len(tree) - 1


def _reach(tree: Tree, target: Array, free: Callable[[Array, Array], bool]) -> int | None:
    """Grows a tree up to a target; returns the index of the node there, None if something is in the way."""
    while (node := _extend(tree, target, free)) is not None:
        if np.array_equal(tree[node][0], target):
            return node
    return None


def _branch(tree: Tree, node: int) -> list[Array]:
    """Returns the nodes from one to the root of its tree."""
    found = []
    while node >= 0:
        joints, node = tree[node]
        found.append(joints)
    return found


def _shortened(path: list[Array], free: Callable[[Array, Array], bool], generator: np.random.Generator) -> list[Array]:
    """Returns a path without the detours that straight motions between its nodes spare."""
    for _ in range(_SHORTCUTS):
        if len(path) < 3:
            break
        start, end = np.sort(generator.choice(len(path), 2, replace=False)).tolist()
        if end - start > 1 and free(path[start], path[end]):
            path = [*path[: start + 1], *path[end:]]
    return path


class _ObjectKitchen:
    """A kitchen with objects as they are observed, and motions for them."""

    def __init__(self, design: KitchenDesign, layout: ObjectLayout) -> None:
        built = build_pick_and_place(design, objects=layout, visuals=False)
        self._parts = kitchens.parts_of(design)
        self._physics = physics = mjcf.Physics.from_mjcf_model(built.arena.mjcf_model)
        self._data = mujoco.MjData(physics.model.ptr)
        names = [physics.model.id2name(body, "body") for body in physics.model.geom_bodyid]
        self._robot = np.array([name.startswith("franka/") for name in names])
        self._fingers = np.array([name.endswith("finger") for name in names])
        self._hand = self._robot & [name.endswith(("finger", "hand")) for name in names]
        self._columns = [int(physics.bind(thing.joints[0]).qposadr) for thing in built.objects]
        self._kinds = [each.kind for each in layout.objects]
        self._geoms = np.array([[name.split("/")[0] == own for name in names] for own in layout.names])
        joints = [
            built.props[name].mjcf_model.find("joint", part.joint) if part.joint else None for name, part in built.parts
        ]
        self._part_columns = [None if joint is None else int(physics.bind(joint).qposadr) for joint in joints]
        physics.model.geom_margin[self._robot & ~self._fingers] = _MARGIN

    def see(self, observation: Array) -> None:
        """Sets parts and objects as they are observed."""
        self._qpos = self._physics.model.ptr.qpos0.copy()
        for row in observation[SLICES["slots"]].reshape(-1, SLOT_SIZE):
            if not row[SLOT_SLICES["kind"]].any():
                continue
            slot = self._parts.find(row).slot
            if (column := self._part_columns[slot]) is not None:
                self._qpos[column] = self._parts.slots.opened[slot] * row[SLOT_SLICES["opening"].start]
        self._things = things(observation)
        # Observed objects by their index in the layout: the nearest of their kind.
        self._numbers = self._match(self._things)
        for thing, number in zip(self._things, self._numbers, strict=True):
            column = self._columns[number]
            yaw = np.arctan2(thing.x_axis[1], thing.x_axis[0])
            self._qpos[column : column + 3] = thing.base + 0.002 * _UP
            self._qpos[column + 3 : column + 7] = np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)

    def _match(self, seen: Sequence[Thing]) -> list[int]:
        """Returns an index in the layout for each object; objects of a kind are alike."""
        left = list(range(len(self._kinds)))
        numbers = []
        for thing in seen:
            number = next(k for k in left if self._kinds[k] == thing.kind)
            left.remove(number)
            numbers.append(number)
        return numbers

    def motion(self, thing: Thing, start: Array, limits: JointSpeedLimits, attempt: int) -> JointTrajectory | None:
        """Returns a motion from joint positions `(7,)` that puts an object where it is to be; None if none is found.

        The robot, and what it carries, touch nothing on the way. Each attempt looks elsewhere.
        """
        generator = np.random.default_rng(attempt)
        number = self._numbers[thing.row]
        # What is held slips where the hand turns as fast as the joints can.
        slow = _slowed(limits)
        grasps = self._planned(number, self._ends_at(thing, generator), slow, is_grasp=True)
        places = self._planned(number, self._ends_in(thing, generator), slow, is_grasp=False)
        pairs = [(grasp, place) for grasp in grasps for place in places if grasp.end.pitch == place.end.pitch]
        pairs.sort(key=lambda pair: (pair[0].touches + pair[1].touches, pair[0].distance(pair[1])))
        found: list[JointTrajectory] = []
        ways: dict[int, list[Array] | None] = {}
        for grasp, place in pairs[:_MOST]:
            first = id(grasp)
            if first not in ways:
                ways[first] = self._path(start, grasp.trajectory.knots[0], None, None, generator)
            way = ways[first]
            if way is None:
                continue
            held = self._held(number, grasp)
            carry = self._path(grasp.trajectory.knots[-1], place.trajectory.knots[0], number, held, generator)
            if carry is None:
                continue
            motion = JointTrajectory.stationary(start, skills.OPEN)
            for joints in way:
                motion = motion.then(JointTrajectory.stationary(joints, skills.OPEN), limits)
            motion = motion.then(grasp.trajectory, limits)
            for joints in carry:
                motion = motion.then(JointTrajectory.stationary(joints, skills.CLOSED), slow)
            found.append(motion.then(place.trajectory, slow))
            if len(found) == _FOUND:
                break
        return min(found, key=lambda each: each.duration, default=None)

    def _path(
        self, first: Array, last: Array, number: int | None, held: mink.SE3 | None, generator: np.random.Generator
    ) -> list[Array] | None:
        """Returns joint positions on a way on which nothing is touched, or None if none is found.

        Two trees grow from both ends towards each other (RRT-Connect, Kuffner and LaValle, 2000); the way is then cut
        short where it can be.
        """

        def free(start: Array, end: Array) -> bool:
            return not self._touches([start, end], number, held, first_only=True)

        if free(first, last):
            return []
        trees: list[list[tuple[Array, int]]] = [[(first, -1)], [(last, -1)]]
        for _ in range(_ITERATIONS):
            middle = (first + last) / 2
            sample = np.clip(middle + generator.normal(0.0, 1.0, 7), POSITION_LOW[ARM], POSITION_HIGH[ARM])
            node = _extend(trees[0], sample, free)
            if node is not None:
                target = trees[0][node][0]
                other = _reach(trees[1], target, free)
                if other is not None:
                    here, there = _branch(trees[0], node), _branch(trees[1], other)
                    path = [*here[::-1], *there]
                    path = path if np.array_equal(path[0], first) else path[::-1]
                    return _shortened(path, free, generator)[1:-1]
            trees.reverse()
        return None

    def _planned(
        self, number: int, ends: Sequence[End], limits: JointSpeedLimits, *, is_grasp: bool
    ) -> list[PlannedEnd]:
        """Returns those of some ends whose motions the arm can follow, those first on which it touches the least."""
        found = []
        for end in ends:
            trajectory = plan(arm_model().kinematics, limits, end.grasping() if is_grasp else end.placing())
            beyond = (trajectory.knots < POSITION_LOW[ARM]) | (trajectory.knots > POSITION_HIGH[ARM])
            if not trajectory.is_reachable or beyond.any():
                continue
            closed = np.flatnonzero(trajectory.fingers == skills.CLOSED)
            knots = list(trajectory.knots)
            # What is grasped is carried here, and what is let go may be touched by the fingers that leave it.
            free = knots[: closed[0]] if is_grasp else knots[closed[-1] + 2 :]
            touches = self._touches(free, number, None)
            if touches <= _FEW:
                found.append(PlannedEnd(end, trajectory, touches))
        return found

    def _held(self, number: int, grasp: PlannedEnd) -> mink.SE3:
        """Returns the pose of an object in the hand that grasps it."""
        column = self._columns[number]
        pose = np.concatenate([self._qpos[column + 3 : column + 7], self._qpos[column : column + 3]])
        return grasp.end.pose(grasp.end.at).inverse() @ mink.SE3(wxyz_xyz=pose)

    def _ends_at(self, thing: Thing, generator: np.random.Generator) -> list[End]:
        """Returns poses in which the hand grasps an object."""
        found: list[End] = []
        number = self._numbers[thing.row]
        for pitch in self._pitches(thing):
            local, azimuths = _hold(thing, pitch)
            choices = list(itertools.product(azimuths, _ENTRIES if thing.within is not None else (0.0,)))
            count = 0
            for k in generator.permutation(len(choices)).tolist():
                azimuth, entry = choices[k]
                at = thing.base + mink.SO3.from_z_radians(azimuth).apply(local)
                end = End.make(pitch, azimuth, at, entry, at - _FAR * np.array(orientation(azimuth, pitch).approach))
                solved = self._solved(end, thing.base, number, None, generator)
                found += solved
                count += len(solved)
                if count >= _PER_PITCH:
                    break
        return found

    def _ends_in(self, thing: Thing, generator: np.random.Generator) -> list[End]:
        """Returns poses in which the hand lets an object go where it is to be."""
        found: list[End] = []
        spots = self._spots(thing)
        has_front = thing.goal_kind not in FROM_ABOVE
        number = self._numbers[thing.row]
        for pitch in self._pitches(thing):
            local, _ = _hold(thing, pitch)
            choices = list(itertools.product(spots, _TURNS, _ENTRIES if has_front else (0.0,)))
            count = 0
            for k in generator.permutation(len(choices)).tolist()[:_TRIED]:
                (spot, front), turn, entry = choices[k]
                azimuth = _azimuth(front if has_front else spot - robot_base()) + turn
                turned = mink.SO3.from_z_radians(azimuth)
                at = spot + turned.apply(local) + _ABOVE * _UP
                end = End.make(pitch, azimuth, at, entry, at + _LIFT * _UP)
                held = end.pose(end.at).inverse() @ mink.SE3.from_rotation_and_translation(turned, spot + _ABOVE * _UP)
                solved = self._solved(end, spot, number, held, generator)
                found += solved
                count += len(solved)
                if count >= _PER_PITCH:
                    break
        return found

    def _pitches(self, thing: Thing) -> tuple[float, ...]:
        """Returns the pitches of the hand in which an object may be carried from where it is to where it is to be."""
        return _STEEP if thing.goal_kind in FROM_ABOVE and thing.within is None else _FLAT

    def _solved(
        self, end: End, towards: Array, number: int, held: mink.SE3 | None, generator: np.random.Generator
    ) -> list[End]:
        """Returns an end with joint positions in which the arm reaches it, and what is before it, and touches nothing.

        Empty if there are none. `held` is the pose of the object in the hand, None before it is grasped.
        """
        kinematics = arm_model().kinematics
        wrist = end.at - _HAND_LENGTH * np.array(end.hand.approach)
        if np.linalg.norm(wrist - robot_base() - SHOULDER * _UP) > _WRIST_REACH:
            return []
        seeds = (kitchens.tuck_posture(kitchens.TUCKS[0]), *kitchens.SEEDS)
        for seed in (seeds[k] for k in generator.permutation(len(seeds))[:_SEEDS]):
            aimed = np.array(kitchens.aimed_posture(seed, towards))
            start = kinematics.inverse(end.pose(end.start), start=aimed)
            if not self._reaches(start, end.start):
                continue
            joints = kinematics.inverse(end.pose(end.at), start=start)
            if self._reaches(joints, end.at) and not self._touches([joints, joints], number, held):
                return [end._replace(joints=start)]
        return []

    def _reaches(self, joints: Array, place: Array) -> bool:
        """Returns whether the hand is at a place at joint positions within their limits."""
        inside = ((joints > POSITION_LOW[ARM]) & (joints < POSITION_HIGH[ARM])).all()
        apart = np.linalg.norm(arm_model().kinematics.forward(joints).translation() - place)
        return bool(inside and apart < OUT_OF_REACH)

    def _spots(self, thing: Thing) -> list[tuple[Array, Array]]:
        """Returns points where the object may be put, and the direction into the place, zeros if it is from above."""
        goal, half = thing.goal, thing.goal_half_size
        others = [other.base for other in self._things if other.row != thing.row]
        into = np.zeros(3)
        if thing.goal_kind not in FROM_ABOVE:
            into = self._into(goal)
            along = np.abs(np.cross(_UP, into))
            depth = float(np.abs(into) @ half)
            points = [
                goal + into * (behind - depth) + along * side
                for behind in _DEPTHS
                for side in _sides(float(along @ half))
            ]
        else:
            wide = int(half[1] > half[0])
            along = np.eye(3)[wide]
            points = [goal + along * side for side in _sides(half[wide])]
            if thing.goal_kind == "worktop":
                points = self._worktop(goal, half)
        free = [
            point
            for point in points
            if all(np.linalg.norm((point - other)[:2]) > 0.1 or abs(point[2] - other[2]) > 0.15 for other in others)
        ]
        return [(point, into) for point in free or points]

    def _worktop(self, goal: Array, half: Array) -> list[Array]:
        """Returns points of a worktop in reach, the nearest to the middle of what the hand reaches first."""
        grid = [
            goal + np.array([x, y, 0.0])
            for x in np.arange(-half[0] + 0.07, half[0] - 0.06, 0.06)
            for y in np.arange(-half[1] + 0.07, half[1] - 0.06, 0.06)
        ]
        return sorted(grid, key=lambda point: abs(float(np.linalg.norm((point - robot_base())[:2])) - 0.52))[:8]

    def _into(self, goal: Array) -> Array:
        """Returns the direction into a place with a front, by the side of the robot on which it is."""
        x, y, _ = goal - robot_base()
        if y > abs(x) * 0.6:
            return np.array([0.0, 1.0, 0.0])
        return np.array([np.sign(x), 0.0, 0.0])

    def _touches(
        self, knots: list[Array], number: int | None, held: mink.SE3 | None, *, first_only: bool = False
    ) -> int:
        """Returns at how many joint positions, `(7,)` and between them, the robot touches something.

        What is carried counts as touching where it tilts too far.

        Args:
          knots: joint positions [rad].
          number: of the object that the fingers may touch; None for none.
          held: its pose in the hand, if it is carried.
          first_only: whether to stop at the first touch.
        """
        model, data = self._physics.model.ptr, self._data
        data.qpos[:] = self._qpos
        kinematics = arm_model().kinematics
        own = self._geoms[number] if number is not None else np.zeros_like(self._robot)
        touches = 0
        for start, end in itertools.pairwise(knots):
            count = max(1, int(np.ceil(np.abs(end - start).max() / _CHECKED)))
            for share in np.arange(1, count + 1) / count:
                joints = start + share * (end - start)
                data.qpos[:7] = joints
                data.qpos[7:9] = 0.03
                if held is not None and number is not None:
                    pose = kinematics.forward(joints) @ held
                    if pose.rotation().as_matrix()[2, 2] < _LEAST_UPRIGHT:
                        touches += 1
                        if first_only:
                            return touches
                    self._set(self._columns[number], pose)
                mujoco.mj_kinematics(model, data)
                mujoco.mj_comPos(model, data)
                mujoco.mj_collision(model, data)
                pairs, distances = data.contact.geom[: data.ncon], data.contact.dist[: data.ncon]
                moving = self._robot | (own if held is not None else False)
                mine = moving[pairs]
                # Of what moves with something else, or of the robot with itself.
                apart = mine.any(axis=1) & ~mine.all(axis=1)
                itself = self._robot[pairs].all(axis=1) & ~self._hand[pairs].all(axis=1) & (distances < 0.0)
                fingers = self._hand[pairs].any(axis=1) & own[pairs].any(axis=1)
                keeps_off = (self._robot & ~self._fingers)[pairs].any(axis=1) & ~own[pairs].any(axis=1)
                near = distances < np.where(keeps_off, _MARGIN, 0.0)
                touches += bool(((apart & near & ~fingers) | itself).any())
                if touches and first_only:
                    return touches
        return touches

    def _set(self, column: int, pose: mink.SE3) -> None:
        """Sets the pose of an object."""
        self._data.qpos[column : column + 3] = pose.translation()
        self._data.qpos[column + 3 : column + 7] = pose.rotation().wxyz


def _sides(half: float) -> list[float]:
    """Returns offsets from the middle of a place of some half width at which objects are put [m]."""
    reach = max(float(half) - 0.06, 0.0)
    return sorted({0.0, min(_BESIDE, reach), -min(_BESIDE, reach)}, key=abs)


def _azimuth(vector: Array) -> float:
    """Returns the direction of a vector, seen from above [rad]."""
    return float(np.arctan2(vector[1], vector[0]))


_kitchen = functools.lru_cache(maxsize=16)(_ObjectKitchen)
