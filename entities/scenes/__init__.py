"""Arenas, and scenes put together from an arena, a robot and props."""
