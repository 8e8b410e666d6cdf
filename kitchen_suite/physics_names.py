"""Names of the kinds of physics."""

EXACT, FAST = PHYSICS = ("exact", "fast")
"""Names of the ways in which a scene is simulated; the first is the default."""
