"""The expert of objects in generated kitchens: it opens what is closed, grasps an object, carries it and lets it go."""

import collections
import functools
import itertools
from collections.abc import Sequence
from typing import Any, NamedTuple

import mink
import mujoco
import numpy as np
from dm_control import mjcf

from kitchen_suite.entities.generated_kitchen import MAX_PARTS
from kitchen_suite.entities.kitchen_designs import SHOULDER, KitchenDesign
from kitchen_suite.entities.object_layouts import ObjectLayout
from kitchen_suite.entities.pick_and_place import build_pick_and_place
from kitchen_suite.entities.scenes import robot_base
from kitchen_suite.policies.experts import generated_kitchens as kitchens
from kitchen_suite.policies.experts import grasps, skills
from kitchen_suite.policies.experts.base import Expert, MotionStyle
from kitchen_suite.policies.experts.encoders import make_encoder
from kitchen_suite.policies.experts.grasps import End, Thing, orientation, things
from kitchen_suite.policies.experts.kinematics import ARM
from kitchen_suite.policies.experts.kitchen import arm_model
from kitchen_suite.policies.experts.path_planning import connect
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
from kitchen_suite.tasks.pick_and_place.mdp import SLICES, size
from kitchen_suite.tasks.pick_and_place.task import PickAndPlaceTask
from kitchen_suite.types import Array

_ENTRIES = (0.3, 0.2, 0.4)  # Distances from which the hand moves straight into a place with a front [m].
_ABOVE = 0.006  # Height above its support at which an object is let go [m].
_JOINT_SHARE = 0.5  # Share of the joints' greatest speeds with which objects are carried.
_TURN_SPEED = 0.8  # Speed with which the hand turns what it carries [rad/s].
# Half widths of the moving average of the motions with which objects are carried [control steps]: the first is taken
# with which nothing is touched, where it cuts a corner or where the way was checked too coarsely.
_SMOOTHINGS = (10.0, 5.0, 2.0)
_FEW = 3  # Number of joint positions at which the robot may brush against something where it cannot do without.
_LEAST_UPRIGHT = 0.6  # Least cosine of the tilt of what is carried.
_ATTEMPTS = 8  # Number of motions that are tried for an object.
_BESIDE_HAND = 0.15  # Distance of an object's base from the hand within which it counts as beside it [m].
_SETTLE_STEPS = 8  # Control steps from the end of a trajectory to the failure of its task.

# Pitches of the hand below the horizontal, and azimuths relative to the usual one, that are tried [rad].
_STEEP = tuple(np.radians([90.0, 65.0, 45.0, 25.0]).tolist())
_FLAT = tuple(np.radians([25.0, 12.0, 40.0, 0.0]).tolist())

