"""The Markov decision process of generated kitchens: slots of parts, requests, success, reward, observation.

Every kitchen has the same number of slots, one for each part that moves, and empty ones. What differs from kitchen to
kitchen is part of the state, so that one MDP steps episodes in many kitchens together.
"""

import dataclasses
import functools
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple, Self

import mujoco
import numpy as np
import tree
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities.fixtures import PART_KINDS, Part
from kitchen_suite.entities.generated_kitchen import MAX_PARTS, GeneratedKitchen
from kitchen_suite.entities.scenes import Scene, robot_base
from kitchen_suite.tasks import rotations
from kitchen_suite.tasks.completion_mdp import CompletionMDP
from kitchen_suite.tasks.goals import Progress
from kitchen_suite.tasks.orders import order_info
from kitchen_suite.tasks.rewards import CompletionStep, Shares, SharesStep, covered
from kitchen_suite.tasks.simulation import Columns, Simulation, as_columns
from kitchen_suite.tasks.terms import Observation, Transition, end_to_end
from kitchen_suite.types import Array

OPEN = 0.75  # Opening from which a part counts as open or on, as a share.
CLOSED = 0.15  # Opening up to which a part counts as closed or off, as a share.


# Elements of a slot in the observation.
SLOT_SLICES = end_to_end(
    {"kind": 6, "position": 3, "offset": 3, "into": 3, "along": 3, "opening": 1, "goal": 1, "requested": 1}
)
SLOT_SIZE = SLOT_SLICES["requested"].stop

# Parts of the flat observation, which ends earlier where fewer slots are observed.
SLICES = end_to_end({"joint_positions": 9, "joint_velocities": 9, "hand_pose": 9, "slots": MAX_PARTS * SLOT_SIZE})
SIZE = SLICES["slots"].stop


def size(num_slots: int) -> int:
    """Returns the number of elements of an observation with a number of slots."""
    return SLICES["slots"].start + num_slots * SLOT_SIZE


# Greatest noise at a noise ratio of 1.
_ROBOT_AMPLITUDE = 0.1  # Of joint positions [rad, m] and velocities [rad/s, m/s].
_HANDLE_AMPLITUDE = 0.2  # Of handles [m].
_OPENING_AMPLITUDE = 0.5  # Of openings, as a share.

# Parts of the noise.
_NOISE = end_to_end({"positions": 9, "velocities": 9, "handles": 3 * MAX_PARTS, "openings": MAX_PARTS})
NOISE_SIZE = _NOISE["openings"].stop
NOISE_SLICES = MappingProxyType(
    {"robot_noise": slice(0, _NOISE["handles"].start), "object_noise": slice(_NOISE["handles"].start, NOISE_SIZE)}
)


