"""The expert of generated kitchens, which moves parts by their kind: axis, travel and handle come from the design."""

import collections
import dataclasses
import functools
import itertools
from collections.abc import Iterator
from typing import Any, NamedTuple, Self

import mink
import mujoco
import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities.fixtures import BAR_RADIUS, CLEARANCE, Part
from kitchen_suite.entities.generated_kitchen import MAX_PARTS, build_generated_kitchen
from kitchen_suite.entities.kitchen_designs import KitchenDesign
from kitchen_suite.entities.props import Prop
from kitchen_suite.entities.scenes import robot_base
from kitchen_suite.kitchen_tasks import REVERSES
from kitchen_suite.policies.experts import kitchen_skills, skills
from kitchen_suite.policies.experts.base import Expert, MotionStyle
from kitchen_suite.policies.experts.encoders import ActionEncoder, make_encoder
from kitchen_suite.policies.experts.kinematics import ARM, ArmKinematics
from kitchen_suite.policies.experts.kitchen import HOME, arm_model, scene
from kitchen_suite.policies.experts.kitchen_skills import AT_RESET, BACK, DOWN, FIXED_SKILLS, SKILLS, direction
from kitchen_suite.policies.experts.skills import ArcMove, HandOrientation, Move, Prismatic, Revolute, Skill
from kitchen_suite.policies.experts.trajectories import OUT_OF_REACH, JointSpeedLimits, JointTrajectory, plan
from kitchen_suite.tasks.control_modes.registry import make_mode
from kitchen_suite.tasks.generated_kitchens import mdp
from kitchen_suite.tasks.generated_kitchens.mdp import SLICES, size
from kitchen_suite.tasks.generated_kitchens.slots import SLOT_SIZE, SLOT_SLICES, SlotSensors
from kitchen_suite.tasks.generated_kitchens.task import GeneratedKitchenTask
from kitchen_suite.tasks.kitchen.control_modes import CONTROL_MODES, POSITION_HIGH, POSITION_LOW
from kitchen_suite.tasks.kitchen.goals import GOALS
from kitchen_suite.types import Array, Vector

# Openings at which the expert leaves a part, some noise beyond those that count.
OPENED, _SHUT = mdp.OPEN + 0.02, mdp.CLOSED - 0.02

# How far the hand takes a part, as an opening: what it pulls lags behind. How far beyond its stop it turns a knob off.
_PULLED, _PRESSED = 1.1, 0.25

_SETTLE_STEPS = 6  # Control steps from the end of a trajectory to the failure of its task.

# Distance beside a bar at which the closed hand pushes the front, and at which it pushes a sliding door's bar [m].
_BESIDE, _ALONG = 0.05, BAR_RADIUS + 0.02

# Distances of the site from a bar: far, near, at the grasp [m].
_DISTANCES, _KNOB_DISTANCES = (0.15, 0.08, 0.015), (0.15, 0.1, 0.04)

# What is tried, the usual ones first: pitches and yaws of the hand [rad], pitches at knobs [degrees], and turns of the
# kitchen's skills [rad].
_PITCHES = tuple(np.radians([-10.0, 15.0, -35.0, 40.0, -60.0]).tolist())
_YAWS = tuple(np.radians([0.0, 25.0, -25.0, 50.0, -50.0]).tolist())
_KNOB_PITCHES, _KNOB_YAWS = (-22.0, -10.0, -35.0, 5.0, -50.0), (4.0, 15.0, 30.0, -8.0)
_TURNS = (0.0, -0.12, 0.12, -0.24, 0.24, -0.5, 0.5)

_RATIOS = (-0.2, 0.4)  # Rotations of the hand with a door, as shares of the door's.
_ENOUGH_OF_ARC = 0.85  # Share of a door's arc that the hand must be able to follow.

# Number of motions that are kept for a task, to be tried one after the other, and of those that are looked for unless
# as many are free of contacts.
_ALTERNATIVES, _TRIED = 3, 12

