"""What is asked: the tasks, each with its observables, reward and termination."""

from kitchen_suite.tasks.kitchen.goals import GOALS as GOALS
from kitchen_suite.tasks.kitchen.task import KitchenTask as KitchenTask
from kitchen_suite.tasks.open_cabinet.randomization import Randomization as Randomization
from kitchen_suite.tasks.open_cabinet.task import OpenCabinetTask as OpenCabinetTask
