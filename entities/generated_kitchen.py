"""Scenes of generated kitchens, built from their designs, with what only images show."""

import dataclasses
from collections.abc import Iterator
from types import MappingProxyType

import numpy as np

from kitchen_suite.entities.arms.franka import KITCHEN_FRANKA
from kitchen_suite.entities.fixtures import GAP, PANEL, Part
from kitchen_suite.entities.kitchen_designs import Design, KitchenDesign
from kitchen_suite.entities.kitchen_plans import SIDES, Placed, Side
from kitchen_suite.entities.kitchen_styles import DARK, STEEL, STYLES, TILES, Style
from kitchen_suite.entities.parameters import Parameter, door_parameters
from kitchen_suite.entities.props import Kettle, Prop
from kitchen_suite.entities.robot import Robot
from kitchen_suite.entities.scenes import FLOOR, GeneratedKitchenArena, Scene, exclude_base_contacts
from kitchen_suite.types import Vector

MAX_PARTS = 16  # Greatest number of parts in a kitchen.

# Position of a kettle on the first burner, in the frame of the oven [m].
_KETTLE_PLACE = np.array([-0.169, -0.4, 1.626])

# The kettle counts as moved when it has come 0.4 m back, to the next burner.
_KETTLE = Part("kettle", None, "handle", 0.4, "kettle", twin="kettle")

_WALL_REACH = 1.4  # Half the width of the back wall [m].
_WALL_TOP = 3.1  # Height of the walls' upper edges [m].
_WALL = 0.05  # Thickness of the walls [m].
_TILES_HEIGHT = 0.5  # Height of the tiles above the counter [m].
_TILES_DEPTH = 0.005  # Thickness of the tiles [m].

_PLINTH = 0.1  # Height of plinths [m].
_RECESS = 0.05  # How far plinths stand back [m].

# Of the panel behind the knobs of an oven.
_PANEL_FRONT = 0.64  # Distance from the oven's front [m].
_PANEL_BOTTOM = 0.57  # Height of its lower edge above the counter [m].
_PANEL_TOP = 0.8  # Height of its upper edge above the counter [m].