_USUAL = 6  # Number of motions that are tried in the usual order.

# Joint positions from which inverse kinematics starts [rad], the first joint turned towards the handle. The last two
# were found by search: with them the hand reaches nearly all places that it reaches from any start.
SEEDS = (
    *(SKILLS[task].ik_seed for task in ("top burner", "kettle")),
    # The first of these with the elbow on the other side.
    (0.89, -0.78, -1.25, -2.28, -0.2, 1.46, -0.43),
    (-1.32, 1.23, 2.43, -1.89, -1.29, -0.27, 0.77),
    (1.87, 1.02, -2.15, -2.41, 1.16, 0.47, -2.34),
)

# Joint positions of the arm, each `(7,)` [rad].
_Seeds = tuple[tuple[float, ...], ...]

# Distance to the right of a knob's centre and above it at which the finger tips push its bar [m], and how far beyond
# its end they turn it [rad].
_LEVER, _BACK_BEYOND = 0.03, 0.4

_KETTLE_FURTHER = 0.05  # How much further than in the kitchen, whose goal is nearer, the hand pushes the kettle [m].
TUCKS = ((-0.33, 0.1, 2.05), (-0.25, 0.08, 2.2))  # Places of the hand near the robot, before it turns [m].
_REST_STEPS = 3  # Control steps in which the hand comes to rest before a part.
_MARGIN = 0.012  # Distance that counts as a contact of arm and hand, but for the fingers [m].
_CHECKED = 0.12  # Spacing of the joint positions at which a path is checked for collisions [rad].

_UP = np.array([0.0, 0.0, 1.0])


class Target(NamedTuple):
    """A part, by its index in the design, and whether it is to be open, on, or moved."""

    slot: int
    opens: bool


class PartExpert(Expert):
    """Does the tasks that a generated kitchen's observation asks for, one after the other; repeats those that fail."""

    control_modes = CONTROL_MODES

    def __init__(
        self,
        design: KitchenDesign,
        *,
        num_slots: int = MAX_PARTS,
        style: MotionStyle | None = None,
        control_mode: str = "joint_velocity",
        **control_options: Any,
    ) -> None:
        """Builds an expert for a kitchen of which `num_slots` slots are observed; others as of every `Expert`."""
        self._kitchen, self.observation_size = parts_of(design), size(num_slots)
        super().__init__(style, make_encoder(make_mode(control_mode, CONTROL_MODES, control_options), arm_model()))

    @classmethod
    def _task_settings(cls, task: GeneratedKitchenTask) -> dict[str, Any]:
        return {"design": task.scene.design, "num_slots": task.mdp.num_slots}

    def reset(self, generator: np.random.Generator) -> None:
        super().reset(generator)
        self._present: Target | None = None
        self._failures: collections.Counter[Target | None] = collections.Counter()
        self._targets: list[Target] = []

    def robot_positions(self, observation: Array) -> Array:
        return observation[SLICES["joint_positions"]]

    def _next_trajectory(self, observation: Array, joints: Array) -> JointTrajectory | None:
        rows = observation[SLICES["slots"]].reshape(-1, SLOT_SIZE)
        requested = rows[rows[:, SLOT_SLICES["requested"].start] > 0.5]
        openings = requested[:, SLOT_SLICES["opening"].start]
        goals = requested[:, SLOT_SLICES["goal"].start] > 0.5
        done = np.where(goals, openings >= OPENED, openings <= _SHUT)
        if self._trajectory is None:
            self._targets = [self._kitchen.find(row) for row in requested]
        elif self._present is None or not done[self._targets.index(self._present)]:
            if done.all() or not self._has_ended(_SETTLE_STEPS):
                return None
            self._failures[self._present] += 1
        rest = JointTrajectory.stationary(joints, skills.OPEN)
        return self._then_next(self._plan_retreat(joints) if self._present else rest, done, openings)

    def _then_next(self, trajectory: JointTrajectory, done: Array, openings: Array) -> JointTrajectory:
        """Appends the trajectory of the next task that is not done: that with the fewest failures, in order."""
        pending = [target for target, is_done in zip(self._targets, done, strict=True) if not is_done]
        self._present = target = min(pending, key=self._failures.__getitem__, default=None)
        if target is None:
            return trajectory
        opening = float(openings[self._targets.index(target)])
        motions = self._kitchen.motions(target, round(opening, 1), self.encoder)
        motion = motions[self._failures[target] % len(motions)]
        self._skill = motion.skill
        planned = self._plan(motion.skill, frame=motion.frame, object_position=motion.position)
        path, _ = self._kitchen.path(trajectory.knots[-1], planned.knots[0], target, opening, self.encoder.turns_hand)
        for joints in path:
            trajectory = trajectory.then(JointTrajectory.stationary(joints, skills.OPEN), self._limits)
        return trajectory.then(planned, self._limits)