class Slots(NamedTuple):
    """The parts of a kitchen, which do not change; empty slots hold zeros.

    Attributes:
      kind: `(..., K, 6)`, 1 at the index of its kind in `PART_KINDS`.
      opened: `(..., K)`, joint position at an opening of 1 [rad, m]; 1 in empty slots.
      has_joint: `(..., K)`, whether the part has a joint, as all but the kettle have.
      is_hinge: `(..., K)`, whether the joint is a hinge.
      is_free: `(..., K)`, whether the part has no joint: the kettle.
      position: `(..., K, 3)`, of the handle while the joint is at 0 [m].
      into: `(..., K, 3)`, direction into the fixture at the handle, at 0.
      along: `(..., K, 3)`, direction along the handle's bar, at 0.
      axis: `(..., K, 3)`, of the joint.
      anchor: `(..., K, 3)`, a point on the axis of a hinge [m].
      target: `(..., K, 3)`, where a free part is to be [m].
      lift: `(..., 3)`, position of the kettle's handle in the frame of the kettle [m].
    """

    kind: Array
    opened: Array
    has_joint: NDArray[np.bool_]
    is_hinge: NDArray[np.bool_]
    is_free: NDArray[np.bool_]
    position: Array
    into: Array
    along: Array
    axis: Array
    anchor: Array
    target: Array
    lift: Array

    @classmethod
    def of(cls, scene: GeneratedKitchen, physics: mjcf.Physics) -> Self:
        """Returns the slots of a kitchen, from its compiled model at rest with all joints at 0."""
        arrays = cls(
            kind=np.zeros((MAX_PARTS, len(PART_KINDS))),
            opened=np.ones(MAX_PARTS),
            has_joint=np.zeros(MAX_PARTS, bool),
            is_hinge=np.zeros(MAX_PARTS, bool),
            is_free=np.zeros(MAX_PARTS, bool),
            **{name: np.zeros((MAX_PARTS, 3)) for name in ("position", "into", "along", "axis", "anchor", "target")},
            lift=np.zeros(3),
        )
        model, data = physics.model.ptr, mujoco.MjData(physics.model.ptr)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        placed = {each.name: each for each in scene.design.placed}
        for k, (name, part) in enumerate(scene.parts):
            prop = scene.props[name].mjcf_model
            where = placed["oven_1" if part.joint is None else name]
            arrays.kind[k, PART_KINDS.index(part.kind)] = 1.0
            arrays.opened[k] = part.opened
            handle = physics.bind(prop.find("site", part.handle))
            arrays.position[k] = data.site_xpos[handle.element_id]
            arrays.into[k] = where.in_world(np.array([0.0, 1.0, 0.0])) - where.position
            upright = part.kind in ("door", "sliding door", "knob")
            arrays.along[k] = (0.0, 0.0, 1.0) if upright else where.in_world(np.array([1.0, 0.0, 0.0])) - where.position
            if part.joint is None:
                arrays.is_free[k] = True
                arrays.target[k] = arrays.position[k] + part.opened * arrays.into[k]
                arrays.lift[:] = handle.pos
                continue
            joint = physics.bind(prop.find("joint", part.joint)).element_id
            arrays.has_joint[k] = True
            arrays.is_hinge[k] = model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE
            arrays.axis[k], arrays.anchor[k] = data.xaxis[joint], data.xanchor[joint]
        return arrays

    def moved(self, joints: Array, kettle: Array) -> tuple[Array, Array, Array]:
        """Returns positions of the handles [m], and directions into the fixtures and along the bars, `(..., K, 3)`.

        Args:
          joints: `(..., K)`, positions of the parts' joints [rad, m].
          kettle: `(..., 3)`, position of the kettle's handle [m].
        """
        angles = np.where(self.is_hinge, joints, 0.0)
        cos, sin = np.cos(angles)[..., np.newaxis], np.sin(angles)[..., np.newaxis]

        def turned(vectors: Array) -> Array:
            parallel = self.axis * _dot(self.axis, vectors)
            return vectors * cos + rotations.cross(self.axis, vectors) * sin + parallel * (1.0 - cos)

        hinged = self.anchor + turned(self.position - self.anchor)
        slid = self.position + self.axis * joints[..., np.newaxis]
        positions = np.where(self.is_hinge[..., np.newaxis], hinged, slid)
        positions = np.where(self.is_free[..., np.newaxis], kettle[..., np.newaxis, :], positions)
        return positions, turned(self.into), turned(self.along)

    def openings(self, joints: Array, positions: Array) -> Array:
        """Returns how far `(..., K)` parts are open, on, or moved, as a share.

        Args:
          joints: `(..., K)`, positions of their joints [rad, m].
          positions: `(..., K, 3)`, of their handles [m].
        """
        missing = np.sqrt(rotations.squared_length(self.target - positions))
        return np.where(self.is_free, 1.0 - missing / self.opened, joints / self.opened)


def _dot(one: Array, other: Array) -> Array:
    """Returns the products `(..., 1)` of vectors `(..., 3)`, with the same bits for one and for many."""
    x, y, z = (one[..., i] * other[..., i] for i in range(3))
    return (x + y + z)[..., np.newaxis]


