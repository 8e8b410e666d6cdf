"""The Markov decision process of objects that are put somewhere: requests, success, reward, observation.

As in generated kitchens, what differs from kitchen to kitchen is part of the state.
"""

import dataclasses
import functools
from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple, Self

import numpy as np
import tree
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities.generated_kitchen import MAX_PARTS
from kitchen_suite.entities.object_layouts import MAX_OBJECTS, MAX_PLACES
from kitchen_suite.entities.pick_and_place import PickAndPlaceKitchen
from kitchen_suite.entities.scenes import FLOOR, Scene, robot_base
from kitchen_suite.tasks import rotations
from kitchen_suite.tasks.completion_mdp import CompletionMDP
from kitchen_suite.tasks.generated_kitchens import mdp as kitchens
from kitchen_suite.tasks.generated_kitchens import slots as kitchen_slots
from kitchen_suite.tasks.generated_kitchens.slots import Slots, single
from kitchen_suite.tasks.goals import Progress
from kitchen_suite.tasks.orders import order_info
from kitchen_suite.tasks.pick_and_place.items import AT_REST, LET_GO, ItemReading, Items, ItemSensors, held
from kitchen_suite.tasks.pick_and_place.rewards import STAGES, Stages
from kitchen_suite.tasks.rewards import CompletionStep, covered
from kitchen_suite.tasks.terms import Observation, Transition, end_to_end
from kitchen_suite.types import Array

# Elements of an object and of a place in the observation.
OBJECT_SLICES = end_to_end(
    {
        **{"kind": 4, "position": 3, "offset": 3, "x_axis": 3, "z_axis": 3, "half_size": 3, "requested": 1},
        **{"goal_kind": 6, "goal_position": 3, "goal_half_size": 3},
    }
)
OBJECT_SIZE = OBJECT_SLICES["goal_half_size"].stop
PLACE_SLICES = end_to_end({"kind": 6, "position": 3, "half_size": 3})
PLACE_SIZE = PLACE_SLICES["half_size"].stop

# Parts of the flat observation, of which the third ends earlier where fewer parts are observed.
SLICES = end_to_end(
    {
        **{"joint_positions": 9, "joint_velocities": 9, "hand_pose": 9},
        "objects": MAX_OBJECTS * OBJECT_SIZE,
        "places": MAX_PLACES * PLACE_SIZE,
        "slots": MAX_PARTS * kitchen_slots.SLOT_SIZE,
    }
)


def size(num_slots: int) -> int:
    """Returns the number of elements of an observation with a number of slots of parts."""
    return SLICES["slots"].start + num_slots * kitchen_slots.SLOT_SIZE


# Greatest noise of the positions of objects at a noise ratio of 1 [m].
_OBJECT_AMPLITUDE = 0.2

# Parts of the noise: as in generated kitchens, then of the positions of objects.
_NOISE = end_to_end({"kitchen": kitchen_slots.NOISE_SIZE, "objects": 3 * MAX_OBJECTS})
NOISE_SIZE = _NOISE["objects"].stop
_ROBOT = kitchens.NOISE_SLICES["robot_noise"]
NOISE_SLICES = MappingProxyType({"robot_noise": _ROBOT, "object_noise": slice(_ROBOT.stop, NOISE_SIZE)})

_LIFTED = 0.1  # Height by which an object that is carried is lifted [m].
_DROPPED = FLOOR + 0.3  # Height of the middle of an object below which it lies on the floor [m].


class Request(NamedTuple):
    """The objects that an episode asks to be put somewhere.

    Attributes:
      order: `(..., O)`, place of each requested object in the sequence, from 0, and -1 for the others.
      goal: `(..., O)`, index of the place where it is to be; 0 for the others.
      origin: `(..., O)`, index of the place in which it is at the start; -1 where it stands on a worktop.
      closed: `(..., O)`, whether the place has to be opened first.
      part_order: `(..., K)`, 0 for parts that have to be opened, -1 for the others.
    """

    order: NDArray[np.int64]
    goal: NDArray[np.int64]
    origin: NDArray[np.int64]
    closed: NDArray[np.bool_]
    part_order: NDArray[np.int64]

    @classmethod
    def nothing(cls) -> Self:
        """Returns the request of an episode that asks for nothing."""
        absent = np.full(MAX_OBJECTS, -1)
        return cls(absent, np.zeros(MAX_OBJECTS, np.int64), absent, np.zeros(MAX_OBJECTS, bool), np.full(MAX_PARTS, -1))


class StageShaping(NamedTuple):
    """State of a dense reward.

    Attributes:
      initial_distances: `(..., O)`, of the hand from the grasps at the reset [m].
      initial_heights: `(..., O)`, of the objects' middles at the reset [m].
      initial_ways: `(..., O)`, of the objects' middles from their places at the reset [m].
      shares: `(..., O, 5)`, of the stages after the step.
      best: `(..., O, 5)`, greatest shares of the stages so far.
    """

    initial_distances: Array
    initial_heights: Array
    initial_ways: Array
    shares: Array
    best: Array


