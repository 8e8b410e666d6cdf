"""Decides whether an episode can be played in a layout: objects stand clear of each other, and handles are in reach."""

from collections.abc import Sequence

import mujoco
from dm_control import mjcf

from kitchen_suite.entities.scenes.scene import Scene
from kitchen_suite.tasks.layouts.clearance import Clearance
from kitchen_suite.tasks.layouts.reach import Reach


class LayoutCheck:
    """Compares layouts with the default one; changes nothing in the physics."""

    def __init__(self, scene: Scene, handles: Sequence[mjcf.Element]) -> None:
        """Stores scene and handles.

        Args:
          scene: arena, robot and props.
          handles: sites that the end effector must be able to reach.
        """
        self._scene, self._handles = scene, tuple(handles)

    def bind(self, physics: mjcf.Physics) -> None:
        """Measures the default layout, in which the physics must be, the robot and all objects at their start.

        Raises:
          ValueError: a handle is out of reach.
        """
        self._model, self._data = physics.model.ptr, mujoco.MjData(physics.model.ptr)
        self._copy(physics)
        self._clearance = Clearance(self._scene, physics, self._data)
        self._reach = Reach(physics, self._scene.robot, self._handles, self._data)

    def accepts(self, physics: mjcf.Physics) -> bool:
        """Whether an episode can be played in the present layout: poses of bodies in the model, and qpos.

        The physics must be that of `bind`; its derived quantities need not be up to date.
        """
        self._copy(physics)
        return self._clearance.is_free(self._data) and self._reach.reaches_all(self._data)

    def _copy(self, physics: mjcf.Physics) -> None:
        self._data.qpos[:] = physics.data.qpos
        mujoco.mj_kinematics(self._model, self._data)