@functools.cache
def tuck_posture(place: Vector) -> tuple[float, ...]:
    """Joint positions with the hand at a place near the robot [rad]."""
    kinematics = arm_model().kinematics
    rotation = kinematics.forward(HOME[ARM]).rotation()
    pose = mink.SE3.from_rotation_and_translation(rotation, np.array(place))
    return tuple(kinematics.inverse(pose, start=HOME[ARM]).tolist())


def _tucked(joints: Array, place: Vector, turns_hand: bool) -> Array:
    """Joint positions `(7,)` with the hand near the robot, in the direction in which it is at others `(7,)` [rad]."""
    kinematics = arm_model().kinematics
    aimed = np.array(aimed_posture(tuck_posture(place), kinematics.forward(joints).translation()))
    if turns_hand:
        return aimed
    there = kinematics.forward(aimed).translation()
    return kinematics.inverse(mink.SE3.from_rotation_and_translation(AT_RESET.rotation, there), start=HOME[ARM])


class Motion(NamedTuple):
    """A skill for a part where it stands: the skill's frame in the world, and position of its object joint [rad, m]."""

    skill: Skill
    frame: mink.SE3
    position: Array

    @classmethod
    def of(cls, skill: Skill, frame: mink.SE3, position: Array, seed: tuple[float, ...]) -> Self:
        """Returns the motion of a skill that rests before the part, as the hand may come from any side."""
        rested = dataclasses.replace(skill.lines[0], settle_steps=_REST_STEPS)
        return cls(dataclasses.replace(skill, moves=(rested, *skill.moves[1:]), ik_seed=seed), frame, position)

    def with_hand(self, rotation: mink.SO3) -> Self:
        """Returns this motion with the hand's orientation in the world the same in all moves."""
        orientation = HandOrientation.from_rotation(self.moved_frame.rotation().inverse() @ rotation)
        return self._replace(skill=self.skill.with_orientation(orientation))

    def in_reached_posture(self, kinematics: ArmKinematics) -> Self:
        """Returns this motion in the posture to which the arm comes on a straight way from near the robot."""
        end = self.moved_frame @ self.skill.lines[0].pose
        joints = np.array(aimed_posture(tuck_posture(TUCKS[0]), end.translation()))
        start = kinematics.forward(joints)
        for share in np.linspace(0.1, 1.0, 10):
            place = start.translation() + share * (end.translation() - start.translation())
            rotation = start.interpolate(end, alpha=share).rotation()
            joints = kinematics.inverse(mink.SE3.from_rotation_and_translation(rotation, place), start=joints)
        return self._replace(skill=dataclasses.replace(self.skill, ik_seed=tuple(joints.tolist())))

    @property
    def moved_frame(self) -> mink.SE3:
        """Frame of the skill's poses in the world, which move with the object."""
        joint = self.skill.object_joint
        return self.frame @ joint.displacement(self.position) if joint else self.frame

    def planned(self, kinematics: ArmKinematics, limits: JointSpeedLimits) -> JointTrajectory:
        """Returns the trajectory without jitter."""
        return plan(kinematics, limits, self.skill, frame=self.frame, object_position=self.position)

    def is_near(self, kinematics: ArmKinematics) -> bool:
        """Whether the arm reaches the first and the last place of the hand, which takes less time than a plan."""
        joints, frame = np.array(self.skill.ik_seed), self.moved_frame
        for move in (self.skill.lines[0], self.skill.lines[-1]):
            pose = frame @ move.pose
            joints = kinematics.inverse(pose, start=joints)
            if np.linalg.norm(kinematics.forward(joints).translation() - pose.translation()) > OUT_OF_REACH:
                return False
        return True


