"""The objects and places of a kitchen: what does not change in an episode, and what is read from the physics."""

from typing import Any, NamedTuple, Self

import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities.object_layouts import MAX_OBJECTS, MAX_PLACES, OBJECT_KINDS
from kitchen_suite.entities.pick_and_place import PickAndPlaceKitchen
from kitchen_suite.entities.places import PLACE_KINDS
from kitchen_suite.tasks import rotations
from kitchen_suite.tasks.generated_kitchens.slots import SlotReading, Slots, SlotSensors
from kitchen_suite.tasks.simulation import Simulation, as_columns
from kitchen_suite.types import Array

LET_GO = 0.05  # Distance of the hand from an object's box from which fingers do not touch it [m].
AT_REST = 0.03  # Speed up to which an object is at rest [m/s].
_TOLERANCE = 0.005  # By how much the centre of an object may be outside of a place's box [m].

_HELD_REACH = 0.03  # Distance of the hand from a grasp up to which fingers may hold the object [m].
_HELD_WIDTHS = (0.004, 0.078)  # Distances of the fingers between which they hold something [m].


class Items(NamedTuple):
    """The objects and places of a kitchen, which do not change; empty slots hold zeros.

    Attributes:
      kind: `(..., O, 4)`, 1 at the index of an object's kind in `OBJECT_KINDS`.
      centre: `(..., O, 3)`, middle of an object's box in the object's frame [m].
      half_size: `(..., O, 3)`, of this box [m].
      grasp: `(..., O, 3)`, where the hand grasps the object best, in its frame [m].
      place_kind: `(..., P, 6)`, 1 at the index of a place's kind in `PLACE_KINDS`.
      low: `(..., P, 3)`, least x, y and z of a place, closed [m].
      high: `(..., P, 3)`, greatest ones [m].
      part: `(..., P)`, slot of the part with which a place moves; 0 without meaning where it does not.
      moves: `(..., P)`, whether the place moves.
    """

    kind: Array
    centre: Array
    half_size: Array
    grasp: Array
    place_kind: Array
    low: Array
    high: Array
    part: NDArray[np.int64]
    moves: NDArray[np.bool_]

    @classmethod
    def of(cls, scene: PickAndPlaceKitchen, physics: mjcf.Physics) -> Self:
        """Returns the objects and places of a kitchen."""
        items = cls(
            kind=np.zeros((MAX_OBJECTS, len(OBJECT_KINDS))),
            centre=np.zeros((MAX_OBJECTS, 3)),
            half_size=np.zeros((MAX_OBJECTS, 3)),
            grasp=np.zeros((MAX_OBJECTS, 3)),
            place_kind=np.zeros((MAX_PLACES, len(PLACE_KINDS))),
            low=np.zeros((MAX_PLACES, 3)),
            high=np.zeros((MAX_PLACES, 3)),
            part=np.zeros(MAX_PLACES, np.int64),
            moves=np.zeros(MAX_PLACES, bool),
        )
        for number, (thing, placed) in enumerate(zip(scene.objects, scene.layout.objects, strict=True)):
            items.kind[number, OBJECT_KINDS.index(placed.kind)] = 1.0
            low, high = thing.bounds
            items.centre[number] = np.add(low, high) / 2
            items.half_size[number] = np.subtract(high, low) / 2
            items.grasp[number] = physics.bind(thing.grasps[0]).pos
        for number, place in enumerate(scene.places):
            items.place_kind[number, PLACE_KINDS.index(place.kind)] = 1.0
            items.low[number], items.high[number] = place.low, place.high
            items.moves[number] = place.moves
            if place.moves:
                items.part[number] = scene.part_names.index(place.parts[0])
        return items

    @property
    def present(self) -> NDArray[np.bool_]:
        """`(..., O)`, which slots have an object."""
        return self.kind.max(axis=-1) > 0.0

    def centres(self, poses: Array) -> Array:
        """Returns the middles `(..., O, 3)` of objects at poses `(..., O, 7)` [m]."""
        return poses[..., :3] + rotations.rotated(poses[..., 3:], self.centre)

    def grasps(self, poses: Array) -> Array:
        """Returns where the hand grasps objects at poses `(..., O, 7)` best, `(..., O, 3)` [m]."""
        return poses[..., :3] + rotations.rotated(poses[..., 3:], self.grasp)

    def shifts(self, slots: Slots, joints: Array) -> Array:
        """Returns how far places have moved, `(..., P, 3)` [m], at positions of the parts' joints `(..., K)`."""
        moved = np.take_along_axis(joints, self.part, axis=-1) * self.moves
        axes = np.take_along_axis(slots.axis, self.part[..., np.newaxis], axis=-2)
        return axes * moved[..., np.newaxis]

    def distances(self, poses: Array, hand: Array) -> Array:
        """Returns the distances `(..., O)` of the hand `(..., 3)` from objects' boxes at poses `(..., O, 7)` [m]."""
        local = rotations.rotated(rotations.inverse(poses[..., 3:]), hand[..., np.newaxis, :] - poses[..., :3])
        outside = np.maximum(np.abs(local - self.centre) - self.half_size, 0.0)
        return np.sqrt(rotations.squared_length(outside))

    def within(self, centres: Array, shifts: Array, goal: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Returns which objects `(..., O)` with some middles are in the places that are their goals `(..., O)`."""
        low, high = (self.at(bound + shifts, goal) for bound in (self.low, self.high))
        inside = (centres >= low - _TOLERANCE) & (centres <= high + _TOLERANCE)
        result: NDArray[np.bool_] = np.logical_and.reduce(inside, axis=-1)
        return result

    def supports(self, shifts: Array) -> Array:
        """Returns the middles `(..., P, 3)` of the supports of places that have moved [m]."""
        middle = (self.low + self.high) / 2
        return np.concatenate([middle[..., :2], self.low[..., 2:]], axis=-1) + shifts

    @staticmethod
    def at(places: Array, goal: NDArray[np.int64]) -> Array:
        """Returns what is of the places `(..., P, n)` that are goals `(..., O)`, as `(..., O, n)`."""
        return np.take_along_axis(places, goal[..., np.newaxis], axis=-2)


def held(distances: Array, fingers: Array) -> NDArray[np.bool_]:
    """Returns which objects `(..., O)` the fingers hold, or are about to.

    Args:
      distances: `(..., O)`, of the hand from the grasps [m].
      fingers: `(...)`, distance of the fingers from each other [m].
    """
    least, greatest = _HELD_WIDTHS
    closed = (fingers > least) & (fingers < greatest)
    return (distances < _HELD_REACH) & closed[..., np.newaxis]


class ItemReading(NamedTuple):
    """Values that are read from the physics after a control step.

    Attributes:
      kitchen: of robot and parts.
      poses: `(..., O, 7)`, of the objects' frames [m, quaternion]; in empty slots of no meaning.
      speeds: `(..., O)`, of these [m/s].
    """

    kitchen: SlotReading
    poses: Array
    speeds: Array


class ItemSensors(SlotSensors):
    """Reads robot, parts and objects.

    Attributes:
      items: objects and places of the kitchen.
    """

    _scene: PickAndPlaceKitchen

    def bind(self, physics: mjcf.Physics) -> None:
        super().bind(physics)
        self.items = Items.of(self._scene, physics)
        # Empty slots read what is of the first object.
        joints = [thing.joints[0] for thing in self._scene.objects]
        joints += [joints[0]] * (MAX_OBJECTS - len(joints))
        positions = [int(physics.bind(joint).qposadr) + np.arange(7) for joint in joints]
        velocities = [int(physics.bind(joint).dofadr) + np.arange(3) for joint in joints]
        self._poses = as_columns(np.concatenate(positions))
        self._speeds = as_columns(np.concatenate(velocities))

    def read(self, simulation: Simulation) -> Any:
        """Returns the present values, in fresh arrays."""
        poses = np.array(simulation.read("qpos", self._poses))
        velocities = np.array(simulation.read("qvel", self._speeds))
        by_object = velocities.reshape(*velocities.shape[:-1], MAX_OBJECTS, 3)
        return ItemReading(
            kitchen=super().read(simulation),
            poses=poses.reshape(*poses.shape[:-1], MAX_OBJECTS, 7),
            speeds=np.sqrt(rotations.squared_length(by_object)),
        )
