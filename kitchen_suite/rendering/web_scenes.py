"""Scenes of models in a viser server, as the live viewer and recorded pages show them; needs the extra `web`."""

import contextlib
import copy
import functools
import io
import math
import unittest.mock
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.rendering.viser_servers import silent_server

if TYPE_CHECKING:
    import mujoco
    import viser
    from dm_control import mjcf

_FIRST_HIDDEN_GROUP = 3  # Geoms of these groups and above are not shown, as in MuJoCo: they are those that collide.

# Of the light; chosen so that the kitchen's white counter is not blown out.
_BRIGHTNESS = 2.2
# Direction that most of it comes from, and colour of the light from the opposite side.
_LIGHT, _SHADE = (-0.5, -0.8, 1.0), (90, 95, 105)

_SMOOTH = math.radians(25.0)  # Greatest angle [rad] between two triangles of a surface that looks smooth.

# Greatest height and width of a texture [pixels], which a page holds; and the least length of a surface that has one
# [m]. Smaller ones have the texture's mean colour.
_TEXTURE_SIZE, _LEAST_LENGTH = 256, 0.5

_CAPSULE = (8, 20)  # Faces along a capsule, without its middle, and around it.
_FLOOR = 5.0  # Half the length of a floor without edges [m].

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
        with _light_shapes():
            _add_fixed_shapes(server, self._model, physics.data.ptr)
            self._scene = _scene_class()(server, self._model, num_envs=1)
        self._scene.camera_tracking_enabled = False
        # After mjviser's own lights.
        _add_lights(server)

    def update(self, physics: "mjcf.Physics") -> None:
        """Moves all objects to where they are now."""
        self._scene.update_from_mjdata(physics.data.ptr)

    def shows(self, physics: "mjcf.Physics") -> bool:
        """Returns whether a model's shapes and colours are those of this scene."""
        model = physics.model.ptr
        return all(np.array_equal(value, getattr(model, name)) for name, value in self._appearance.items())


def set_camera(server: "viser.ViserServer", physics: "mjcf.Physics", camera: int) -> None:
    """Lets browsers look through one of the model's cameras at first; they turn around what it looks at."""
    import mujoco

    model, data, view = physics.model.ptr, physics.data.ptr, server.initial_camera
    position, direction = data.cam_xpos[camera], -data.cam_xmat[camera].reshape(3, 3)[:, 2]
    # Of the first geom in this direction; of the model's centre where there is none [m].
    distance = mujoco.mj_ray(model, data, position, direction, None, 1, -1, np.zeros(1, np.int32))
    if distance <= 0.0:
        distance = float(np.linalg.norm(model.stat.center - position))
    view.position, view.look_at = tuple(position.tolist()), tuple((position + direction * distance).tolist())
    view.fov = math.radians(model.cam_fovy[camera])


@functools.cache
def _scene_class() -> Any:
    """Returns mjviser's class of scenes, without the convex hulls, which take much of a page and are never shown."""
    import mjviser

    class Scene(mjviser.ViserMujocoScene):
        def _compute_hull_body_meshes(self) -> None:
            pass

    return Scene


def _add_lights(server: "viser.ViserServer") -> None:
    """Adds one light in place of viser's, which are slow to draw without a graphics card."""
    scene = server.scene
    scene.configure_default_lights(enabled=False, cast_shadow=False)
    scene.configure_environment_map(None)
    # Lamps of viser's take the time, even without shadows.
    scene.add_light_hemisphere("/light", ground_color=_SHADE, intensity=_BRIGHTNESS, position=_LIGHT)


@contextlib.contextmanager
def _light_shapes() -> Iterator[None]:
    """Context in which mjviser makes matte shapes, and capsules of few faces.

    Otherwise shapes are of bare metal, which reflects its surroundings, and a capsule has 4,096 faces. mjviser has no
    arguments for it, and looks up the functions that make shapes when it calls them.
    """
    import trimesh
    from mjviser import scene

    merge, capsule = scene.merge_geoms, trimesh.creation.capsule

    with (
        unittest.mock.patch.object(scene, "merge_geoms", lambda *arguments: _with_matte_colours(merge(*arguments))),
        unittest.mock.patch.object(trimesh.creation, "capsule", functools.partial(capsule, count=_CAPSULE)),
    ):
        yield


