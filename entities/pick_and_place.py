"""Scenes of generated kitchens with objects that are picked up and put away."""

import dataclasses
from types import MappingProxyType
from typing import Any

from kitchen_suite.entities.generated_kitchen import GeneratedKitchen, build_generated_kitchen
from kitchen_suite.entities.kitchen_designs import Design, KitchenDesign
from kitchen_suite.entities.object_layouts import TRAY, ObjectLayout
from kitchen_suite.entities.objects import OBJECTS, GraspedObject, Tray
from kitchen_suite.entities.places import Place
from kitchen_suite.entities.props import Prop


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


def build_pick_and_place(
    design: Design = 0, split: str = "train", objects: Any = None, *, visuals: bool = True
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
