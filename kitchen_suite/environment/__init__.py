"""The composer environment of the suite."""

from kitchen_suite.environment.environment import PHYSICS_STATE as PHYSICS_STATE
from kitchen_suite.environment.environment import Environment as Environment
