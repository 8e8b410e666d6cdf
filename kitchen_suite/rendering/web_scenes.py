"""Scenes of models in a viser server, as the live viewer and recorded pages show them; needs the extra `web`."""

import copy
import functools
import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import mujoco
    import viser
    from dm_control import mjcf

# Geoms of these groups and above are not shown, as in MuJoCo: they are those that collide.
_FIRST_HIDDEN_GROUP = 3

# Of the light from all sides, beside that of lamps; chosen so that the kitchen's white counter is not blown out.
_BRIGHTNESS = 0.4

# Fields of a model on which the shapes and colours depend that a scene shows.
_LOOKS = (
    *("body_pos", "body_quat", "geom_pos", "geom_quat", "geom_size", "geom_rgba", "geom_matid", "geom_dataid"),
    *("mat_rgba", "mat_texid", "mat_texrepeat", "mesh_vert", "site_pos", "site_rgba", "tex_data"),
)


class WebScene:
    """The scene of a model in a server, seen through one of the model's cameras at first."""

    def __init__(self, server: "viser.ViserServer", physics: "mjcf.Physics", camera: int) -> None:
        """Adds the scene.

        Args:
          server: that shows it.
          physics: in the state that is shown first.
          camera: id of the camera.
        """
        # mjviser changes the model's colours of contacts, and shows no geom that is fully transparent.
        self._model = copy.copy(physics.model.ptr)
        self._looks = {name: getattr(self._model, name).copy() for name in _LOOKS}
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
        return all(np.array_equal(look, getattr(model, name)) for name, look in self._looks.items())


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
