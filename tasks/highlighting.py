"""Highlights the objects of tasks that are within their thresholds."""

from collections.abc import Iterable

import numpy as np
from dm_control import mjcf

from kitchen_suite.entities.scenes.scene import Scene
from kitchen_suite.tasks.base import SUCCESS_RGBA
from kitchen_suite.tasks.goals import GoalSet


class GoalHighlighting:
    """Colours of the objects of some tasks: their own, or green."""

    def __init__(self, physics: mjcf.Physics, scene: Scene, goals: GoalSet) -> None:
        """Finds the geoms that move with each task's joints, and stores their own colours."""
        self._physics = physics
        self._geoms = [
            [geom for joint in goal.joints_in(scene) for geom in joint.parent.find_all("geom")] for goal in goals.goals
        ]
        self._own_rgba = [np.array(physics.bind(geoms).rgba) for geoms in self._geoms]

    def update(self, within: Iterable[bool]) -> None:
        """Colours the objects of tasks `within` their thresholds green, and restores the others' own colours."""
        for geoms, own_rgba, is_within in zip(self._geoms, self._own_rgba, within, strict=True):
            self._physics.bind(geoms).rgba = SUCCESS_RGBA if is_within else own_rgba