def _with_matte_colours(mesh: Any) -> Any:
    """Returns a mesh of trimesh; if it has a colour for each vertex, of a matte material."""
    import trimesh

    if isinstance(mesh.visual, trimesh.visual.ColorVisuals):
        colours = mesh.visual.vertex_colors
        material = trimesh.visual.material.PBRMaterial(
            metallicFactor=0.0, roughnessFactor=1.0, alphaMode="BLEND" if colours[:, 3].min() < 255 else "OPAQUE"
        )
        mesh.visual = trimesh.visual.TextureVisuals(material=material)
        mesh.visual.vertex_attributes["color"] = colours
    return mesh


def _textures(model: "mujoco.MjModel") -> dict[int, NDArray[np.uint8]]:
    """Returns the texture `(h, w, 3)` of each material that has one, of a cube that of its first face."""
    found = {}
    for material, roles in enumerate(model.mat_texid):
        if (texture := int(roles.max())) >= 0:
            height, width, channels = (
                int(field[texture]) for field in (model.tex_height, model.tex_width, model.tex_nchannel)
            )
            start = model.tex_adr[texture]
            rows = model.tex_data[start : start + height * width * channels].reshape(height, width, channels)
            found[material] = rows[:width, :, :3]
    return found


def _add_fixed_shapes(server: "viser.ViserServer", model: "mujoco.MjModel", data: "mujoco.MjData") -> None:
    """Adds all that never moves in the light, and hides it in the model, whose materials have plain colours then."""
    from mjviser.conversions import is_fixed_body

    bodies = [body for body in range(model.nbody) if is_fixed_body(model, body)]
    fixed = np.flatnonzero(np.isin(model.geom_bodyid, bodies) & (model.geom_rgba[:, 3] > 0.0))
    _add_surfaces(server, model, data, fixed)
    # Materials get the mean colour of their textures, in place of these, which mjviser shows on few shapes.
    for material, texture in _textures(model).items():
        model.mat_rgba[material, :3] *= texture.mean(axis=(0, 1)) / 255
        model.mat_texid[material] = -1
    _add_plain_shapes(server, model, data, fixed[model.geom_rgba[fixed, 3] > 0.0])
    model.geom_rgba[fixed, 3] = 0.0


def _add_surfaces(
    server: "viser.ViserServer", model: "mujoco.MjModel", data: "mujoco.MjData", geoms: NDArray[np.int64]
) -> None:
    """Adds those of some geoms that are large and textured, such as floor and worktop, and hides them in the model."""
    import mujoco

    textures = _textures(model)
    for geom in geoms.tolist():
        material, lengths = model.geom_matid[geom], 2 * model.geom_size[geom]
        is_floor = model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE
        if material not in textures or not (is_floor or lengths.max() >= _LEAST_LENGTH):
            continue
        mesh = _floor_mesh(model, geom) if is_floor else _solid_mesh(model, geom)
        if mesh is None:
            continue
        vertices, texture_coordinates = mesh
        vertices = vertices @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
        textured = _textured(vertices, texture_coordinates, textures[material], model.mat_rgba[material])
        _add_in_light(server, f"/surfaces/{geom}", textured)
        model.geom_rgba[geom, 3] = 0.0
        if is_floor:
            # mjviser shows a grid in place of any plane.
            model.geom_type[geom] = mujoco.mjtGeom.mjGEOM_BOX


def _add_plain_shapes(
    server: "viser.ViserServer", model: "mujoco.MjModel", data: "mujoco.MjData", geoms: NDArray[np.int64]
) -> None:
    """Adds some geoms without textures but planes, and moves them in the model to their poses in the world."""
    import mujoco
    from mjviser.conversions import merge_geoms

    geoms = geoms[model.geom_type[geoms] != mujoco.mjtGeom.mjGEOM_PLANE]
    for geom in geoms.tolist():
        model.geom_pos[geom] = data.geom_xpos[geom]
        mujoco.mju_mat2Quat(model.geom_quat[geom], data.geom_xmat[geom])
    if not len(geoms):
        return
    mesh = _with_edges(merge_geoms(model, geoms.tolist()))
    is_opaque = mesh.visual.face_colors[:, 3] == 255
    for name, faces in (("opaque", is_opaque), ("transparent", ~is_opaque)):
        if faces.any():
            _add_in_light(server, f"/shapes/{name}", _with_matte_colours(mesh.submesh([faces], append=True)))


def _with_edges(mesh: Any) -> Any:
    """Returns a mesh of trimesh, with colours of vertices, whose smooth parts have no vertices in common."""
    import trimesh

    is_smooth = mesh.face_adjacency_angles < _SMOOTH
    parts = trimesh.graph.connected_component_labels(mesh.face_adjacency[is_smooth], node_count=len(mesh.faces))
    corners = mesh.faces + len(mesh.vertices) * parts[:, np.newaxis]
    _, first, faces = np.unique(corners, return_index=True, return_inverse=True)
    vertices = mesh.faces.ravel()[first]
    colours = mesh.visual.vertex_colors[vertices]
    return trimesh.Trimesh(mesh.vertices[vertices], faces.reshape(-1, 3), vertex_colors=colours, process=False)


