"""Entities: the robots, the props and the arenas of the domains; each usable and viewable alone."""

import kitchen_suite.rendering.without_gl  # noqa: F401
from kitchen_suite.entities.arms import make_robot
from kitchen_suite.entities.arms.franka import KITCHEN_FRANKA, PANDA
from kitchen_suite.entities.cabinet import Cabinet, CabinetConfig
from kitchen_suite.entities.generated_kitchen import GeneratedKitchen, build_generated_kitchen
from kitchen_suite.entities.kitchen_designs import KitchenDesign
from kitchen_suite.entities.object_layouts import ObjectLayout, PlacedObject
from kitchen_suite.entities.objects import Bottle, Can, Carton, GraspedObject, Mug, Tray
from kitchen_suite.entities.parameters import Parameter, ParameterType
from kitchen_suite.entities.pick_and_place import PickAndPlaceKitchen, build_pick_and_place
from kitchen_suite.entities.props import (
    Counter,
    HingeCabinet,
    Hood,
    Kettle,
    KitchenProp,
    Microwave,
    Oven,
    Prop,
    SlideCabinet,
    Walls,
)
from kitchen_suite.entities.robot import Robot, RobotSpec
from kitchen_suite.entities.scenes import (
    KitchenArena,
    MicrowaveTableArena,
    OpenCabinetArena,
    OpenCabinetScene,
    Scene,
    SiteArena,
    build_kitchen_scene,
    build_microwave_table_scene,
    build_open_cabinet_scene,
)

__all__ = [
    "KITCHEN_FRANKA",
    "PANDA",
    "Bottle",
    "Cabinet",
    "CabinetConfig",
    "Can",
    "Carton",
    "Counter",
    "GeneratedKitchen",
    "GraspedObject",
    "HingeCabinet",
    "Hood",
    "Kettle",
    "KitchenArena",
    "KitchenDesign",
    "KitchenProp",
    "Microwave",
    "MicrowaveTableArena",
    "Mug",
    "ObjectLayout",
    "OpenCabinetArena",
    "OpenCabinetScene",
    "Oven",
    "Parameter",
    "ParameterType",
    "PickAndPlaceKitchen",
    "PlacedObject",
    "Prop",
    "Robot",
    "RobotSpec",
    "Scene",
    "SiteArena",
    "SlideCabinet",
    "Tray",
    "Walls",
    "build_generated_kitchen",
    "build_kitchen_scene",
    "build_microwave_table_scene",
    "build_open_cabinet_scene",
    "build_pick_and_place",
    "make_robot",
]