class _Kitchen:
    """The parts of a kitchen, and motions for them."""

    def __init__(self, design: KitchenDesign) -> None:
        built = build_generated_kitchen(design, visuals=False)
        self.parts = tuple(part for _, part in built.parts)
        self.names = built.part_names
        self._physics = physics = mjcf.Physics.from_mjcf_model(built.arena.mjcf_model)
        self._data = mujoco.MjData(physics.model.ptr)
        sensors = SlotSensors(built)
        sensors.bind(physics)
        self.slots, self._columns = sensors.slots, sensors.columns
        # Geoms of the robot, of hand and fingers, and those that the hand may touch when it moves a part.
        names = [physics.model.id2name(body, "body") for body in physics.model.geom_bodyid]
        self._robot = np.array([name.startswith("franka/") for name in names])
        self._hand = self._robot & [name.endswith(("finger", "hand")) for name in names]
        self._touchable = np.array([_may_touch(built.props[name], part, names) for name, part in built.parts])
        self._all = np.ones_like(self._robot)
        # The arm lags behind what is planned; the fingers must come near.
        fingers = np.array([name.endswith("finger") for name in names])
        physics.model.geom_margin[self._robot & ~fingers] = _MARGIN
        self._motions: dict[tuple[Target, float, bool, JointSpeedLimits], list[Motion]] = {}

    def find(self, row: Array) -> Target:
        """Returns the part of a slot of an observation, and what is asked of it."""
        opening = row[SLOT_SLICES["opening"]][0]
        joints = self.slots.opened * opening
        handle = row[SLOT_SLICES["position"]] + robot_base()
        positions, _, _ = self.slots.moved(joints, handle)
        apart = np.linalg.norm(positions - handle, axis=-1)
        apart[(self.slots.kind != row[SLOT_SLICES["kind"]]).any(axis=-1)] = np.inf
        return Target(int(apart.argmin()), bool(row[SLOT_SLICES["goal"]][0] > 0.5))

    def motions(self, target: Target, opening: float, encoder: ActionEncoder) -> list[Motion]:
        """Returns motions for a part at an opening that the arm can follow, at most three; the best one if none is.

        Those come first on which the robot touches the least, but for the part.
        """
        turns_hand, limits = encoder.turns_hand, encoder.limits
        key = target, opening, turns_hand, limits
        if key not in self._motions:
            kinematics, best, found = arm_model().kinematics, None, []
            for motion in self._candidates(target, opening, encoder):
                if best is not None and not motion.is_near(kinematics):
                    continue
                motion = motion if encoder.sets_posture or not turns_hand else motion.in_reached_posture(kinematics)
                planned = motion.planned(kinematics, limits)
                badness = planned.position_error + 1.0 - planned.arc_share
                if best is None or badness < best[0]:
                    best = badness, motion
                beyond = (planned.knots < POSITION_LOW[ARM]) | (planned.knots > POSITION_HIGH[ARM])
                if not planned.is_reachable or planned.arc_share < _ENOUGH_OF_ARC or beyond.any():
                    continue
                _, touches = self.path(HOME[ARM], planned.knots[0], target, opening, turns_hand)
                touches += self._touches(list(planned.knots), target, opening, ~self._touchable[target.slot])
                touches += self._touches([planned.knots[-1]] * 2, target, float(target.opens), self._all & ~self._hand)
                found.append((touches, motion))
                if sum(count == 0 for count, _ in found) == _ALTERNATIVES or len(found) == _TRIED:
                    break
            assert best is not None, "there is at least one candidate"
            ordered = [motion for _, motion in sorted(found, key=lambda each: each[0])]
            self._motions[key] = ordered[:_ALTERNATIVES] or [best[1]]
        return self._motions[key]

    def path(
        self, start: Array, end: Array, target: Target, opening: float, turns_hand: bool
    ) -> tuple[list[Array], int]:
        """Returns joint positions on the way from one `(7,)` to another on which the robot touches the least.

        Also returns at how many joint positions it touches something. The way goes by places near the robot, if it can.
        """
        found: list[tuple[list[Array], int]] = []
        for tuck in TUCKS:
            near = [_tucked(joints, tuck, turns_hand) for joints in (start, end)]
            for path in (near, near[:1], near[1:], []):
                found.append((path, self._touches([start, *path, end], target, opening, self._all)))
                if not found[-1][1]:
                    return found[-1]
        return min(found, key=lambda each: each[1])

    def _touches(self, knots: list[Array], target: Target, opening: float, among: NDArray[np.bool_]) -> int:
        """Returns at how many joint positions, `(7,)` and between them, the robot touches something or itself.

        All parts but the target are closed; contacts count between geoms that are `among` `(geoms,)`.
        """
        model, data = self._physics.model.ptr, self._data
        data.qpos[:] = model.qpos0
        if self.parts[target.slot].joint is not None:
            data.qpos[self._columns[target.slot]] = self.slots.opened[target.slot] * opening
        touches = 0
        for start, end in itertools.pairwise(knots):
            count = max(1, int(np.ceil(np.abs(end - start).max() / _CHECKED)))
            for share in np.arange(1, count + 1) / count:
                data.qpos[:7] = start + share * (end - start)
                mujoco.mj_kinematics(model, data)
                mujoco.mj_comPos(model, data)
                mujoco.mj_collision(model, data)
                pairs, distances = data.contact.geom[: data.ncon], data.contact.dist[: data.ncon]
                of_robot = self._robot[pairs].any(axis=1) & ~self._hand[pairs].all(axis=1)
                near = distances < np.where(self._robot[pairs].all(axis=1), 0.0, _MARGIN)
                touches += bool((of_robot & near & among[pairs].all(axis=1)).any())
        return touches

    def _candidates(self, target: Target, opening: float, encoder: ActionEncoder) -> Iterator[Motion]:
        """Yields motions to be tried; the hand keeps its orientation at the reset where the mode cannot turn it."""
        # Where the mode chooses the posture, only such as it comes to; `led` finds the one where the hand turns.
        count = None if encoder.sets_posture else int(not encoder.turns_hand)
        seeds = (tuck_posture(TUCKS[0]), *SEEDS[:count])
        part, turns_hand = self.parts[target.slot], encoder.turns_hand
        # A hand that cannot turn pushes knobs of stoves as it does those of the oven.
        twin = part.twin if turns_hand or part.kind != "knob" else "top burner"
        motions: Iterator[Motion] = iter(())
        if twin is not None:
            motions = self._twins(twin, target, opening, seeds, turns_hand)
        if twin is None or part.kind == "door":
            motions = itertools.chain(motions, self._own_motions(target, opening, seeds, turns_hand))
        return motions if turns_hand else (motion.with_hand(AT_RESET.rotation) for motion in motions)

    def _own_motions(self, target: Target, opening: float, seeds: _Seeds, turns_hand: bool) -> Iterator[Motion]:
        """Yields motions by the axis and the handle of a part."""
        position, axis = self.slots.opened[target.slot] * opening, self.slots.axis[target.slot]
        pairs = list(itertools.product(seeds, self._skills(target, float(position), turns_hand)))
        # After the usual ones, those that differ from them in all respects.
        usual = min(_USUAL, len(pairs))
        others = np.random.default_rng(0).permutation(np.arange(usual, len(pairs)))
        for seed, skill in (pairs[i] for i in (*range(usual), *others)):
            moved = np.array([position]) if isinstance(skill.object_joint, Revolute) else axis * position
            yield Motion.of(skill, mink.SE3.identity(), moved, aimed_posture(seed, self.slots.position[target.slot]))

    def _twins(self, twin: str, target: Target, opening: float, seeds: _Seeds, turns_hand: bool) -> Iterator[Motion]:
        """Yields the skill of the kitchen's task for a part like it, moved to where the part is."""
        reverses = {task: reverse for reverse, task in REVERSES.items()}
        task, k, part = (twin if target.opens else reverses[twin], target.slot, self.parts[target.slot])
        skill, handle = (SKILLS if turns_hand else FIXED_SKILLS)[task], _default_handles()[twin]
        into = self.slots.into[k]
        yaw = np.arctan2(-into[0], into[1]) - (_MICROWAVE_YAW if twin == "microwave" else 0.0)
        turn = mink.SO3.from_z_radians(float(yaw))
        frame = mink.SE3.from_rotation_and_translation(turn, self.slots.position[k] - turn.apply(handle))
        position = np.array([self.slots.opened[k] * opening])
        if part.joint is None:
            assert isinstance(skill.object_joint, Prismatic)
            position = np.add(skill.object_joint.initial_position, (0.0, part.opened * opening, 0.0))
            x, y, z = skill.lines[-1].position
            last = dataclasses.replace(skill.lines[-1], position=(x, y + _KETTLE_FURTHER, z))
            skill = dataclasses.replace(skill, moves=(*skill.moves[:-1], last))
        if part.kind == "knob":
            x, _, height = handle
            seeds = (*seeds[1:2], seeds[0], *seeds[2:])
            angles = itertools.product(_KNOB_YAWS, _KNOB_PITCHES) if turns_hand else [(0.0, 0.0)]
            for seed, (yaw, pitch) in itertools.product(seeds, angles):
                turned = (HandOrientation(approach=direction(each, pitch), spread=DOWN) for each in (yaw, -yaw))
                hand, mirrored = turned if turns_hand else (AT_RESET, AT_RESET)
                aimed = aimed_posture(seed, self.slots.position[k])
                if target.opens:
                    angle = kitchen_skills.KNOB_ANGLE if turns_hand else kitchen_skills.FIXED_KNOB_ANGLE
                    yield Motion.of(kitchen_skills.turn_knob(x, height, hand, angle), frame, position, aimed)
                    continue
                # Around the lower end from the left, or against the upper end from the right.
                yield Motion.of(kitchen_skills.turn_knob_back(x, height, hand), frame, position, aimed)
                yield Motion.of(_turn_back(handle, mirrored), frame, position, aimed)
            return
        for angle in _TURNS if turns_hand else (0.0,):
            yield Motion.of(skill.turned(angle) if angle else skill, frame, position, skill.ik_seed)

    def _skills(self, target: Target, position: float, turns_hand: bool) -> Iterator[Skill]:
        """Yields skills for a part whose joint is at a position [rad, m], in the world with the part closed."""
        kind, opened = self.parts[target.slot].kind, self.parts[target.slot].opened
        handle = _Handle(*(getattr(self.slots, field)[target.slot] for field in _Handle._fields))
        right = np.cross(handle.into, _UP)
        for pitch, yaw in itertools.product(_PITCHES, _YAWS) if turns_hand else [(0.0, 0.0)]:
            about = mink.SO3.from_z_radians(yaw)
            approach = skills.vector(about.apply(handle.into * np.cos(pitch) + _UP * np.sin(pitch)))
            for sign in (1.0, -1.0)[: 1 + turns_hand]:
                spreads = (skills.vector(sign * each) for each in (_UP, about.apply(right)))
                upright, level = (HandOrientation(approach=approach, spread=spread) for spread in spreads)
                if not turns_hand:
                    upright = level = AT_RESET
                match kind, target.opens:
                    case "drawer", True:
                        yield handle.pull_drawer(upright, opened * _PULLED - position)
                    case "drawer", False:
                        yield handle.push_drawer(level, position)
                    case "door", True:
                        for ratio in _RATIOS:
                            yield handle.swing(level, opened * _PULLED, ratio)
                    case "knob", _:
                        angle = opened * (_PULLED if target.opens else -_PRESSED)
                        yield handle.swing(level, angle, 1.0, _KNOB_DISTANCES)
                    case "door", False:
                        for share in (1.0, 0.5):
                            turned = mink.SO3.exp(-share * position * handle.axis)
                            hand = HandOrientation.from_rotation(turned @ upright.rotation)
                            yield handle.shut(hand, np.sign(opened) * right)
                        for ratio in _RATIOS:
                            yield handle.swing(level, 0.0, ratio)
                    case _:
                        distance = abs(opened) * _PULLED - abs(position) if target.opens else -abs(position) - 0.01
                        yield handle.slide(upright, handle.axis * np.sign(opened), distance)


