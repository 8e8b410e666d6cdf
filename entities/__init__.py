"""What exists: the Franka, the things in the kitchen, the cabinet, the rooms; each usable and viewable alone."""

from kitchen_suite.entities.cabinet import Cabinet as Cabinet
from kitchen_suite.entities.cabinet_arena import CabinetArena as CabinetArena
from kitchen_suite.entities.cabinet_arena import CabinetScene as CabinetScene
from kitchen_suite.entities.cabinet_arena import build_cabinet_scene as build_cabinet_scene
from kitchen_suite.entities.cabinet_design import CabinetDesign as CabinetDesign
from kitchen_suite.entities.calibration_kitchen import KITCHEN as KITCHEN
from kitchen_suite.entities.calibration_panda import PANDA as PANDA
from kitchen_suite.entities.franka import Franka as Franka
from kitchen_suite.entities.kitchen_arena import Kitchen as Kitchen
from kitchen_suite.entities.kitchen_arena import KitchenArena as KitchenArena
from kitchen_suite.entities.kitchen_arena import build_kitchen as build_kitchen
from kitchen_suite.entities.kitchen_props import Counter as Counter
from kitchen_suite.entities.kitchen_props import HingeCabinet as HingeCabinet
from kitchen_suite.entities.kitchen_props import Hood as Hood
from kitchen_suite.entities.kitchen_props import Kettle as Kettle
from kitchen_suite.entities.kitchen_props import KitchenProp as KitchenProp
from kitchen_suite.entities.kitchen_props import Microwave as Microwave
from kitchen_suite.entities.kitchen_props import Oven as Oven
from kitchen_suite.entities.kitchen_props import SlideCabinet as SlideCabinet
from kitchen_suite.entities.kitchen_props import Walls as Walls
