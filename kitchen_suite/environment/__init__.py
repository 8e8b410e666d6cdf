"""The composer environment of the suite."""

import kitchen_suite.rendering.without_gl  # noqa: F401
from kitchen_suite.environment.environment import Environment, Origin
from kitchen_suite.environment.mjcf_physics import Physics
from kitchen_suite.environment.physics_state import INTEGRATION_STATE

__all__ = ["INTEGRATION_STATE", "Environment", "Origin", "Physics"]