class _Handle(NamedTuple):
    """A handle with its part closed, in the world, and the skills that move the part by it; vectors as in `Slots`."""

    position: Array
    into: Array
    axis: Array
    anchor: Array

    @property
    def front(self) -> Array:
        """Point of the front behind the handle [m]."""
        return self.position + self.into * CLEARANCE

    @property
    def hinge(self) -> Revolute:
        """The joint of a part that swings."""
        return Revolute(elements=(0,), anchor=skills.vector(self.anchor), axis=skills.vector(self.axis))

    def _skill(self, moves: tuple[Move | ArcMove, ...], joint: Revolute | Prismatic, release_steps: int = 0) -> Skill:
        """Skill without a seed, which its motions add."""
        retreat = skills.vector(-0.1 * self.into)
        return Skill(moves=moves, ik_seed=(), object_joint=joint, retreat=retreat, release_steps=release_steps)

    def pull_drawer(self, hand: HandOrientation, distance: float) -> Skill:
        """Skill that grasps a drawer's bar and pulls the drawer out by a distance [m]."""
        moves = kitchen_skills.grasp(skills.vector(self.position), hand, _DISTANCES, settle_steps=4)
        end = skills.vector(np.array(moves[-1].position) - self.into * distance)
        pull = Move(position=end, orientation=hand, fingers=skills.CLOSED, speed=0.4)
        return self._skill((*moves, pull), _ANY_WAY, release_steps=3)

    def push_drawer(self, hand: HandOrientation, distance: float) -> Skill:
        """Skill that pushes the front of a drawer below its bar, by a distance [m]."""
        contact = self.front - _UP * _BESIDE
        tips = (contact - 0.12 * self.into, contact - 0.03 * self.into, contact + (distance + 0.02) * self.into)
        return self._skill(kitchen_skills.push([*map(skills.vector, tips)], hand, speed=0.4), _ANY_WAY)

    def swing(self, hand: HandOrientation, angle: float, ratio: float, distances: Vector = _DISTANCES) -> Skill:
        """Skill that grasps the bar of a door or of a knob and swings it to an angle [rad]."""
        moves = kitchen_skills.grasp(skills.vector(self.position), hand, distances, settle_steps=4)
        arc = ArcMove(angle=angle, hand_rotation_ratio=ratio, speed=1.0)
        return self._skill((*moves, arc), self.hinge, release_steps=3)

    def shut(self, hand: HandOrientation, side: Array) -> Skill:
        """Skill that pushes the front of a door shut, beside its bar on a side, the way to the hinges."""
        contact = self.front + side * _BESIDE
        tips = [skills.vector(contact - 0.12 * self.into), skills.vector(contact - 0.03 * self.into)]
        arc = ArcMove(angle=0.0, hand_rotation_ratio=0.3, speed=1.0)
        return self._skill((*kitchen_skills.push(tips, hand, speed=0.4), arc), self.hinge)

    def slide(self, hand: HandOrientation, way: Array, distance: float) -> Skill:
        """Skill that pushes the bar of a sliding door from its side, by a distance along the way that opens it [m]."""
        sign = np.sign(distance)
        contact = self.position + 0.02 * self.into - sign * _ALONG * way
        tips = (contact - 0.12 * self.into - sign * 0.03 * way, contact - sign * 0.02 * way, contact + distance * way)
        return self._skill(kitchen_skills.push([*map(skills.vector, tips)], hand, speed=0.5), _ANY_WAY)