def _add_in_light(server: "viser.ViserServer", name: str, mesh: Any) -> None:
    """Adds a mesh of trimesh that never moves, with the colours that it has in the light of `_add_lights`.

    Without a graphics card, browsers take long to compute the light for each pixel.
    """
    shade = (np.array(_SHADE) / 255 + 0.055) / 1.055
    shade **= 2.4  # As three.js decodes colours.
    lit = (1.0 + mesh.vertex_normals @ np.array(_LIGHT) / np.linalg.norm(_LIGHT)) / 2.0
    light = _BRIGHTNESS / math.pi * (shade + (1.0 - shade) * lit[:, np.newaxis])
    colours = mesh.visual.vertex_attributes["color"]
    mesh.visual.vertex_attributes["color"] = np.rint(colours * np.pad(light, ((0, 0), (0, 1)), constant_values=1.0))
    glb = mesh.export(file_type="glb", include_normals=False, tree_postprocessor=_make_unlit)
    server.scene.add_glb(name, glb, cast_shadow=False, receive_shadow=False)


def _make_unlit(tree: dict[str, Any]) -> None:
    """Lets the materials of a glTF file have their own colours, in any light."""
    tree["extensionsUsed"] = ["KHR_materials_unlit"]
    for material in tree["materials"]:
        material["extensions"] = {"KHR_materials_unlit": {}}


def _floor_mesh(model: "mujoco.MjModel", geom: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns vertices `(6, 3)` [m] of the two triangles of a plane, and their texture coordinates `(6, 2)`."""
    half = np.where(model.geom_size[geom, :2] > 0.0, model.geom_size[geom, :2], _FLOOR)
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, -1), (1, 1), (-1, 1)]) * half
    material = model.geom_matid[geom]
    scale = model.mat_texrepeat[material] / (1.0 if model.mat_texuniform[material] else 2 * half)
    return np.pad(corners, ((0, 0), (0, 1))), corners * scale


def _solid_mesh(model: "mujoco.MjModel", geom: int) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Returns vertices `(3 n, 3)` [m] of the triangles of a box or mesh, and their texture coordinates `(3 n, 2)`.

    The texture covers each side once, as that of a cube does in MuJoCo. None for other shapes.
    """
    import mujoco
    import trimesh

    half = model.geom_size[geom]
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_BOX:
        triangles = trimesh.creation.box(extents=2 * half).triangles
    elif model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = model.mesh(model.geom_dataid[geom])
        vertices = model.mesh_vert[mesh.vertadr[0] : mesh.vertadr[0] + mesh.vertnum[0]]
        triangles = vertices[model.mesh_face[mesh.faceadr[0] : mesh.faceadr[0] + mesh.facenum[0]]].astype(np.float64)
    else:
        return None
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    # The two axes along the side that a triangle is most nearly parallel to.
    axes = np.argsort(np.abs(normals), axis=1)[:, :2]
    axes.sort(axis=1)
    along = np.take_along_axis(triangles / half, axes[:, np.newaxis], axis=2)
    return triangles.reshape(-1, 3), (along.reshape(-1, 2) + 1) / 2


def _textured(
    vertices: NDArray[np.float64],
    texture_coordinates: NDArray[np.float64],
    texture: NDArray[np.uint8],
    rgba: NDArray[np.float32],
) -> Any:
    """Returns a mesh of trimesh, of triangles `(3 n, 3)` with texture coordinates `(3 n, 2)`."""
    import trimesh
    from PIL import Image

    image = Image.fromarray(texture)
    image.thumbnail((_TEXTURE_SIZE, _TEXTURE_SIZE))
    # A tenth of the bytes of PNG: trimesh keeps the format that an image was read from.
    buffer = io.BytesIO()
    image.save(buffer, "JPEG", quality=85)
    image = Image.open(buffer)
    material = trimesh.visual.material.PBRMaterial(
        baseColorFactor=rgba, baseColorTexture=image, metallicFactor=0.0, roughnessFactor=1.0
    )
    visual = trimesh.visual.TextureVisuals(uv=texture_coordinates, material=material)
    visual.vertex_attributes["color"] = np.full((len(vertices), 4), 255, np.uint8)
    return trimesh.Trimesh(vertices, np.arange(len(vertices)).reshape(-1, 3), visual=visual, process=False)


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
