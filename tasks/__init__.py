"""The tasks, by domain: observables, actions, rewards, termination and the start of episodes."""

from kitchen_suite.tasks.kitchen.goals import GOALS as GOALS
from kitchen_suite.tasks.kitchen.task import KitchenTask as KitchenTask
from kitchen_suite.tasks.open_cabinet.randomization import Randomization as Randomization
from kitchen_suite.tasks.open_cabinet.task import OpenCabinetTask as OpenCabinetTask