class SlotReading(NamedTuple):
    """Values that are read from the physics of a kitchen after a control step.

    Attributes:
      positions: `(..., 9)`, of the robot's joints [rad, m].
      velocities: `(..., 9)` [rad/s, m/s].
      hand: `(..., 3)`, position of the end effector [m].
      frame: `(..., 9)`, its rotation matrix, row by row.
      joints: `(..., K)`, positions of the parts' joints [rad, m]; without meaning for parts that have none.
      kettle: `(..., 7)`, pose of the kettle [m, quaternion]; without meaning where there is none.
    """

    positions: Array
    velocities: Array
    hand: Array
    frame: Array
    joints: Array
    kettle: Array


class SlotSensors:
    """Reads the joints of robot and parts, and the pose of the hand.

    Attributes:
      slots: the parts of the kitchen.
      ctrl, stage: see `Sensors`.
    """

    ctrl: Columns
    stage = mujoco.mjtStage.mjSTAGE_POS

    def __init__(self, scene: GeneratedKitchen) -> None:
        """Stores the kitchen."""
        self._scene = scene

    def bind(self, physics: mjcf.Physics) -> None:
        """Looks up all addresses in the compiled scene."""
        scene = self._scene
        self.slots = Slots.of(scene, physics)
        robot = physics.bind(scene.robot.joints)
        self._qpos, self._qvel = as_columns(robot.qposadr), as_columns(robot.dofadr)
        self.ctrl = as_columns(physics.bind(scene.robot.actuators).element_id)
        self._hand = np.array([physics.bind(scene.robot.end_effector).element_id])
        # Empty slots read the first joint.
        self.columns = np.zeros(MAX_PARTS, np.int64)
        self._kettle = np.zeros(7, np.int64)
        for k, (name, part) in enumerate(scene.parts):
            prop = scene.props[name]
            if part.joint is None:
                (free,) = prop.joints
                self._kettle = int(physics.bind(free).qposadr) + np.arange(7)
            else:
                self.columns[k] = physics.bind(prop.mjcf_model.find("joint", part.joint)).qposadr

    def refresh(self, physics: mjcf.Physics) -> None:
        """Updates the positions of bodies from those of the joints."""
        mujoco.mj_kinematics(physics.model.ptr, physics.data.ptr)

    def read(self, simulation: Simulation) -> SlotReading:
        """Returns the present values, in fresh arrays."""
        return SlotReading(
            positions=np.array(simulation.read("qpos", self._qpos)),
            velocities=np.array(simulation.read("qvel", self._qvel)),
            hand=simulation.read("site_xpos", self._hand)[..., 0, :],
            frame=simulation.read("site_xmat", self._hand)[..., 0, :],
            joints=simulation.read("qpos", self.columns),
            kettle=simulation.read("qpos", self._kettle),
        )


class SlotShaping(NamedTuple):
    """State of a dense reward.

    Attributes:
      initial_distances: `(..., K)`, of the hand from the handles at the reset [m].
      best_approach: `(..., K)`, greatest share of the way to the handle covered before the step.
      initial_openings: `(..., K)`, at the reset.
      best_progress: `(..., K)`, greatest share of the way to the goal covered before the step.
    """

    initial_distances: Array
    best_approach: Array
    initial_openings: Array
    best_progress: Array


