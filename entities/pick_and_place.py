"""Scenes of generated kitchens with objects that are picked up and put away."""

import dataclasses
import math
from types import MappingProxyType
from typing import Any

import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities import assets
from kitchen_suite.entities.generated_kitchen import GeneratedKitchen, build_generated_kitchen
from kitchen_suite.entities.kitchen_designs import Design, KitchenDesign
from kitchen_suite.entities.object_layouts import MAX_OBJECTS, TRAY, ObjectLayout, PlacedObject
from kitchen_suite.entities.objects import OBJECTS, GraspedObject, Tray
from kitchen_suite.entities.parameters import (
    FREE_DISPLACEMENT,
    MASS_SCALE,
    SLIDING_FRICTION_SCALE,
    Parameter,
    ParameterType,
    scale,
)
from kitchen_suite.entities.places import Place
from kitchen_suite.entities.props import Prop

DEFAULT_DESIGN = 5
"""Number of the kitchen of the split `train` that is built by default: it has a task for each verb."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class PickAndPlaceKitchen(GeneratedKitchen):
    """A robot in a generated kitchen with objects.

    Attributes:
      layout: of the objects.
      objects: the objects, in the order of the layout.
      places: where they may be put, in the world, in the order of the layout.
    """

    layout: ObjectLayout
    objects: tuple[GraspedObject, ...]
    places: tuple[Place, ...]

    @property
    def object_words(self) -> tuple[str, ...]:
        """The objects in words: `can`, or `left can` and `right can`, as the robot sees them at the start."""
        placed = self.layout.objects
        words = []
        for each in placed:
            same = sorted(_azimuth(other) for other in placed if other.kind == each.kind)
            here = _azimuth(each)
            sides = {1: ("",), 2: ("left ", "right ")}[len(same)]
            words.append(f"{sides[same.index(here)]}{each.kind}")
        return tuple(words)

    def joint_of(self, part: str) -> mjcf.Element:
        """Returns the joint of a part by its name, such as `drawers_1/drawer_1`."""
        name, _, joint = part.partition("/")
        return self.props[name].mjcf_model.find("joint", joint)

    def into(self, place: Place) -> NDArray[np.float64]:
        """Returns the direction `(3,)` into the fixture that a place belongs to."""
        name = place.name.partition("/")[0]
        fixture = next(each for each in self.design.placed if each.name == name)
        return fixture.in_world(np.array([0.0, 1.0, 0.0])) - fixture.position

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Those of every generated kitchen, and those of all objects together."""
        bodies = [thing.body for thing in self.objects]
        geoms = [geom for body in bodies for geom in body.geom if not assets.is_visual(geom)]
        joints = tuple(thing.joints[0] for thing in self.objects)
        return (
            *super().parameters,
            Parameter(name="objects/displacement", unit="m, m, rad", type=_DISPLACEMENTS, elements=joints),
            scale("objects/mass_scale", MASS_SCALE, bodies),
            scale("objects/friction_scale", SLIDING_FRICTION_SCALE, geoms),
        )


def _azimuth(placed: PlacedObject) -> float:
    """Returns the direction of an object as the robot sees it, from left to right [rad]."""
    x, y, _ = placed.position
    return math.atan2(x, y)


def _displace(physics: mjcf.Physics, joints: tuple[mjcf.Element, ...], value: NDArray[np.float64]) -> None:
    for joint, each in zip(joints, value.reshape(MAX_OBJECTS, 3), strict=False):
        FREE_DISPLACEMENT.write(physics, (joint,), each)


# Displacement of each object from where an episode starts: x and y [m], and rotation about the vertical [rad].
_DISPLACEMENTS = ParameterType(
    read=lambda physics, joints: np.zeros(3 * MAX_OBJECTS), write=_displace, model_fields=(), shape=(3 * MAX_OBJECTS,)
)


def build_pick_and_place(
    design: Design = DEFAULT_DESIGN, split: str = "train", objects: Any = None, *, visuals: bool = True
) -> PickAndPlaceKitchen:
    """Builds the kitchen of a design, with objects.

    Args:
      design: number of a design of the split, from 0; a `KitchenDesign`; or a JSON object, or the path of a file with
        one; see docs/domains/kitchens.md.
      split: to which the number belongs, `train` or `test`.
      objects: an `ObjectLayout` or its JSON object; that which the design's number draws when omitted.
      visuals: `False` leaves out the visual geoms, which is faster; trajectories are the same to the bit.
    """
    made = KitchenDesign.make(design, split)
    layout = ObjectLayout.make(objects, made)
    kitchen = build_generated_kitchen(made, visuals=visuals)
    props: dict[str, Prop] = {**kitchen.props}
    if layout.tray is not None:
        *position, yaw = layout.tray
        props[TRAY] = Tray(visuals=visuals)
        kitchen.arena.attach_at(props[TRAY], position, yaw)
    placed: list[GraspedObject] = []
    for name, each in zip(layout.names, layout.objects, strict=True):
        thing = OBJECTS[each.kind](visuals=visuals, name=name)
        kitchen.arena.attach_at(thing, each.position, each.yaw).add("freejoint")
        props[name] = thing
        placed.append(thing)
    fields = {field.name: getattr(kitchen, field.name) for field in dataclasses.fields(kitchen)}
    return PickAndPlaceKitchen(
        **{**fields, "props": MappingProxyType(props)},
        layout=layout,
        objects=tuple(placed),
        places=layout.places_in(made),
    )
