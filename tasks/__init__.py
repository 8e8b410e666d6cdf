"""What is asked: the tasks, each with its observables, reward and termination."""

from kitchen_suite.tasks.goals import GOALS as GOALS
from kitchen_suite.tasks.kitchen import KitchenTask as KitchenTask
