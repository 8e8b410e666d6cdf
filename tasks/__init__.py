"""The tasks, by domain: observables, actions, rewards, termination and the start of episodes."""

import kitchen_suite.rendering.choice  # noqa: F401
from kitchen_suite.tasks.kitchen.goals import DEFAULT_TASKS, GOALS
from kitchen_suite.tasks.kitchen.task import KitchenTask
from kitchen_suite.tasks.open_cabinet.task import OpenCabinetTask
from kitchen_suite.tasks.open_cabinet.variations import Randomization

__all__ = ["DEFAULT_TASKS", "GOALS", "KitchenTask", "OpenCabinetTask", "Randomization"]
