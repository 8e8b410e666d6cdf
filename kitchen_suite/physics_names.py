"""Names of the kinds of physics, and of their infos."""

EXACT, FAST = PHYSICS = ("exact", "fast")
"""Names of the ways in which a scene is simulated; the first is the default."""

PHYSICS_KEY = "physics"
"""Key of infos: the physics, where it is not the exact one."""

HOLDING_KEY = "holding"
"""Key of infos: the physics step and the options with which fingers hold free objects, where a scene has some."""