_HAND_LENGTH = 0.2  # From the wrist to the finger tips [m].
_WRIST_REACH = 0.8  # Distance of the wrist from the shoulder beyond which no posture is looked for [m].
_SEEDS = 3  # Number of postures from which inverse kinematics starts for a pose of the hand.
_PER_PITCH = 4  # Number of poses that are kept for a pitch of the hand.
_TRIED = 16  # Number of poses that are tried for a pitch of the hand.
_FOUND = 3  # Number of motions of which the shortest is made.
_MOST = 16  # Number of pairs of a grasp and a place that are tried.
_MARGIN = 0.004  # Distance that counts as a contact of the arm [m].
_WIDE_MARGIN = 0.015  # The same on ways, of the arm and of what it carries, since the arm lags behind [m].
_CHECKED = 0.1  # Spacing of the joint positions at which a path is checked for collisions [rad].
_DEPTHS = (0.1, 0.07, 0.14)  # Depths behind the front of a place with a front at which an object is put [m].
_SAME_PLACE = 0.03  # Distance between the middles of two places that are the same [m].
_BESIDE = 0.09  # Distance from the middle of a place at which an object is put beside another one [m].


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
        asked = [thing for thing in things(observation) if thing.goal_kind]
        pending = [
            thing for thing in asked if thing.is_upright and not thing.is_done and self._failures[thing.row] < _ATTEMPTS
        ]
        if not pending:
            if self._is_beside(asked, joints):
                return self._leaving(joints)
            return None if self._trajectory is not None else JointTrajectory.stationary(joints, skills.OPEN)
        thing = min(pending, key=lambda each: self._failures[each.row])
        self._present = thing.row
        self._kitchen.see(observation)
        jitter = self._style.jitter
        offset = self._generator.uniform(-jitter, jitter, 3) if jitter else np.zeros(3)
        motion = self._kitchen.motion(thing, joints, self.encoder.limits, self._failures[thing.row], offset)
        # Others are looked for in the next attempt.
        return motion or JointTrajectory.stationary(joints, self._fingers)

    def _is_beside(self, asked: Sequence[Thing], joints: Array) -> bool:
        """Returns whether the open hand is beside an object that is where it is to be, and so has not let go."""
        hand = self._kinematics.forward(joints).translation()
        is_open = self._trajectory is not None and self._current_fingers == skills.OPEN
        return is_open and any(thing.is_done and np.linalg.norm(hand - thing.base) < _BESIDE_HAND for thing in asked)

    def _leaving(self, joints: Array) -> JointTrajectory:
        """Returns the motion that takes the hand upwards."""
        pose = self._kinematics.forward(joints)
        above = mink.SE3.from_rotation_and_translation(pose.rotation(), pose.translation() + grasps.LIFT * grasps.UP)
        leaving = JointTrajectory.stationary(self._kinematics.inverse(above, start=joints), skills.OPEN)
        return JointTrajectory.stationary(joints, skills.OPEN).then(leaving, self._limits)

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
        linear_speed=grasps.CARRY_SPEED,
        angular_speed=_TURN_SPEED,
    )


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
        physics.model.geom_margin[self._robot | self._geoms.any(axis=0)] = _WIDE_MARGIN
        # Of places with parts, the middle of the support when they stand wide open, and columns and positions of these.
        self._opened: list[tuple[Array, list[tuple[int, float]]]] = []
        for place in built.places:
            found = [built.joint_of(name) for name in place.parts]
            wide = [float(max(physics.bind(joint).range, key=abs)) for joint in found]
            shift = built.into(place) * -abs(wide[0]) if place.moves else 0.0
            columns = [int(physics.bind(joint).qposadr) for joint in found]
            if found:
                self._opened.append((place.centre + shift, [*zip(columns, wide, strict=True)]))

    def see(self, observation: Array) -> None:
        """Sets parts and objects as they are observed; parts of places that are asked for and not observed are open."""
        self._qpos = self._physics.model.ptr.qpos0.copy()
        self._things = things(observation)
        asked = [thing for thing in self._things if thing.goal_kind]
        for middle, positions in self._opened:
            supports = [thing.goal for thing in asked] + [each.within[0] for each in asked if each.within is not None]
            if any(np.linalg.norm(middle - support) < _SAME_PLACE for support in supports):
                for place, opened in positions:
                    self._qpos[place] = opened
        for row in observation[SLICES["slots"]].reshape(-1, SLOT_SIZE):
            if not row[SLOT_SLICES["kind"]].any():
                continue
            slot = self._parts.find(row).slot
            if (column := self._part_columns[slot]) is not None:
                self._qpos[column] = self._parts.slots.opened[slot] * row[SLOT_SLICES["opening"].start]
        # Observed objects by their index in the layout; which of two that are alike does not matter.
        self._numbers = self._match(self._things)
        for thing, number in zip(self._things, self._numbers, strict=True):
            column = self._columns[number]
            yaw = np.arctan2(thing.x_axis[1], thing.x_axis[0])
            self._qpos[column : column + 3] = thing.base + 0.002 * grasps.UP
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

    def motion(
        self, thing: Thing, start: Array, limits: JointSpeedLimits, attempt: int, offset: Array
    ) -> JointTrajectory | None:
        """Returns a motion from joint positions `(7,)` that puts an object where it is to be; None if none is found.

        The robot, and what it carries, touch nothing on the way. Each attempt looks elsewhere. The hand comes to the
        grasp from a place that is displaced by an offset `(3,)` [m].
        """
        generator = np.random.default_rng(attempt)
        number = self._numbers[thing.row]
        # What is held slips where the hand turns as fast as the joints can.
        slow = _slowed(limits)
        found_grasps = self._planned(number, self._ends_at(thing, generator), slow, offset, is_grasp=True)
        found_places = self._planned(number, self._ends_in(thing, generator), slow, np.zeros(3), is_grasp=False)
        pairs = [
            (grasp, place) for grasp in found_grasps for place in found_places if grasp.end.pitch == place.end.pitch
        ]
        pairs.sort(key=lambda pair: (pair[0].touches + pair[1].touches, pair[0].distance(pair[1])))
        found: list[tuple[int, JointTrajectory]] = []
        ways: dict[int, list[Array] | None] = {}
        for grasp, place in pairs[:_MOST]:
            first = id(grasp)
            if first not in ways:
                ways[first] = self._way(start, grasp.trajectory.knots[0], None, None, generator)
            way = ways[first]
            if way is None:
                continue
            held = self._held(number, grasp)
            carry = self._way(grasp.trajectory.knots[-1], place.trajectory.knots[0], number, held, generator)
            if carry is None:
                continue
            motion = JointTrajectory.stationary(start, skills.OPEN)
            for joints in way:
                motion = motion.then(JointTrajectory.stationary(joints, skills.OPEN), limits)
            motion = motion.then(grasp.trajectory, limits)
            for joints in carry:
                motion = motion.then(JointTrajectory.stationary(joints, skills.CLOSED), slow)
            found.append(self._smoothed(motion.then(place.trajectory, slow), number, held))
            if sum(not touches for touches, _ in found) == _FOUND:
                break
        _, shortest = min(found, key=lambda each: (each[0], each[1].duration), default=(0, None))
        return shortest

    def _smoothed(self, motion: JointTrajectory, number: int, held: mink.SE3) -> tuple[int, JointTrajectory]:
        """Returns a motion without sudden turns, and at how many of its control steps something is touched.

        It is the smoothest of those with the fewest touches. They count while the fingers are closed.
        """
        best: tuple[int, JointTrajectory] | None = None
        for window in _SMOOTHINGS:
            smoothed = motion.smoothed(window)
            closed = np.flatnonzero(smoothed.fingers == skills.CLOSED)
            touches = self._touches([*smoothed.knots[closed]], number, held)
            if best is None or touches < best[0]:
                best = touches, smoothed
            if not touches:
                break
        assert best is not None
        return best

    def _way(
        self, first: Array, last: Array, number: int | None, held: mink.SE3 | None, generator: np.random.Generator
    ) -> list[Array] | None:
        """Returns joint positions on a way on which nothing is touched, or None if none is found."""

        def free(start: Array, end: Array) -> bool:
            return not self._touches([start, end], number, held, first_only=True, margin=_WIDE_MARGIN)

        return connect(first, last, free, (POSITION_LOW[ARM], POSITION_HIGH[ARM]), generator)

    def _planned(
        self, number: int, ends: Sequence[End], limits: JointSpeedLimits, offset: Array, *, is_grasp: bool
    ) -> list[PlannedEnd]:
        """Returns those of some ends whose motions the arm can follow, those first on which it touches the least."""
        found = []
        for end in ends:
            skill = end.grasping() if is_grasp else end.placing()
            trajectory = plan(arm_model().kinematics, limits, skill, offsets=[offset])
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
            local, azimuths = grasps.hold(thing, pitch)
            choices = list(itertools.product(azimuths, _ENTRIES if thing.within is not None else (0.0,)))
            count = 0
            for k in generator.permutation(len(choices)).tolist():
                azimuth, entry = choices[k]
                at = thing.base + mink.SO3.from_z_radians(azimuth).apply(local)
                end = End.make(
                    pitch, azimuth, at, entry, at - grasps.FAR * np.array(orientation(azimuth, pitch).approach)
                )
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
        has_front = thing.goal_kind not in grasps.FROM_ABOVE
        number = self._numbers[thing.row]
        for pitch in self._pitches(thing):
            local, _ = grasps.hold(thing, pitch)
            choices = list(itertools.product(spots, grasps.TURNS, _ENTRIES if has_front else (0.0,)))
            count = 0
            for k in generator.permutation(len(choices)).tolist()[:_TRIED]:
                (spot, front), turn, entry = choices[k]
                azimuth = grasps.azimuth_of(front if has_front else spot - robot_base()) + turn
                turned = mink.SO3.from_z_radians(azimuth)
                at = spot + turned.apply(local) + _ABOVE * grasps.UP
                end = End.make(pitch, azimuth, at, entry, at + grasps.LIFT * grasps.UP)
                held = end.pose(end.at).inverse() @ mink.SE3.from_rotation_and_translation(
                    turned, spot + _ABOVE * grasps.UP
                )
                solved = self._solved(end, spot, number, held, generator)
                found += solved
                count += len(solved)
                if count >= _PER_PITCH:
                    break
        return found

    def _pitches(self, thing: Thing) -> tuple[float, ...]:
        """Returns the pitches of the hand in which an object may be carried from where it is to where it is to be."""
        return _STEEP if thing.goal_kind in grasps.FROM_ABOVE and thing.within is None else _FLAT

    def _solved(
        self, end: End, towards: Array, number: int, held: mink.SE3 | None, generator: np.random.Generator
    ) -> list[End]:
        """Returns an end with joint positions in which the arm reaches it, and what is before it, and touches nothing.

        Empty if there are none. `held` is the pose of the object in the hand, None before it is grasped.
        """
        kinematics = arm_model().kinematics
        wrist = end.at - _HAND_LENGTH * np.array(end.hand.approach)
        if np.linalg.norm(wrist - robot_base() - SHOULDER * grasps.UP) > _WRIST_REACH:
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
        if thing.goal_kind not in grasps.FROM_ABOVE:
            into = self._into(goal)
            along = np.abs(np.cross(grasps.UP, into))
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
        self,
        knots: list[Array],
        number: int | None,
        held: mink.SE3 | None,
        *,
        first_only: bool = False,
        margin: float = 0.0,
    ) -> int:
        """Returns at how many joint positions, `(7,)` and between them, the robot touches something.

        What is carried counts as touching where it tilts too far.

        Args:
          knots: joint positions [rad].
          number: of the object that the fingers may touch; None for none.
          held: its pose in the hand, if it is carried.
          first_only: whether to stop at the first touch.
          margin: distance that counts as a touch, of the arm at least `_MARGIN` [m].
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
                near = distances < np.where(keeps_off, max(margin, _MARGIN), margin)
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


_kitchen = functools.lru_cache(maxsize=16)(_ObjectKitchen)
