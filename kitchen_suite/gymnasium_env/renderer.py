"""Pictures of a Gymnasium environment, by Gymnasium's own MuJoCo renderer."""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
from gymnasium.envs.mujoco import mujoco_rendering

from kitchen_suite import checks
from kitchen_suite.environment import Environment
from kitchen_suite.rendering import contexts, gl

RENDER_MODES = ("human", "rgb_array", "depth_array")

# Greatest width and height [pixels]: with four samples a pixel, an image of 4096 x 4096 takes a GL library about 1 GiB.
MAX_SIZE = 4096

_VISUAL_FLAGS = range(int(mujoco.mjtVisFlag.mjNVISFLAG))


class Renderer:
    """Renders an environment; its GL context is made for the first picture."""

    def __init__(
        self,
        *,
        width: int,
        height: int,
        camera_id: int | None,
        camera_name: str | None,
        default_camera_config: Mapping[str, Any],
        max_geom: int,
        visual_options: Mapping[int, bool] | None,
    ) -> None:
        """Checks the arguments, which are those of `SuiteEnv`."""
        if camera_name is not None and camera_id is not None:
            raise ValueError(f"pass camera_id or camera_name, not both: {checks.shown((camera_id, camera_name))}")
        if not isinstance(default_camera_config, Mapping):
            raise TypeError(f"default_camera_config must be a dict, got {checks.shown(default_camera_config)}")
        names = [name for name in dir(mujoco.MjvCamera) if not name.startswith("_")]
        config = {checks.choice(name, names, "camera attribute"): each for name, each in default_camera_config.items()}
        self._camera_id, self._camera_name = camera_id, camera_name
        self._settings: dict[str, Any] = {
            "default_cam_config": config,
            "width": checks.integer(width, "width", minimum=1, maximum=MAX_SIZE),
            "height": checks.integer(height, "height", minimum=1, maximum=MAX_SIZE),
            "camera_id": camera_id,
            "camera_name": camera_name,
            "max_geom": checks.integer(max_geom, "max_geom", minimum=1, maximum=100_000),
            "visual_options": _checked_visual_options(visual_options),
        }
        self._renderer: _MujocoRenderer | None = None

    def check_camera(self, environment: Environment) -> None:
        """Raises a TypeError or ValueError unless an environment has the camera."""
        model = environment.physics.model
        names = [model.camera(i).name for i in range(model.ncam)]
        if self._camera_name is not None:
            checks.choice(self._camera_name, names, "camera_name")
        number = self._camera_id
        if number is not None and checks.integer(number, "camera_id", minimum=-1) >= len(names):
            raise ValueError(
                f"camera_id must be below {len(names)}, got {checks.shown(number)}; the cameras are {names}"
            )

    def render(self, environment: Environment, render_mode: str) -> np.ndarray | None:
        """Returns an image, or shows it in a window; raises a RuntimeError if no GL library works here."""
        return self.mujoco_renderer(environment).render(render_mode)

    def mujoco_renderer(self, environment: Environment) -> mujoco_rendering.MujocoRenderer:
        """Returns Gymnasium's own renderer, which makes its GL context for the first image."""
        model, data = environment.physics.model.ptr, environment.physics.data.ptr
        if self._renderer is not None and self._renderer.model is not model:
            # The model has been compiled again.
            self.close()
        if self._renderer is None:
            framebuffer = model.vis.global_
            framebuffer.offwidth = max(framebuffer.offwidth, self._settings["width"])
            framebuffer.offheight = max(framebuffer.offheight, self._settings["height"])
            self._renderer = _MujocoRenderer(model, data, **self._settings)
        return self._renderer

    def close(self) -> None:
        """Frees the GL context; the next picture makes another."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


class _MujocoRenderer(mujoco_rendering.MujocoRenderer):
    """Gymnasium's renderer, whose arrays are rendered in a GL context of the suite; see `rendering.contexts`."""

    # Gymnasium's class has None as well; the suite gives a size, and `render` makes the viewer.
    width: int
    height: int
    viewer: Any

    def render(self, render_mode: str | None) -> np.ndarray | None:
        if render_mode == "human":
            gl.check_process()
            return super().render(render_mode)
        viewer = self._get_viewer(render_mode)
        with viewer.context.make_current():
            return super().render(render_mode)

    def close(self) -> None:
        for viewer in self._viewers.values():
            if isinstance(viewer, mujoco_rendering.WindowViewer):
                # MuJoCo's own objects first, in their own context: freed later, they would be those of another one.
                viewer.make_context_current()
                viewer.con.free()
        super().close()

    def _get_viewer(self, render_mode: str | None) -> Any:
        if render_mode in self._viewers:
            viewer = super()._get_viewer(render_mode)
            # Another environment may have rendered since.
            viewer.make_context_current()
            return viewer
        if render_mode == "human":
            gl.check_window()
            with gl.opening():
                return super()._get_viewer(render_mode)
        with contexts.new_context(self.width, self.height) as context:
            viewer = _Viewer(context, self.model, self.data, self.width, self.height, self.max_geom, self._vopt)
            context.hold(viewer.con)
        # Gymnasium sets the camera of the present viewer.
        self.viewer = viewer
        self._set_cam_config()
        self._viewers[render_mode] = viewer
        return viewer


class _Viewer(mujoco_rendering.OffScreenViewer):
    """Gymnasium's viewer in a GL context of the suite, which is current where the viewer is made and used."""

    def __init__(self, context: contexts.Context, *args: Any) -> None:
        """Takes the context, then the arguments of `OffScreenViewer`."""
        self.context = context
        super().__init__(*args)

    def _get_opengl_backend(self, width: int, height: int) -> None:
        """Makes none: the context is given."""

    def make_context_current(self) -> None:
        """Does nothing."""

    def close(self) -> None:
        # Without an end of GLFW, as Gymnasium has it: other environments may show windows.
        self.context.free()

    def free(self) -> None:
        """Does nothing when Gymnasium's viewer is collected: the context sees to itself."""


def checked_render_mode(render_mode: str) -> str:
    """Returns a render mode of the environments; raises a RuntimeError for a window where there is no display."""
    if render_mode == "rgb_array_list":
        raise ValueError("render_mode 'rgb_array_list' needs gymnasium.make; use 'rgb_array' here")
    if checks.choice(render_mode, RENDER_MODES, "render_mode") == "human":
        gl.check_window()
    return render_mode


def _checked_visual_options(options: Mapping[int, bool] | None) -> dict[int, bool]:
    if options is not None and not isinstance(options, Mapping):
        raise TypeError(f"visual_options must be a dict, got {checks.shown(options)}")
    if odd := [flag for flag in options or {} if flag not in _VISUAL_FLAGS]:
        raise ValueError(
            f"visual_options must be numbers of mujoco.mjtVisFlag, 0 to {_VISUAL_FLAGS[-1]}, got {checks.shown(odd)}"
        )
    return {int(flag): checks.boolean(value, "visual option") for flag, value in (options or {}).items()}
