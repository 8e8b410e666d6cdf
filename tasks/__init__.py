"""The tasks, by domain: observables, actions, rewards, termination and the start of episodes."""

import kitchen_suite.rendering.without_gl  # noqa: F401
from kitchen_suite.kitchen_tasks import DEFAULT_TASKS
from kitchen_suite.tasks.control_modes.action_mode import ActionMode, unit_spec
from kitchen_suite.tasks.control_modes.registry import OFFSET_MODES, make_mode, split_options
from kitchen_suite.tasks.generated_kitchens.task import GeneratedKitchenTask
from kitchen_suite.tasks.goals import Goal
from kitchen_suite.tasks.kitchen.goals import GOALS
from kitchen_suite.tasks.kitchen.task import KitchenTask
from kitchen_suite.tasks.mdp import MDP
from kitchen_suite.tasks.microwave_table.task import MicrowaveTableTask
from kitchen_suite.tasks.open_cabinet.task import OpenCabinetTask
from kitchen_suite.tasks.pick_and_place.task import PickAndPlaceTask
from kitchen_suite.tasks.sensors import FeatureSensors
from kitchen_suite.tasks.simulation import Simulation
from kitchen_suite.tasks.task import SuiteTask
from kitchen_suite.tasks.terms import Observation, Transition
from kitchen_suite.tasks.variations.distributions import ParameterVariation, around, between, one_of

__all__ = [
    "DEFAULT_TASKS",
    "GOALS",
    "MDP",
    "OFFSET_MODES",
    "ActionMode",
    "FeatureSensors",
    "GeneratedKitchenTask",
    "Goal",
    "KitchenTask",
    "MicrowaveTableTask",
    "Observation",
    "OpenCabinetTask",
    "ParameterVariation",
    "PickAndPlaceTask",
    "Simulation",
    "SuiteTask",
    "Transition",
    "around",
    "between",
    "make_mode",
    "one_of",
    "split_options",
    "unit_spec",
]
