"""Variations of parameters from episode to episode: distributions, draws, layouts and appearance."""