class PickAndPlaceState(NamedTuple):
    """State of an episode after a control step.

    Attributes:
      noise: `(..., 97)`, noise of the present observation, by the parts of `NOISE_SLICES`.
      positions: `(..., 9)`, of the robot's joints, without noise [rad, m].
      velocities: `(..., 9)`, of these [rad/s, m/s].
      target: `(..., 9)`, last targets of its actuators [rad, m].
      hand: `(..., 12)`, position of the hand [m] and its rotation matrix, row by row.
      handles: `(..., K, 9)`, positions of the handles [m], directions into the fixtures, and along the bars.
      openings: `(..., K)`, how far parts are open, on, or moved, as a share.
      poses: `(..., O, 7)`, of the objects' frames [m, quaternion].
      speeds: `(..., O)`, of these [m/s].
      shifts: `(..., P, 3)`, how far places have moved [m].
      dropped: `(..., O)`, which objects have lain on the floor.
      request: what the episode asks for.
      progress: completion of the objects' tasks.
      slots: the parts of the kitchen.
      items: its objects and places.
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
    poses: Array
    speeds: Array
    shifts: Array
    dropped: NDArray[np.bool_]
    request: Request
    progress: Progress
    slots: Slots
    items: Items
    terms: dict[str, Array]
    shaping: StageShaping | None = None

    def as_dict(self) -> dict[str, Any]:
        """Returns the state as nested dicts of fresh arrays, without what is of the kitchen, and what is None."""
        fields = {
            name: part for name, part in self._asdict().items() if name not in ("slots", "items") and part is not None
        }
        nested: dict[str, Any] = {
            name: part._asdict() for name, part in fields.items() if isinstance(part, Request | Progress | StageShaping)
        }
        arrays: dict[str, Any] = tree.map_structure(np.array, {**fields, **nested})
        return arrays

    @classmethod
    def from_dict(cls, arrays: Mapping[str, Any], slots: Slots, items: Items) -> Self:
        """Returns the state that `as_dict` returned as nested dicts, among which there may be others."""
        parts = {name: arrays[name] for name in cls._fields if name in arrays}
        kinds = {"request": Request, "progress": Progress, "shaping": StageShaping}
        nested = {name: kind(**parts[name]) for name, kind in kinds.items() if name in parts}
        return cls(**{**parts, **nested, "slots": slots, "items": items})

    @property
    def completions(self) -> NDArray[np.bool_]:
        """`(..., O)`, objects whose task the last step completed."""
        return self.progress.completions

    @property
    def requested(self) -> NDArray[np.bool_]:
        """`(..., O)`, objects of which the episode asks something."""
        return self.request.order >= 0

    @property
    def hand_distances(self) -> Array:
        """`(..., O)`, of the hand from the objects' grasps [m]."""
        offsets = self.items.grasps(self.poses) - self.hand[..., np.newaxis, :3]
        return np.sqrt(rotations.squared_length(offsets))

    @property
    def centres(self) -> Array:
        """`(..., O, 3)`, middles of the objects [m]."""
        return self.items.centres(self.poses)

    @property
    def goals(self) -> Array:
        """`(..., O, 3)`, middles of the supports of the places where the objects are to be [m]."""
        return self.items.at(self.items.supports(self.shifts), self.request.goal)

    @property
    def ways(self) -> Array:
        """`(..., O)`, horizontal distances of the objects' middles from those of their places [m]."""
        return np.sqrt(rotations.squared_length((self.goals - self.centres) * _HORIZONTAL))

    @property
    def in_place(self) -> NDArray[np.bool_]:
        """`(..., O)`, objects whose middle is in the box of their place, at rest or not."""
        return self.items.within(self.centres, self.shifts, self.request.goal)

    @property
    def released(self) -> NDArray[np.bool_]:
        """`(..., O)`, objects that the fingers do not touch."""
        return self.items.distances(self.poses, self.hand[..., :3]) > LET_GO


_HORIZONTAL = np.array([1.0, 1.0, 0.0])


class PickAndPlaceTransition(Transition[PickAndPlaceState], CompletionStep):
    """A control step in a kitchen with objects."""

    @property
    def completions(self) -> NDArray[np.bool_]:
        """`(..., O)`, objects whose task the step completed."""
        return self.after.completions

    @functools.cached_property
    def stages(self) -> Stages:
        """How far each requested object has come, before and after the step; for dense rewards alone."""
        before, after = self.before, self.after
        assert before.shaping is not None, "only a dense reward has a state"
        assert after.shaping is not None, "only a dense reward has a state"
        requested = after.requested
        by_stage = requested[..., np.newaxis]
        return Stages(
            shares=np.where(by_stage, after.shaping.shares, 0.0),
            best=np.where(by_stage, after.shaping.best, 0.0),
            previous_best=np.where(by_stage, before.shaping.best, 0.0),
            completed=after.progress.completed & requested,
            previously_completed=before.progress.completed & requested,
        )


