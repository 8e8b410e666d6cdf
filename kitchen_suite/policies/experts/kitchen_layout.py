"""Layout of the kitchen as its expert observes it: poses of the furniture and of the robot's base."""

import functools
from collections.abc import Collection, Mapping, Sequence

import mink
import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities import build_kitchen_scene
from kitchen_suite.tasks import extra_observables
from kitchen_suite.tasks.kitchen.goals import GOALS

BASE = "franka/base_pose"

# The observable of the object that each task moves and that stands on the floor, the counter or the wall; the kettle's
# pose is part of the kitchen's observation.
POSES = {task: f"{goal.prop}/pose" for task, goal in GOALS.items() if goal.prop != "kettle"}

_OBSERVABLES = frozenset((BASE, *POSES.values()))


class ObservedLayout:
    """Reads the poses among the extra observables of an observation.

    Attributes:
      slices: slice of each pose that is observed, among the extra observables.
      size: number of all extra observables' elements; 0 if none of them is a pose of the layout.
    """

    def __init__(self, extras: Sequence[str]) -> None:
        """Looks up the poses; `extras` are the names of the task's extra observables.

        Raises:
          TypeError: `extras` is no sequence of strings.
          ValueError: an unknown or repeated name.
        """
        slices = extra_observables.slices(build_kitchen_scene(visuals=False), extras) if len(extras) else {}
        self.slices = {name: part for name, part in slices.items() if name in _OBSERVABLES}
        self.size = max((part.stop for part in slices.values()), default=0) if self.slices else 0

    def frame(self, task: str, extras: NDArray[np.float64]) -> mink.SE3 | None:
        """Returns the transform of a task's poses, from the default layout to the observed one.

        The transform is for planning with the robot's base at its default pose. It is None if no pose is observed.

        Args:
          task: name of the task.
          extras: `(size,)`, the extra observables.
        """
        if not self.slices:
            return None
        return self._moved(BASE, extras).inverse() @ self._moved(POSES.get(task), extras)

    def _moved(self, name: str | None, extras: NDArray[np.float64]) -> mink.SE3:
        """Returns the transform from a default pose to the observed one; the identity if it is not observed."""
        if name not in self.slices:
            return mink.SE3.identity()
        return _pose(extras[self.slices[name]]) @ _default_poses()[name].inverse()


def needed_observables(tasks: Collection[str], varied: Collection[str]) -> list[str]:
    """Returns the names of the poses that the expert must observe for its tasks where parameters vary."""
    owners = {name.partition("/")[0] for name in varied if name.endswith(("/offset", "/yaw"))}
    needed = {POSES[task] for task in tasks if task in POSES and GOALS[task].prop in owners}
    return sorted(needed | ({BASE} if "pedestal" in owners else set()))


@functools.cache
def _default_poses() -> Mapping[str, mink.SE3]:
    """Poses in the world of the default layout by name."""
    scene = build_kitchen_scene(visuals=False)
    physics = mjcf.Physics.from_mjcf_model(scene.arena.mjcf_model)
    entities = {BASE: scene.robot, **{f"{name}/pose": prop for name, prop in scene.props.items()}}
    frames = {name: physics.bind(mjcf.get_attachment_frame(entities[name].mjcf_model)) for name in _OBSERVABLES}
    return {name: _pose(np.concatenate([frame.xpos, frame.xquat])) for name, frame in frames.items()}


def _pose(values: NDArray[np.float64]) -> mink.SE3:
    """Returns the pose of a position and a quaternion `(7,)`."""
    return mink.SE3.from_rotation_and_translation(mink.SO3(wxyz=values[3:]).normalize(), values[:3])
