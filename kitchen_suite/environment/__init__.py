"""The composer environment of the suite."""

import kitchen_suite.rendering.without_gl  # noqa: F401
from kitchen_suite.environment.environment import PHYSICS_STATE, Environment, Origin, Physics

__all__ = ["PHYSICS_STATE", "Environment", "Origin", "Physics"]