@dataclasses.dataclass(frozen=True, kw_only=True)
class PickAndPlaceMDP(CompletionMDP[ItemReading, PickAndPlaceState]):
    """Settings of a task with objects in generated kitchens, and the mathematics of an episode under them.

    Attributes:
      sensors: of robot, parts and objects.
      noise_scale: `(97,)`, greatest noise of joints, handles, openings and objects.
      num_slots: number of slots of parts that are observed.
    """

    sensors: ItemSensors
    noise_scale: Array
    num_slots: int = MAX_PARTS

    # Of a kitchen, with the joints that move in it, and of its objects.
    object_slots = MAX_PARTS + MAX_OBJECTS

    @property
    def noise_draws(self) -> int:
        return NOISE_SIZE

    @property
    def noise_parts(self) -> Mapping[str, slice]:
        return NOISE_SLICES

    def initial_state(self, reading: ItemReading, draws: Array) -> PickAndPlaceState:
        """Returns the state before the first step of an episode that asks for nothing; see `with_request`."""
        slots, items = self.sensors.slots, self.sensors.items
        return PickAndPlaceState(
            noise=self.noise_scale * draws,
            target=reading.kitchen.positions,
            dropped=np.zeros(MAX_OBJECTS, bool),
            request=Request.nothing(),
            progress=Progress.initial((MAX_OBJECTS,)),
            slots=slots,
            items=items,
            terms=self.no_reward(()),
            shaping=_no_shaping() if self.is_dense else None,
            **_measured(slots, items, reading),
        )

    def with_request(self, state: PickAndPlaceState, request: Request) -> PickAndPlaceState:
        """Returns the state before the first step of an episode that asks for something."""
        asked = state._replace(request=request, progress=Progress.of_request(request.order))
        if not self.is_dense:
            return asked
        shares = np.zeros((MAX_OBJECTS, len(STAGES)))
        shaping = StageShaping(asked.hand_distances, asked.centres[..., 2], asked.ways, shares, shares)
        return asked._replace(shaping=shaping)

    def transition(
        self, state: PickAndPlaceState, *, action: Array, target: Array, reading: ItemReading, draws: Array
    ) -> PickAndPlaceTransition:
        measured = _measured(state.slots, state.items, reading)
        after = state._replace(noise=self.noise_scale * draws, target=target, terms={}, **measured)
        done = after.in_place & after.released & (after.speeds < AT_REST) & state.requested
        after = after._replace(
            progress=state.progress.update(done, remove_task_when_completed=True),
            dropped=state.dropped | ((after.centres[..., 2] < _DROPPED) & state.items.present),
        )
        if self.is_dense:
            assert state.shaping is not None, "only a dense reward has a state"
            shares = _stage_shares(after, state.shaping)
            best = np.maximum(state.shaping.best, shares)
            after = after._replace(shaping=state.shaping._replace(shares=shares, best=best))
        return PickAndPlaceTransition(state, action, target, after)

    @functools.cached_property
    def observations(self) -> Mapping[str, Observation]:
        """Joints, hand, objects, places and parts; in single precision, with their noise."""
        return {
            "joint_positions": single(kitchen_slots.observed_positions, of_robot=True),
            "joint_velocities": single(kitchen_slots.observed_velocities, of_robot=True),
            "hand_pose": single(kitchen_slots.hand_pose),
            "objects": single(_observed_objects),
            "places": single(_observed_places),
            "slots": single(lambda state: _observed_slots(state, self.num_slots)),
        }

    def task_joints(self, scene: Scene) -> Sequence[Sequence[mjcf.Element]]:
        assert isinstance(scene, PickAndPlaceKitchen), "sensors and items are of such a kitchen"
        return [thing.joints for thing in scene.objects]

    def carried_joints(self, scene: Scene) -> Sequence[mjcf.Element | None]:
        joints = [joint for own in self.task_joints(scene) for joint in own]
        return [*joints, *[None] * (MAX_OBJECTS - len(joints))]

    def requested_joints(self, scene: Scene, state: PickAndPlaceState) -> Collection[mjcf.Element]:
        """Returns the joints of requested objects, and those of parts that have to be open for them."""
        assert isinstance(scene, PickAndPlaceKitchen), "sensors and items are of such a kitchen"
        found: list[mjcf.Element] = []
        numbers = np.flatnonzero(state.requested)
        for number in numbers.tolist():
            found += scene.objects[number].joints
            for index in (state.request.goal[number], state.request.origin[number]):
                parts = scene.places[index].parts if index >= 0 else ()
                found += [scene.joint_of(name) for name in parts]
        return found

    def info(self, state: PickAndPlaceState) -> dict[str, NDArray]:
        """Returns the infos on the objects: fresh arrays, `(...)` or, in the order of the layout, `(..., O)`."""
        return {
            "object_positions": np.where(state.items.present[..., np.newaxis], state.centres, 0.0),
            **order_info(state.request.order),
            "goal_places": state.request.goal.copy(),
            "start_places": state.request.origin.copy(),
            "starts_closed": state.request.closed.copy(),
            "completion_steps": state.progress.completion_steps.copy(),
            "objects_dropped": np.array(np.add.reduce(state.dropped, axis=-1, dtype=np.int64)),
            "is_success": np.array(self.all_completed(state)),
            **self.reward_info(state),
        }