@dataclasses.dataclass(frozen=True, kw_only=True)
class GeneratedKitchen(Scene):
    """A robot in a generated kitchen.

    Attributes:
      design: of the kitchen.
      parts: the parts that move, each with the name of its prop, in the order of the design.
    """

    design: KitchenDesign
    parts: tuple[tuple[str, Part], ...]

    @property
    def part_names(self) -> tuple[str, ...]:
        """Names of the parts, such as `drawers_1/drawer_2`."""
        return tuple(f"{name}/{part.joint or part.handle}" for name, part in self.parts)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Those of every scene, and factors of damping and of dry friction of all drawers, doors and knobs together."""
        joints = [self.props[name].mjcf_model.find("joint", part.joint) for name, part in self.parts if part.joint]
        return (*super().parameters, *door_parameters("fixtures", joints))


def build_generated_kitchen(design: Design = 0, split: str = "train", *, visuals: bool = True) -> GeneratedKitchen:
    """Builds the kitchen of a design.

    Args:
      design: number of a design of the split, from 0; a `KitchenDesign`; or a JSON object, or the path of a file with
        one; see docs/domains/kitchens.md.
      split: to which the number belongs, `train` or `test`.
      visuals: `False` leaves out the visual geoms, which is faster; trajectories are the same to the bit.
    """
    made = KitchenDesign.make(design, split)
    arena = GeneratedKitchenArena(visuals=visuals)
    # The robot first, without its site in the world: all that is of it has the same indices in every kitchen.
    robot = Robot(KITCHEN_FRANKA, visuals=visuals)
    arena.attach_robot(robot)
    arena.mjcf_model.find("site", robot.mjcf_model.model).remove()
    style = STYLES[made.style]
    props: dict[str, Prop] = {}
    parts: list[tuple[str, Part]] = []
    for placed in made.placed:
        built = placed.design.build(style, visuals=visuals, name=placed.name)
        props[placed.name] = built.prop
        arena.attach_at(built.prop, placed.in_world(np.array(placed.design.origin)), placed.yaw)
        parts += [(placed.name, part) for part in built.parts]
    if made.kettle:
        oven = next(each for each in made.placed if each.design.kind == "oven")
        kettle = Kettle(visuals=visuals)
        props["kettle"] = kettle
        place = oven.in_world(np.array(oven.design.origin) + _KETTLE_PLACE)
        arena.attach_at(kettle, place, oven.yaw).add("freejoint")
        parts.append(("kettle", _KETTLE))
    if len(parts) > MAX_PARTS:
        raise ValueError(f"rows must have at most {MAX_PARTS} drawers, doors and knobs, got {len(parts)}")
    if visuals:
        _add_surroundings(arena, made)
    scene = GeneratedKitchen(arena=arena, robot=robot, props=MappingProxyType(props), design=made, parts=tuple(parts))
    exclude_base_contacts(arena, robot)
    return scene


def _add_surroundings(arena: GeneratedKitchenArena, design: KitchenDesign) -> None:
    """Adds what only images show: walls, tiles, and boxes between the fixtures and the floor or the wall."""
    style = STYLES[design.style]
    backs: dict[Side, float] = dict.fromkeys(SIDES, 0.0)
    for placed in design.placed:
        back = placed.row.distance + placed.design.extent.depth
        backs[placed.row.side] = max(backs[placed.row.side], back)
    for placed in design.placed:
        for name, low, high, color in _fillings(placed, backs[placed.row.side], style):
            if (np.subtract(high, low) > 1e-3).all():
                corners = np.sort([placed.in_world(np.array(low)), placed.in_world(np.array(high))], axis=0)
                arena.add_box(f"{placed.name}_{name}", *corners, rgba=(*color, 1))
    paint = {"rgba": (*style.wall, 1)}
    left = -max(backs["left"], _WALL_REACH)
    right = max(backs["right"], _WALL_REACH)
    back = backs["back"] or _WALL_REACH
    arena.add_box("back_wall", (left, back, FLOOR), (right, back + _WALL, _WALL_TOP), **paint)
    tiles_low = (left, back - _TILES_DEPTH, design.counter_height)
    tiles_high = (right, back, design.counter_height + _TILES_HEIGHT)
    arena.add_box("tiles", tiles_low, tiles_high, rgba=(*TILES, 1))
    for side, inner, outer in (("left", left, left - _WALL), ("right", right, right + _WALL)):
        fronts = [placed.bounds[0][1] for placed in design.placed if placed.row.side == side]
        if fronts:
            low = (min(inner, outer), min(fronts) - 0.1, FLOOR)
            high = (max(inner, outer), max(back, *fronts) + _WALL, _WALL_TOP)
            arena.add_box(f"{side}_wall", low, high, **paint)


def _fillings(placed: Placed, wall: float, style: Style) -> Iterator[tuple[str, Vector, Vector, Vector]]:
    """Yields names, corners in a fixture's frame [m] and colours of the boxes that complete the fixture.

    `wall` is the distance of the wall behind it from the axis of the robot's base [m].
    """
    (left, _, bottom), (right, depth, top) = placed.design.extent
    back = wall - placed.row.distance
    floor = FLOOR - placed.position[2]
    if placed.row.level != "counter":
        yield "filling", (left, depth, bottom), (right, back, top), style.carcass
    if placed.design.kind == "oven":
        # Behind the knobs, where the hood is if there is one.
        yield "panel", (left + 0.01, _PANEL_FRONT, _PANEL_BOTTOM), (right - 0.01, back, _PANEL_TOP), DARK
    elif placed.row.level in ("base", "tall"):
        plinth = floor + _PLINTH
        yield "plinth", (left, _RECESS, floor), (right, back, min(plinth, bottom)), DARK
        yield "lower_carcass", (left, PANEL, plinth), (right, back, bottom), style.carcass
        front = STEEL if placed.design.kind == "stove" else style.front
        yield "lower_front", (left + GAP, 0.0, plinth), (right - GAP, PANEL, bottom), front
