"""Highlights the objects of tasks that are within their thresholds."""

from collections.abc import Iterable, Sequence

import numpy as np
from dm_control import mjcf

from kitchen_suite.tasks.base import SUCCESS_RGBA
from kitchen_suite.tasks.kitchen.goals import GOALS


class GoalHighlighting:
    """Colours of the objects of some tasks: their own, or green."""

    def __init__(self, physics: mjcf.Physics, tasks: Iterable[str], object_joints: Sequence[mjcf.Element]) -> None:
        """Finds the geoms that move with each task's joints, and stores their own colours."""
        self._physics = physics
        joints = {joint.full_identifier: joint for joint in object_joints}
        self._geoms = [
            [geom for name in GOALS[task].joints for geom in joints[name].parent.find_all("geom")] for task in tasks
        ]
        self._own_rgba = [np.array(physics.bind(geoms).rgba) for geoms in self._geoms]

    def update(self, within: Iterable[bool]) -> None:
        """Colours the objects of tasks `within` their thresholds green, and restores the others' own colours."""
        for geoms, own_rgba, is_within in zip(self._geoms, self._own_rgba, within, strict=True):
            self._physics.bind(geoms).rgba = SUCCESS_RGBA if is_within else own_rgba
