"""Scenes of models in a viser server, as the live viewer and recorded pages show them; needs the extra `web`."""

import contextlib
import copy
import functools
import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.rendering.viser_servers import silent_server

if TYPE_CHECKING:
    import mujoco
    import viser
    from dm_control import mjcf

# Geoms of these groups and above are not shown, as in MuJoCo: they are those that collide.
_FIRST_HIDDEN_GROUP = 3

# Of the light from all sides, beside that of lamps; chosen so that the kitchen's white counter is not blown out.
_BRIGHTNESS = 0.4

# Fields of a model on which the shapes and colours depend that a scene shows.
_APPEARANCE = (
    *("body_pos", "body_quat", "geom_pos", "geom_quat", "geom_size", "geom_rgba", "geom_matid", "geom_dataid"),
    *("mat_rgba", "mat_texid", "mat_texrepeat", "mesh_vert", "site_pos", "site_rgba", "tex_data"),
)


class WebScene:
    """The scene of a model in a server, seen through one of the model's cameras at first."""

    def __init__(self, server: "viser.ViserServer", physics: "mjcf.Physics", camera: int) -> None:
        """Adds the scene of the present state to a server, seen through the camera of an id."""
        # mjviser changes the model's colours of contacts, and shows no geom that is fully transparent.
        self._model = copy.copy(physics.model.ptr)
        self._appearance = {name: getattr(self._model, name).copy() for name in _APPEARANCE}
        self._model.geom_rgba[self._model.geom_group >= _FIRST_HIDDEN_GROUP, 3] = 0.0
        set_camera(server, physics, camera)
        server.scene.configure_default_lights(cast_shadow=False)
        self._scene = _scene_class()(server, self._model, num_envs=1)
        self._scene.camera_tracking_enabled = False
        server.scene.configure_environment_map(environment_intensity=_BRIGHTNESS)

    def update(self, physics: "mjcf.Physics") -> None:
        """Moves all objects to where they are now."""
        self._scene.update_from_mjdata(physics.data.ptr)

    def shows(self, physics: "mjcf.Physics") -> bool:
        """Returns whether a model's shapes and colours are those of this scene."""
        model = physics.model.ptr
        return all(np.array_equal(value, getattr(model, name)) for name, value in self._appearance.items())


def set_camera(server: "viser.ViserServer", physics: "mjcf.Physics", camera: int) -> None:
    """Lets browsers look through one of the model's cameras at first; they turn around what it looks at."""
    data = physics.data.ptr
    position, axes = data.cam_xpos[camera], data.cam_xmat[camera].reshape(3, 3)
    direction = -axes[:, 2]
    view = server.initial_camera
    view.position = _triple(position)
    view.look_at = _triple(position + direction * _distance(physics.model.ptr, data, position, direction))
    view.fov = math.radians(physics.model.cam_fovy[camera])


def _distance(
    model: "mujoco.MjModel", data: "mujoco.MjData", position: NDArray[np.float64], direction: NDArray[np.float64]
) -> float:
    """Returns the distance of the first geom in a direction [m]; that of the model's centre where there is none."""
    import mujoco

    distance = mujoco.mj_ray(model, data, position, direction, None, 1, -1, np.zeros(1, np.int32))
    return distance if distance > 0.0 else float(np.linalg.norm(model.stat.center - position))


def _triple(vector: NDArray[np.float64]) -> tuple[float, float, float]:
    x, y, z = vector.tolist()
    return x, y, z


@functools.cache
def _scene_class() -> Any:
    """Returns mjviser's class of scenes, without the convex hulls, which take much of a page and are never shown."""
    import mjviser

    class Scene(mjviser.ViserMujocoScene):
        def _compute_hull_body_meshes(self) -> None:
            pass

    return Scene


class SceneRecorder(contextlib.ExitStack):
    """Records episodes, also of models that change from episode to episode; a context manager."""

    def __init__(self) -> None:
        super().__init__()
        self._scene: WebScene | None = None
        self._server: Any = None
        self._recording: Any = None

    def start(self, physics: "mjcf.Physics", camera: int) -> None:
        """Begins an episode with its first frame, seen through the camera of an id at first."""
        if self._scene is None or not self._scene.shows(physics):
            self.close()
            self._server = self.enter_context(silent_server())
            self._scene = WebScene(self._server, physics, camera)
        self._scene.update(physics)
        self._recording = self._server.get_scene_serializer()

    def add_frame(self, physics: "mjcf.Physics", seconds: float) -> None:
        """Adds a frame, a number of seconds after the one before."""
        assert self._scene
        self._recording.insert_sleep(seconds)
        self._scene.update(physics)

    def finish(self, seconds: float) -> bytes:
        """Ends the episode; returns its recording, in which the last frame is shown for a number of seconds."""
        self._recording.insert_sleep(seconds)
        return self._recording.serialize()
