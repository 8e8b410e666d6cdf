"""A camera whose depth is exact, whatever the quality of colours."""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
from typing import Any

import mujoco
import numpy as np
from dm_control.mujoco import engine

# Opacity from which MuJoCo draws a geom as one that hides what is behind it.
_MIN_OPAQUE = 0.995


class Camera(engine.Camera):
    """`dm_control.mujoco.Camera` that measures depth at the centres of pixels.

    dm_control reads depth from an image in colours. With multisampling, the depth of a pixel is that of a sample beside
    its centre, and a sky is seen at its own distance. MuJoCo's pass for segmentation, which is used here, draws neither
    shadows nor sky, and has no multisampling.
    """

    def _render_on_gl_thread(self, depth: bool, overlays: Any) -> None:
        if not depth:
            super()._render_on_gl_thread(depth, overlays)
            return
        self._show_opaque_geoms()
        with self.scene.override_flags({mujoco.mjtRndFlag.mjRND_SEGMENT: True}):
            super()._render_on_gl_thread(depth, overlays)

    def _show_opaque_geoms(self) -> None:
        """Lets the pass for segmentation draw the geoms that have depth in images in colours, and no others."""
        eye = np.mean([camera.pos for camera in self.scene.camera], axis=0)
        for geom in self.scene.geoms:
            # Planes are seen through from behind.
            is_behind = geom.type == mujoco.mjtGeom.mjGEOM_PLANE and (eye - geom.pos) @ geom.mat[:, 2] < 0
            is_opaque = geom.rgba[3] >= _MIN_OPAQUE and not is_behind
            # The next image updates the scene.
            geom.segid = 0 if is_opaque else -1