def _turn_back(handle: Array, hand: HandOrientation) -> Skill:
    """Skill that turns a knob off by pushing the upper end of its bar to the left, from where it stands when off."""
    tip = np.add(handle, (_LEVER, 0.0, _LEVER))
    tips = [skills.vector(tip - (0.0, 0.07, 0.0)), skills.vector(tip)]
    pushes, arc = kitchen_skills.push(tips, hand, speed=1.0), ArcMove(angle=_BACK_BEYOND, speed=1.0)
    hinge = Revolute(elements=(0,), anchor=skills.vector(handle), axis=BACK)
    return Skill(moves=(*pushes, arc), ik_seed=(), object_joint=hinge, retreat=(0.0, -0.04, 0.0))


_ANY_WAY = Prismatic(elements=(0, 1, 2), initial_position=(0.0, 0.0, 0.0))  # Of an object that has moved by x, y and z.


def aimed_posture(seed: tuple[float, ...], handle: Array) -> tuple[float, ...]:
    """Returns joint positions with the first joint turned so that the hand is in the direction of a handle [rad]."""
    x, y, _ = arm_model().kinematics.forward(np.array(seed)).translation() - robot_base()
    turn = np.arctan2(handle[1], handle[0]) - np.arctan2(y, x)
    first = float((seed[0] + turn + np.pi) % (2 * np.pi) - np.pi)
    return (float(np.clip(first, -2.8, 2.8)), *seed[1:])


