"""Shows by colour which tasks are within their thresholds."""

from collections.abc import Iterable, Sequence

import numpy as np
from dm_control import mjcf

from kitchen_suite.entities import joints as joint_tables
from kitchen_suite.tasks.kitchen.goals import GOALS

_WITHIN_RGBA = (0.25, 0.75, 0.3, 1.0)


class GoalHighlighting:
    """The things of some tasks, in their own colours or in green."""

    def __init__(self, physics: mjcf.Physics, tasks: Iterable[str], object_joints: Sequence[mjcf.Element]) -> None:
        """Finds the geoms that move with each task's joints, and notes their own colours."""
        self._physics = physics
        owners = joint_tables.owners(physics, object_joints)
        self._geoms = [
            [
                geom
                for i in np.unique(owners[list(GOALS[task].elements)])
                for geom in object_joints[i].parent.find_all("geom")
            ]
            for task in tasks
        ]
        self._own = [np.array(physics.bind(geoms).rgba) for geoms in self._geoms]

    def paint(self, within: Iterable[bool]) -> None:
        """Paints the things of the tasks that are `within` their thresholds green, the others as they were."""
        for geoms, own, green in zip(self._geoms, self._own, within, strict=True):
            self._physics.bind(geoms).rgba = _WITHIN_RGBA if green else own
