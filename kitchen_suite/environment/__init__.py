"""The composer environment of the suite."""

import kitchen_suite.rendering.choice  # noqa: F401
from kitchen_suite.environment.environment import Environment
from kitchen_suite.environment.physics_state import PHYSICS_STATE

__all__ = ["PHYSICS_STATE", "Environment"]
