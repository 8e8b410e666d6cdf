"""dm_control's physics, with less time between images, and a clear error where no GL library works."""

from typing import Any

import numpy as np
from dm_control import mjcf
from dm_control.mujoco import Camera
from dm_control.mujoco.wrapper import MjData
from numpy.typing import NDArray

from kitchen_suite.rendering import gl


class Physics(mjcf.Physics):
    """`mjcf.Physics` that keeps the scenes it renders.

    Where nothing can be rendered, `render` raises a RuntimeError that names the remedy.
    """

    def render(
        self, height: int = 240, width: int = 320, camera_id: int | str = -1, *arguments: Any, **options: Any
    ) -> NDArray:
        """Returns an image as `mjcf.Physics.render` does.

        dm_control allocates a scene for each image, which takes up to a third of the time of a fast one. Here the
        scenes of the model's cameras are kept until the GL context is freed.
        """
        if camera_id == -1 or options.get("scene_callback"):
            return super().render(height, width, camera_id, *arguments, **options)
        options.pop("scene_callback", None)
        key = (height, width, camera_id)
        if key not in self._cameras:
            self._cameras[key] = Camera(self, height, width, camera_id)
        # A copy, since a camera draws all its images into the same array.
        return np.array(self._cameras[key].render(*arguments, **options))

    def free_context(self) -> None:
        """Frees the GL context; the next picture makes another."""
        if self._contexts:
            self._free_rendering_contexts()

    def _make_rendering_contexts(self) -> None:
        with gl.making_dm_control_context(self):
            super()._make_rendering_contexts()

    def _free_rendering_contexts(self) -> None:
        self._cameras.clear()
        super()._free_rendering_contexts()

    def _reload_from_data(self, data: MjData) -> None:
        # Not in the constructor, which copies do without.
        self._cameras: dict[tuple[int, int, int | str], Camera] = {}
        super()._reload_from_data(data)