_MICROWAVE_YAW = 0.3  # Rotation of the microwave in the original kitchen [rad].


@functools.cache
def _default_handles() -> dict[str, Array]:
    """Positions of the handles in the original kitchen by task [m]."""
    physics = mjcf.Physics.from_mjcf_model(scene().arena.mjcf_model)
    return {task: np.array(physics.bind(goal.handle_in(scene())).xpos) for task, goal in GOALS.items()}


def _may_touch(prop: Prop, part: Part, bodies: list[str]) -> NDArray[np.bool_]:
    """Returns which geoms, of bodies of these names, the hand may touch when it moves a part.

    The geoms of the part, for one of the kitchen all of its prop, and for the kettle, which stands on the oven, any.
    """
    if part.joint is None:
        return np.ones(len(bodies), bool)
    joint = prop.mjcf_model.find("joint", part.joint)
    prefix = joint.parent.full_identifier if part.twin is None else f"{prop.mjcf_model.model}/"
    return np.array([body.startswith(prefix) for body in bodies])


parts_of = functools.lru_cache(maxsize=64)(_Kitchen)


def reached_handles(design: KitchenDesign) -> dict[str, bool]:
    """Returns whether the arm reaches each handle of a kitchen, for some motion that opens it, by name of the part."""
    kitchen, arm = parts_of(design), arm_model()
    encoder = make_encoder(make_mode("joint_velocity", CONTROL_MODES, {}), arm)
    motions = [kitchen.motions(Target(k, True), 0.0, encoder)[0] for k in range(len(kitchen.names))]
    reached = [motion.planned(arm.kinematics, encoder.limits).is_reachable for motion in motions]
    return dict(zip(kitchen.names, reached, strict=True))
