"""Entities: the Franka, the props of kitchen and open_cabinet, and the arenas; each usable and viewable alone."""

import kitchen_suite.rendering.choice  # noqa: F401
from kitchen_suite.entities.props.cabinet import Cabinet
from kitchen_suite.entities.props.cabinet_config import CabinetConfig
from kitchen_suite.entities.props.kitchen import (
    Counter,
    HingeCabinet,
    Hood,
    Kettle,
    KitchenProp,
    Microwave,
    Oven,
    SlideCabinet,
    Walls,
)
from kitchen_suite.entities.robots.franka import Franka
from kitchen_suite.entities.robots.kitchen_franka import KITCHEN_FRANKA
from kitchen_suite.entities.robots.panda import PANDA
from kitchen_suite.entities.scenes.kitchen import KitchenArena, build_kitchen_scene
from kitchen_suite.entities.scenes.open_cabinet import OpenCabinetArena, OpenCabinetScene, build_open_cabinet_scene
from kitchen_suite.entities.scenes.scene import Scene

__all__ = [
    "KITCHEN_FRANKA",
    "PANDA",
    "Cabinet",
    "CabinetConfig",
    "Counter",
    "Franka",
    "HingeCabinet",
    "Hood",
    "Kettle",
    "KitchenArena",
    "KitchenProp",
    "Microwave",
    "OpenCabinetArena",
    "OpenCabinetScene",
    "Oven",
    "Scene",
    "SlideCabinet",
    "Walls",
    "build_kitchen_scene",
    "build_open_cabinet_scene",
]
