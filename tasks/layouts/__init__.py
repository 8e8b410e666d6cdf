"""Checks whether an episode can be played in a layout that was drawn."""
