"""Entities: the Franka, the props of kitchen and open_cabinet, and the arenas; each usable and viewable alone."""

from kitchen_suite.entities.props.cabinet import Cabinet as Cabinet
from kitchen_suite.entities.props.cabinet_config import CabinetConfig as CabinetConfig
from kitchen_suite.entities.props.kitchen import Counter as Counter
from kitchen_suite.entities.props.kitchen import HingeCabinet as HingeCabinet
from kitchen_suite.entities.props.kitchen import Hood as Hood
from kitchen_suite.entities.props.kitchen import Kettle as Kettle
from kitchen_suite.entities.props.kitchen import KitchenProp as KitchenProp
from kitchen_suite.entities.props.kitchen import Microwave as Microwave
from kitchen_suite.entities.props.kitchen import Oven as Oven
from kitchen_suite.entities.props.kitchen import SlideCabinet as SlideCabinet
from kitchen_suite.entities.props.kitchen import Walls as Walls
from kitchen_suite.entities.robots.franka import Franka as Franka
from kitchen_suite.entities.robots.kitchen_franka import KITCHEN_FRANKA as KITCHEN_FRANKA
from kitchen_suite.entities.robots.panda import PANDA as PANDA
from kitchen_suite.entities.scenes.kitchen import KitchenArena as KitchenArena
from kitchen_suite.entities.scenes.kitchen import KitchenScene as KitchenScene
from kitchen_suite.entities.scenes.kitchen import build_kitchen_scene as build_kitchen_scene
from kitchen_suite.entities.scenes.open_cabinet import OpenCabinetArena as OpenCabinetArena
from kitchen_suite.entities.scenes.open_cabinet import OpenCabinetScene as OpenCabinetScene
from kitchen_suite.entities.scenes.open_cabinet import build_open_cabinet_scene as build_open_cabinet_scene
