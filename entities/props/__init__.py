"""Objects that a scene is furnished with."""