class GeneratedKitchenState(NamedTuple):
    """State of an episode after a control step.

    Attributes:
      noise: `(..., 82)`, noise of the present observation, by the parts of `NOISE_SLICES`.
      positions: `(..., 9)`, of the robot's joints, without noise [rad, m].
      velocities: `(..., 9)`, of these [rad/s, m/s].
      target: `(..., 9)`, last targets of its actuators [rad, m].
      hand: `(..., 12)`, position of the hand [m] and its rotation matrix, row by row.
      handles: `(..., K, 9)`, positions of the handles [m], directions into the fixtures, and along the bars.
      openings: `(..., K)`, how far parts are open, on, or moved, as a share.
      goal: `(..., K)`, opening that is asked for, 0 or 1.
      order: `(..., K)`, place of each requested part, from 0, and -1 for the others.
      progress: completion of the parts.
      slots: the parts of the kitchen.
      terms: `(...)` each, the terms of the last step's reward by name.
      shaping: state of a dense reward; None for the sparse one.
    """

    noise: Array
    positions: Array
    velocities: Array
    target: Array
    hand: Array
    handles: Array
    openings: Array
    goal: Array
    order: NDArray[np.int64]
    progress: Progress
    slots: Slots
    terms: dict[str, Array]
    shaping: SlotShaping | None = None

    def as_dict(self) -> dict[str, Any]:
        """Returns the state as nested dicts of fresh arrays, without the kitchen's slots and what is None."""
        fields = {name: part for name, part in self._asdict().items() if name != "slots" and part is not None}
        nested = {name: part._asdict() for name, part in fields.items() if isinstance(part, Progress | SlotShaping)}
        arrays: dict[str, Any] = tree.map_structure(np.array, {**fields, **nested})
        return arrays

    @classmethod
    def from_dict(cls, arrays: Mapping[str, Any], slots: Slots) -> Self:
        """Returns the state that `as_dict` returned as nested dicts, among which there may be others."""
        parts = {name: arrays[name] for name in cls._fields if name in arrays}
        if "shaping" in parts:
            parts["shaping"] = SlotShaping(**parts["shaping"])
        return cls(**{**parts, "progress": Progress(**parts["progress"]), "slots": slots})

    @property
    def completions(self) -> NDArray[np.bool_]:
        """`(..., K)`, parts whose task the last step completed."""
        return self.progress.completions

    @property
    def requested(self) -> NDArray[np.bool_]:
        """`(..., K)`, parts of which the episode asks something."""
        return self.order >= 0

    @property
    def hand_distances(self) -> Array:
        """`(..., K)`, of the hand from the handles [m]."""
        offsets = self.handles[..., :3] - self.hand[..., np.newaxis, :3]
        return np.sqrt(rotations.squared_length(offsets))

    def goal_progress(self, shaping: SlotShaping) -> Array:
        """Returns the fraction `(..., K)` of the way to the goal that the parts have covered, requested or not."""
        return covered(np.abs(self.goal - self.openings), np.abs(self.goal - shaping.initial_openings))


class GeneratedKitchenTransition(Transition[GeneratedKitchenState], CompletionStep, SharesStep):
    """A control step in a generated kitchen."""

    @property
    def completions(self) -> NDArray[np.bool_]:
        """`(..., K)`, parts whose task the step completed."""
        return self.after.completions

    @functools.cached_property
    def shares(self) -> Shares:
        """How far each requested part has come, before and after the step; for dense rewards alone."""
        before, after = self.before, self.after
        assert before.shaping is not None, "only a dense reward has a state"
        assert after.shaping is not None, "only a dense reward has a state"
        requested = after.requested
        shares = Shares(
            approach=after.shaping.best_approach,
            previous_approach=before.shaping.best_approach,
            progress=after.goal_progress(after.shaping),
            previous_progress=before.shaping.best_progress,
            is_relabelled=np.zeros(requested.shape, bool),
            completed=after.progress.completed,
            previously_completed=before.progress.completed,
        )
        return Shares(*(np.where(requested, part, np.zeros((), part.dtype)) for part in shares))


