"""The `mjcf.Physics` of the suite's environments: images from scenes that are kept, further names of elements."""

import ctypes
from collections.abc import Callable, Mapping, Sequence

import mujoco
import numpy as np
from dm_control import mjcf
from dm_control.mujoco import engine
from dm_control.mujoco.wrapper import MjData, MjvOption
from numpy.typing import NDArray

from kitchen_suite.environment.named_model import NamedData, NamedModel, Names
from kitchen_suite.rendering import contexts
from kitchen_suite.rendering.measuring import Camera

# Bytes before the first array of MuJoCo's options and after the last one that have the options that are numbers. The
# options are within the model, so that there is memory of the model on both sides.
_NUMBERS = 64


class Physics(mjcf.Physics):
    """`mjcf.Physics` that keeps the scenes it renders, in a GL context of the suite; see `rendering.contexts`.

    Options in `model.opt` that have been edited act in the next step, as in MuJoCo's own.
    """

    # As of the last step.
    _evaluated_options: bytes

    def step(self, nstep: int = 1) -> None:
        """Makes physics steps as `mjcf.Physics.step` does; a PhysicsError if one has diverged.

        dm_control compares MuJoCo's warnings in a context manager, which takes a tenth of the time of a short step.
        """
        before = self._warnings.tobytes()
        if self.legacy_step:
            options = self._options.raw
            if options != self._evaluated_options:
                # The step begins with MuJoCo's second half, which takes from the first what it needs for the options,
                # such as memory: with `noslip_iterations` that the first half did not know it ends the process.
                mujoco.mj_step1(self.model.ptr, self.data.ptr)
                self._evaluated_options = options
            self._step_with_up_to_date_position_velocity(nstep)
        else:
            mujoco.mj_step(self.model.ptr, self.data.ptr, nstep)
        if self._warnings.tobytes() != before:
            # It says which warnings are new, and raises the exception unless that is suppressed.
            now = self._warnings.copy()
            self._warnings[:] = np.frombuffer(before, now.dtype)
            with self.check_invalid_state():
                self._warnings[:] = now

    def render(
        self,
        height: int = 240,
        width: int = 320,
        camera_id: int | str = -1,
        overlays: Sequence[engine.TextOverlay] = (),
        depth: bool = False,
        segmentation: bool = False,
        scene_option: MjvOption | None = None,
        render_flag_overrides: Mapping[str | mujoco.mjtRndFlag, bool] | None = None,
        scene_callback: Callable[[engine.Physics, mujoco.MjvScene], None] | None = None,
    ) -> NDArray:
        """Returns an image as `mjcf.Physics.render` does; a RuntimeError, if there can be none, names the remedy.

        Depth [m] is the distance along the camera's axis of view at the centre of each pixel, without multisampling in
        any quality. Geoms that are not opaque are looked through; where nothing is seen, it is that of the far clipping
        plane.

        dm_control allocates a scene for each image, which takes up to a third of the time of a fast one. Here the
        scenes of the model's cameras are kept until the GL context is freed.
        """
        options = {
            "overlays": overlays,
            "depth": depth,
            "segmentation": segmentation,
            "scene_option": scene_option,
            "render_flag_overrides": render_flag_overrides,
        }
        if camera_id == -1 or scene_callback:
            camera = Camera(self, height, width, camera_id, scene_callback=scene_callback)
            image = camera.render(**options)
            camera.scene.free()
            return image
        key = (height, width, camera_id)
        if key not in self._cameras:
            self._cameras[key] = Camera(self, height, width, camera_id)
        # A copy, since a camera draws all its images into the same array.
        return np.array(self._cameras[key].render(**options))

    def use_names(self, names: Names) -> None:
        """Makes joints, actuators, bodies and sites of model and data be found by further names as well."""
        self._reload_from_data(MjData(NamedData(NamedModel.copy_of(self.model.ptr, names))))

    def free_context(self) -> None:
        """Frees the GL context; the next picture makes another."""
        if self._contexts:
            self._free_rendering_contexts()

    def _make_rendering_contexts(self) -> None:
        framebuffer = self.model.vis.global_
        with contexts.new_context(framebuffer.offwidth, framebuffer.offheight) as context:
            context.hold(mujoco.MjrContext(self.model.ptr, mujoco.mjtFontScale.mjFONTSCALE_150))
            mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, context.ptr)
        self._contexts = engine.Contexts(gl=context, mujoco=context)

    def _free_rendering_contexts(self) -> None:
        self._cameras.clear()
        super()._free_rendering_contexts()

    def _reload_from_data(self, data: MjData) -> None:
        # Not in the constructor, which copies do without.
        self._cameras: dict[tuple[int, int, int | str], Camera] = {}
        option = data.model.ptr.opt
        # Comparing the options one by one takes a twentieth of the time of a short step.
        start, end = option.gravity.ctypes.data - _NUMBERS, option.o_friction.ctypes.data + option.o_friction.nbytes
        self._options = (ctypes.c_char * (end + _NUMBERS - start)).from_address(start)
        self._evaluated_options = self._options.raw
        super()._reload_from_data(data)
