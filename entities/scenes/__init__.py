"""Arenas, and scenes of an arena, a robot and props."""