@dataclasses.dataclass(frozen=True, kw_only=True)
class GeneratedKitchenMDP(CompletionMDP[SlotReading, GeneratedKitchenState]):
    """Settings of a task in generated kitchens, and the mathematics of an episode under them.

    Attributes:
      sensors: of robot and parts.
      noise_scale: `(82,)`, greatest noise of joints, handles and openings.
      num_slots: number of slots that are observed.
    """

    sensors: SlotSensors
    noise_scale: Array
    num_slots: int = MAX_PARTS

    object_slots = MAX_PARTS

    @property
    def noise_draws(self) -> int:
        return NOISE_SIZE

    @property
    def noise_parts(self) -> Mapping[str, slice]:
        return NOISE_SLICES

    def initial_state(self, reading: SlotReading, draws: Array) -> GeneratedKitchenState:
        """Returns the state before the first step of an episode that asks for nothing; see `with_request`."""
        zeros, slots = np.zeros(MAX_PARTS), self.sensors.slots
        state = GeneratedKitchenState(
            noise=self.noise_scale * draws,
            target=reading.positions,
            goal=zeros,
            order=np.full(MAX_PARTS, -1),
            progress=Progress.initial((MAX_PARTS,)),
            slots=slots,
            terms=self.no_reward(()),
            **_measured(slots, reading),
        )
        shaping = SlotShaping(state.hand_distances, zeros, state.openings, zeros)
        return state._replace(shaping=shaping) if self.is_dense else state

    def with_request(
        self, state: GeneratedKitchenState, order: NDArray[np.int64], goal: Array
    ) -> GeneratedKitchenState:
        """Returns the state before the first step of an episode that asks for goals `(K,)` of parts in an order."""
        return state._replace(order=order, goal=goal, progress=Progress.of_request(order))

    def transition(
        self, state: GeneratedKitchenState, *, action: Array, target: Array, reading: SlotReading, draws: Array
    ) -> GeneratedKitchenTransition:
        after = state._replace(
            noise=self.noise_scale * draws, target=target, terms={}, **_measured(state.slots, reading)
        )
        within = self.within(after.openings, after.goal) & state.requested
        after = after._replace(progress=state.progress.update(within, remove_task_when_completed=True))
        if self.is_dense:
            assert state.shaping is not None, "only a dense reward has a state"
            approach = covered(after.hand_distances, state.shaping.initial_distances)
            shaping = state.shaping._replace(
                best_approach=np.maximum(state.shaping.best_approach, approach),
                best_progress=np.maximum(state.shaping.best_progress, after.goal_progress(state.shaping)),
            )
            after = after._replace(shaping=shaping)
        return GeneratedKitchenTransition(state, action, target, after)

    @staticmethod
    def within(openings: Array, goal: Array) -> NDArray[np.bool_]:
        """Returns which parts `(..., K)` are where a goal asks them to be."""
        return np.where(goal > 0.5, openings >= OPEN, openings <= CLOSED)

    @functools.cached_property
    def observations(self) -> Mapping[str, Observation]:
        """Joints, hand, and slots of parts, those of requested ones first; in single precision, with their noise."""
        return {
            "joint_positions": _single(_observed_positions, of_robot=True),
            "joint_velocities": _single(_observed_velocities, of_robot=True),
            "hand_pose": _single(_hand_pose),
            "slots": _single(lambda state: _observed_slots(state, self.num_slots)),
        }

    def task_joints(self, scene: Scene) -> list[tuple[mjcf.Element, ...]]:
        assert isinstance(scene, GeneratedKitchen), "sensors and slots are of such a kitchen"
        return [(*_joints_of(scene, name, part), *_followers_of(scene, name, part)) for name, part in scene.parts]

    def requested_joints(self, scene: Scene, state: GeneratedKitchenState) -> list[mjcf.Element]:
        assert isinstance(scene, GeneratedKitchen), "sensors and slots are of such a kitchen"
        asked = zip(scene.parts, state.requested.tolist(), strict=False)
        return [joint for (name, part), is_asked in asked if is_asked for joint in _joints_of(scene, name, part)]

    def info(self, state: GeneratedKitchenState) -> dict[str, NDArray]:
        """Returns the infos on the parts: fresh arrays, `(...)` or, in the order of the design, `(..., K)`."""
        return {
            "openings": state.openings.copy(),
            **order_info(state.order),
            "goal_openings": state.goal.copy(),
            "completion_steps": state.progress.completion_steps.copy(),
            "is_success": np.array(self.all_completed(state)),
            **self.reward_info(state),
        }