def _no_shaping() -> StageShaping:
    zeros = np.zeros(MAX_OBJECTS)
    shares = np.zeros((MAX_OBJECTS, len(STAGES)))
    return StageShaping(zeros, zeros, zeros, shares, shares)


def _measured(slots: Slots, items: Items, reading: ItemReading) -> dict[str, Any]:
    """Returns the fields of a state that follow from a reading."""
    joints = reading.kitchen.joints * slots.has_joint
    return {
        **kitchen_slots.measured(slots, reading.kitchen),
        "poses": reading.poses,
        "speeds": reading.speeds,
        "shifts": items.shifts(slots, joints),
    }


def _stage_shares(state: PickAndPlaceState, shaping: StageShaping) -> Array:
    """Returns how far the objects have come in each stage, `(..., O, 5)`, each in [0, 1]."""
    distances = state.hand_distances
    fingers = state.positions[..., 7] + state.positions[..., 8]
    reach = covered(distances, shaping.initial_distances)
    grasp = held(distances, fingers) | state.in_place
    # What is above its place has been lifted.
    height = (state.centres[..., 2] - shaping.initial_heights) / _LIFTED
    lift = np.clip(np.where(state.in_place, 1.0, height), 0.0, 1.0)
    carry = covered(state.ways, shaping.initial_ways)
    release = state.in_place & state.released
    return np.stack([reach, grasp * 1.0, lift, carry * (lift > 0.2), release * 1.0], axis=-1)


def _observed_objects(state: PickAndPlaceState) -> Array:
    """Returns the elements of all objects `(..., m)`, end to end: those of requested ones come first."""
    items, noise = state.items, state.noise[..., _NOISE["objects"]]
    centres = state.centres + noise.reshape(*noise.shape[:-1], MAX_OBJECTS, 3)
    goal = state.request.goal
    requested = state.requested[..., np.newaxis]
    objects = np.concatenate(
        [
            items.kind,
            centres - robot_base(),
            centres - state.hand[..., np.newaxis, :3],
            rotations.rotated(state.poses[..., 3:], np.array([1.0, 0.0, 0.0])),
            rotations.rotated(state.poses[..., 3:], np.array([0.0, 0.0, 1.0])),
            items.half_size,
            requested,
            items.at(items.place_kind, goal) * requested,
            (state.goals - robot_base()) * requested,
            items.at(items.high - items.low, goal) / 2 * requested,
        ],
        axis=-1,
    )
    objects = objects * items.present[..., np.newaxis]
    places = np.where(state.requested, state.request.order, MAX_OBJECTS)
    first = np.argsort(places, axis=-1, kind="stable")
    objects = np.take_along_axis(objects, first[..., np.newaxis], axis=-2)
    return objects.reshape(*objects.shape[:-2], -1)


def _observed_places(state: PickAndPlaceState) -> Array:
    """Returns the elements of all places `(..., m)`, end to end, in the order of the layout."""
    items = state.items
    is_place = items.place_kind.max(axis=-1, keepdims=True)
    supports = (items.supports(state.shifts) - robot_base()) * is_place
    places = np.concatenate([items.place_kind, supports, (items.high - items.low) / 2], axis=-1)
    return places.reshape(*places.shape[:-2], -1)


def _observed_slots(state: PickAndPlaceState, count: int) -> Array:
    """Returns the elements of slots of parts `(..., m)`: those that have to be opened come first, as requested ones."""
    order = state.request.part_order
    return kitchen_slots.observed_slots(state, order, (order >= 0).astype(np.float64), count)


def noise_scale(*, robot_ratio: float, object_ratio: float) -> Array:
    """Returns the greatest noise `(97,)` of joints, handles, openings and objects, each in its unit."""
    kitchen = kitchens.noise_scale(robot_ratio=robot_ratio, object_ratio=object_ratio)
    return np.concatenate([kitchen, np.full(3 * MAX_OBJECTS, object_ratio * _OBJECT_AMPLITUDE)])
