"""What is asked: the tasks, each with its observables, reward and termination."""

from kitchen_suite.tasks.drawer_randomization import Randomization as Randomization
from kitchen_suite.tasks.goals import GOALS as GOALS
from kitchen_suite.tasks.kitchen import KitchenTask as KitchenTask
from kitchen_suite.tasks.open_cabinet import OpenCabinetTask as OpenCabinetTask