def _single(read: Callable[[GeneratedKitchenState], Array], *, of_robot: bool = False) -> Observation:
    """Returns the observation of what is read of a state, in single precision."""
    return Observation(lambda simulation, state: read(state).astype(np.float32), of_robot=of_robot)


def _observed_positions(state: GeneratedKitchenState) -> Array:
    """Returns the positions `(..., 9)` of the robot's joints with their noise [rad, m]."""
    return state.positions + state.noise[..., _NOISE["positions"]]


def _observed_velocities(state: GeneratedKitchenState) -> Array:
    """Returns the velocities `(..., 9)` of the robot's joints with their noise [rad/s, m/s]."""
    return state.velocities + state.noise[..., _NOISE["velocities"]]


def _hand_pose(state: GeneratedKitchenState) -> Array:
    """Returns the position `(..., 3)` of the hand relative to the robot's base, and two columns of its rotation."""
    return np.concatenate([state.hand[..., :3] - robot_base(), state.hand[..., _TWO_COLUMNS]], axis=-1)


def _observed_slots(state: GeneratedKitchenState, count: int) -> Array:
    """Returns the elements of a number of slots `(..., m)`, end to end: those of requested parts come first."""
    noise = state.noise
    position = state.handles[..., :3] + noise[..., _NOISE["handles"]].reshape(*noise.shape[:-1], MAX_PARTS, 3)
    slots = np.concatenate(
        [
            state.slots.kind,
            position - robot_base(),
            position - state.hand[..., np.newaxis, :3],
            state.handles[..., 3:],
            (state.openings + noise[..., _NOISE["openings"]])[..., np.newaxis],
            state.goal[..., np.newaxis],
            state.requested[..., np.newaxis],
        ],
        axis=-1,
    )
    slots = slots * state.slots.kind.max(axis=-1, keepdims=True)
    # Requested parts in their order, then the others in that of the design.
    places = np.where(state.requested, state.order, MAX_PARTS)
    first = np.argsort(places, axis=-1, kind="stable")[..., :count]
    slots = np.take_along_axis(slots, first[..., np.newaxis], axis=-2)
    return slots.reshape(*slots.shape[:-2], -1)


_TWO_COLUMNS = np.array([3, 6, 9, 4, 7, 10])  # The first two columns of a rotation matrix after a position.


def noise_scale(*, robot_ratio: float, object_ratio: float) -> Array:
    """Returns the greatest noise `(82,)` of joints, handles and openings, each in its unit."""
    scale = np.full(NOISE_SIZE, robot_ratio * _ROBOT_AMPLITUDE)
    scale[_NOISE["handles"]] = object_ratio * _HANDLE_AMPLITUDE
    scale[_NOISE["openings"]] = object_ratio * _OPENING_AMPLITUDE
    return scale


def _joints_of(scene: GeneratedKitchen, name: str, part: Part) -> tuple[mjcf.Element, ...]:
    """Returns the joint of a part of a prop of some name; a part without a joint of its own is the free prop."""
    prop = scene.props[name]
    return prop.joints if part.joint is None else (prop.mjcf_model.find("joint", part.joint),)


def _followers_of(scene: GeneratedKitchen, name: str, part: Part) -> tuple[mjcf.Element, ...]:
    """Returns the joints that follow that of a part of a prop of some name."""
    return () if part.follower is None else (scene.props[name].mjcf_model.find("joint", part.follower),)


def _measured(slots: Slots, reading: SlotReading) -> dict[str, Any]:
    """Returns the fields of a state that follow from a reading."""
    joints = reading.joints * slots.has_joint
    kettle = reading.kettle[..., :3] + rotations.rotated(reading.kettle[..., 3:], slots.lift)
    positions, into, along = slots.moved(joints, kettle)
    return {
        "positions": reading.positions,
        "velocities": reading.velocities,
        "hand": np.concatenate([reading.hand, reading.frame], axis=-1),
        "handles": np.concatenate([positions, into, along], axis=-1),
        "openings": slots.openings(joints, positions),
    }
