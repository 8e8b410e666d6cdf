"""The parts of a generated kitchen as slots: where they are, how far open, and how robot and parts are observed.

Every kitchen has the same number of slots, one for each part that moves, and empty ones.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, Self

import mujoco
import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities.fixtures import PART_KINDS
from kitchen_suite.entities.generated_kitchen import MAX_PARTS, GeneratedKitchen
from kitchen_suite.entities.scenes import robot_base
from kitchen_suite.tasks import rotations
from kitchen_suite.tasks.simulation import Columns, Simulation, as_columns
from kitchen_suite.tasks.terms import Observation, end_to_end
from kitchen_suite.types import Array

# Elements of a slot in the observation.
SLOT_SLICES = end_to_end(
    {"kind": 6, "position": 3, "offset": 3, "into": 3, "along": 3, "opening": 1, "goal": 1, "requested": 1}
)
SLOT_SIZE = SLOT_SLICES["requested"].stop

# Parts of the noise.
NOISE = end_to_end({"positions": 9, "velocities": 9, "handles": 3 * MAX_PARTS, "openings": MAX_PARTS})
NOISE_SIZE = NOISE["openings"].stop


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


def measured(slots: Slots, reading: SlotReading) -> dict[str, Any]:
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


class SlotState(Protocol):
    """State of an episode, as far as robot and parts are observed; see `mdp.GeneratedKitchenState`."""

    @property
    def noise(self) -> Array: ...

    @property
    def positions(self) -> Array: ...

    @property
    def velocities(self) -> Array: ...

    @property
    def hand(self) -> Array: ...

    @property
    def handles(self) -> Array: ...

    @property
    def openings(self) -> Array: ...

    @property
    def slots(self) -> Slots: ...


def single(read: Callable[[Any], Array], *, of_robot: bool = False) -> Observation:
    """Returns the observation of what is read of a state, in single precision."""
    return Observation(lambda simulation, state: read(state).astype(np.float32), of_robot=of_robot)


def observed_positions(state: SlotState) -> Array:
    """Returns the positions `(..., 9)` of the robot's joints with their noise [rad, m]."""
    return state.positions + state.noise[..., NOISE["positions"]]


def observed_velocities(state: SlotState) -> Array:
    """Returns the velocities `(..., 9)` of the robot's joints with their noise [rad/s, m/s]."""
    return state.velocities + state.noise[..., NOISE["velocities"]]


def hand_pose(state: SlotState) -> Array:
    """Returns the position `(..., 3)` of the hand relative to the robot's base, and two columns of its rotation."""
    return np.concatenate([state.hand[..., :3] - robot_base(), state.hand[..., _TWO_COLUMNS]], axis=-1)


def observed_slots(state: SlotState, order: NDArray[np.int64], goal: Array, count: int) -> Array:
    """Returns the elements of a number of slots `(..., m)`, end to end: those of requested parts come first.

    Args:
      state: of the episode.
      order: `(..., K)`, place of each requested part, from 0, and -1 for the others.
      goal: `(..., K)`, opening that is asked for.
      count: number of slots.
    """
    noise, requested = state.noise, order >= 0
    position = state.handles[..., :3] + noise[..., NOISE["handles"]].reshape(*noise.shape[:-1], MAX_PARTS, 3)
    slots = np.concatenate(
        [
            state.slots.kind,
            position - robot_base(),
            position - state.hand[..., np.newaxis, :3],
            state.handles[..., 3:],
            (state.openings + noise[..., NOISE["openings"]])[..., np.newaxis],
            goal[..., np.newaxis],
            requested[..., np.newaxis],
        ],
        axis=-1,
    )
    slots = slots * state.slots.kind.max(axis=-1, keepdims=True)
    # Requested parts in their order, then the others in that of the design.
    places = np.where(requested, order, MAX_PARTS)
    first = np.argsort(places, axis=-1, kind="stable")[..., :count]
    slots = np.take_along_axis(slots, first[..., np.newaxis], axis=-2)
    return slots.reshape(*slots.shape[:-2], -1)


_TWO_COLUMNS = np.array([3, 6, 9, 4, 7, 10])  # The first two columns of a rotation matrix after a position.
