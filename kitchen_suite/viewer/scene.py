"""Scenes of models in a server of viser, as the live viewer and recorded pages show them; needs the extra `web`."""

# First: it names what to install where the extra is missing.
import kitchen_suite.viewer.servers  # noqa: F401

# isort: split
import copy
import dataclasses
import io
import math
from typing import Any

import mujoco
import numpy as np
import trimesh
import viser
from dm_control import mjcf
from mjviser.conversions import create_primitive_mesh, get_body_name, is_fixed_body, mujoco_mesh_to_trimesh
from numpy.typing import ArrayLike, NDArray
from PIL import Image

_FIRST_HIDDEN_GROUP = 3  # Geoms of these groups and above are not shown, as in MuJoCo: they are those that collide.

_BRIGHTNESS = 2.8  # Of the light; chosen so that images of MuJoCo are as bright.
_LIGHT = (-0.5, -0.8, 1.0)  # Direction that most of it comes from.
_SHADE = (90, 95, 105)  # Colour of the light from the opposite side.

_SMOOTH = math.radians(25.0)  # Greatest angle [rad] between two triangles of a surface that looks smooth.

_TEXTURE_SIZE = 256  # Greatest height and width of a texture [pixels], which a page holds.
_LEAST_LENGTH = 0.5  # Of a surface with a texture [m]; smaller ones have the texture's mean colour.

_CAPSULE = (8, 20)  # Faces along a capsule, without its middle, and around it.
_FLOOR = 5.0  # Half the length of a floor without edges [m].

_GAP = 0.5  # Between scenes next to each other, and between a scene and its label [m].
_STEP_BACK = 1.7  # Factor of a camera's distance with two scenes in view: both are twice as wide, in a wide window.

# Fields of a model on which the shapes and colours depend that a scene shows.
_APPEARANCE = (
    *("body_pos", "body_quat", "geom_pos", "geom_quat", "geom_size", "geom_rgba", "geom_matid", "geom_dataid"),
    *("mat_rgba", "mat_texid", "mat_texrepeat", "mesh_vert", "site_pos", "site_rgba", "tex_data"),
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Place:
    """Where a scene stands in a server.

    Attributes:
      name: begins the names of all that the scene adds, such as `/left`; empty for a scene that is alone there.
      position: `(3,)`, of its origin [m].
      label: a text above it.
      floor: `(2, 2)`, the ranges of x and y that floors are confined to, from the origin [m].
    """

    name: str = ""
    position: NDArray[np.float64] = dataclasses.field(default_factory=lambda: np.zeros(3))
    label: str = ""
    floor: NDArray[np.float64] = dataclasses.field(default_factory=lambda: np.full((2, 2), (-np.inf, np.inf)))


def side_by_side(
    first: mjcf.Physics, second: mjcf.Physics, camera: int, labels: tuple[str, str]
) -> tuple[Place, Place]:
    """Returns the places of two scenes, the first on the left as one of its cameras sees them.

    They stand along the axis of the world that is most nearly the camera's horizontal one. Floors end between them.
    """
    right = first.data.ptr.cam_xmat[camera].reshape(3, 3)[:2, 0]
    axis = int(np.abs(right).argmax())
    (low, high), (other_low, other_high) = _range(first, axis), _range(second, axis)
    places = [Place(name=f"/scene_{number}", label=label) for number, label in enumerate(labels)]
    left_floor, right_floor = (place.floor[axis] for place in places)
    if right[axis] > 0.0:
        places[1].position[axis] = high + _GAP - other_low
        left_floor[1] = high + _GAP / 2
        right_floor[0] = other_low - _GAP / 2
    else:
        places[1].position[axis] = low - _GAP - other_high
        left_floor[0] = low - _GAP / 2
        right_floor[1] = other_high + _GAP / 2
    return places[0], places[1]


def show_both(server: viser.ViserServer, physics: mjcf.Physics, camera: int, places: tuple[Place, Place]) -> None:
    """Lets browsers look at two scenes from the middle at first, from the height of a camera of the first model."""
    set_camera(server, physics, camera)
    view = server.initial_camera
    middle = (places[0].position + places[1].position) / 2.0
    away = np.array(view.position) - view.look_at
    distance = np.linalg.norm(away)
    # At a right angle to the row, so that both are equally near.
    away[np.abs(middle).argmax()] = 0.0
    away *= _STEP_BACK * distance / np.linalg.norm(away)
    view.look_at = tuple((view.look_at + middle).tolist())
    view.position = tuple((view.look_at + away).tolist())


def _range(physics: mjcf.Physics, axis: int) -> tuple[float, float]:
    """Returns the range [m] along an axis of the world of all that is shown of a model, without its floor."""
    model, data = physics.model.ptr, physics.data.ptr
    geoms = _shown(model)
    geoms = geoms[model.geom_type[geoms] != mujoco.mjtGeom.mjGEOM_PLANE]
    rows = data.geom_xmat[geoms].reshape(-1, 3, 3)[:, axis]
    centres = data.geom_xpos[geoms, axis] + (rows * model.geom_aabb[geoms, :3]).sum(axis=1)
    halves = (np.abs(rows) * model.geom_aabb[geoms, 3:]).sum(axis=1)
    return float((centres - halves).min()), float((centres + halves).max())


def _shown(model: mujoco.MjModel) -> NDArray[np.int64]:
    """Returns the geoms of a model that are shown."""
    return np.flatnonzero((model.geom_group < _FIRST_HIDDEN_GROUP) & (model.geom_rgba[:, 3] > 0.0))


class Scene:
    """The scene of a model in a server, seen through one of the model's cameras at first."""

    def __init__(
        self, server: viser.ViserServer, physics: mjcf.Physics, camera: int, place: Place | None = None
    ) -> None:
        """Adds the scene of the current state to a server, at a place, seen through the camera of an id."""
        model, data = physics.model.ptr, physics.data.ptr
        place = place or Place()
        self._server = server
        self._appearance = {name: getattr(model, name).copy() for name in _APPEARANCE}
        set_camera(server, physics, camera)
        _add_light(server)
        geoms = _shown(model)
        if place.name:
            server.scene.add_frame(place.name, show_axes=False, position=tuple(place.position.tolist()))
        if place.label:
            above = (*data.xpos[1:, :2].mean(axis=0), data.geom_xpos[geoms, 2].max() + _GAP)
            server.scene.add_label(f"{place.name}/label", place.label, position=above)
        is_fixed = np.array([is_fixed_body(model, body) for body in range(model.nbody)])
        fixed, moving = geoms[is_fixed[model.geom_bodyid[geoms]]], geoms[~is_fixed[model.geom_bodyid[geoms]]]
        surfaces = _add_surfaces(server, model, data, fixed, place)
        plain = _with_plain_colours(model)
        _add_fixed_shapes(server, plain, data, fixed[~np.isin(fixed, surfaces)], place)
        self._bodies = _add_bodies(server, plain, moving, place)
        self.update(physics)

    def update(self, physics: mjcf.Physics) -> None:
        """Moves all objects to where they are now."""
        data = physics.data.ptr
        with self._server.atomic():
            for body, handle in self._bodies.items():
                handle.position = data.xpos[body]
                handle.wxyz = data.xquat[body]

    def shows(self, physics: mjcf.Physics) -> bool:
        """Returns whether a model's shapes and colours are those of this scene."""
        model = physics.model.ptr
        return all(np.array_equal(value, getattr(model, name)) for name, value in self._appearance.items())


def set_camera(server: viser.ViserServer, physics: mjcf.Physics, camera: int) -> None:
    """Lets browsers look through one of the model's cameras at first; they turn around what it looks at."""
    model, data, view = physics.model.ptr, physics.data.ptr, server.initial_camera
    position, direction = data.cam_xpos[camera], -data.cam_xmat[camera].reshape(3, 3)[:, 2]
    # Of the first geom in this direction; of the model's centre where there is none [m].
    distance = mujoco.mj_ray(model, data, position, direction, None, 1, -1, np.zeros(1, np.int32))
    if distance <= 0.0:
        distance = float(np.linalg.norm(model.stat.center - position))
    view.position, view.look_at = tuple(position.tolist()), tuple((position + direction * distance).tolist())
    view.fov = math.radians(model.cam_fovy[camera])


def _add_light(server: viser.ViserServer) -> None:
    """Adds one light in place of viser's, which are slow to draw without a graphics card."""
    scene = server.scene
    scene.configure_default_lights(enabled=False, cast_shadow=False)
    scene.configure_environment_map(None)
    # Lamps of viser's take the time, even without shadows.
    scene.add_light_hemisphere("/light", ground_color=_SHADE, intensity=_BRIGHTNESS, position=_LIGHT)


def _with_matte_colours(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Returns a mesh of trimesh; if it has a colour for each vertex, of a matte material."""
    if isinstance(mesh.visual, trimesh.visual.ColorVisuals):
        colours = mesh.visual.vertex_colors
        material = trimesh.visual.material.PBRMaterial(
            metallicFactor=0.0, roughnessFactor=1.0, alphaMode="BLEND" if colours[:, 3].min() < 255 else "OPAQUE"
        )
        mesh.visual = trimesh.visual.TextureVisuals(material=material)
        mesh.visual.vertex_attributes["color"] = _linear(colours)
    return mesh


def _linear(colours: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Returns colours of vertices `(n, 4)` as glTF has them, linear in light, from those of MuJoCo, as on a screen."""
    return np.column_stack([np.rint(255 * _decoded(colours[:, :3] / 255)), colours[:, 3]]).astype(np.uint8)


def _decoded(colours: ArrayLike) -> NDArray[np.float64]:
    """Returns light from colours of a screen, both from 0 to 1, as three.js decodes them."""
    return ((np.asarray(colours) + 0.055) / 1.055) ** 2.4


def _textures(model: mujoco.MjModel) -> dict[int, NDArray[np.uint8]]:
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


def _with_plain_colours(model: mujoco.MjModel) -> mujoco.MjModel:
    """Returns a copy of a model whose materials have the mean colours of their textures in place of these."""
    plain = copy.copy(model)
    for material, texture in _textures(model).items():
        plain.mat_rgba[material, :3] *= texture.mean(axis=(0, 1)) / 255
        plain.mat_texid[material] = -1
    return plain


def _add_surfaces(
    server: viser.ViserServer, model: mujoco.MjModel, data: mujoco.MjData, geoms: NDArray[np.int64], place: Place
) -> list[int]:
    """Adds those of some geoms that are large and textured, such as floor and worktop; returns which ones."""
    textures, added = _textures(model), list[int]()
    for geom in geoms.tolist():
        material, lengths = model.geom_matid[geom], 2 * model.geom_size[geom]
        is_floor = model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE
        if material not in textures or not (is_floor or lengths.max() >= _LEAST_LENGTH):
            continue
        mesh = _floor_mesh(model, geom, place.floor) if is_floor else _solid_mesh(model, geom)
        if mesh is None:
            continue
        vertices, texture_coordinates = mesh
        vertices = vertices @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
        textured = _textured(vertices, texture_coordinates, textures[material], model.mat_rgba[material])
        _add_in_light(server, f"{place.name}/surfaces/{geom}", textured)
        added.append(geom)
    return added


def _add_fixed_shapes(
    server: viser.ViserServer, model: mujoco.MjModel, data: mujoco.MjData, geoms: NDArray[np.int64], place: Place
) -> None:
    """Adds some geoms that never move, in plain colours."""
    if not len(geoms):
        return
    shapes = [_placed(_shape(model, geom), data.geom_xpos[geom], data.geom_xmat[geom]) for geom in geoms.tolist()]
    mesh = _with_edges(trimesh.util.concatenate(shapes))
    is_opaque = mesh.visual.face_colors[:, 3] == 255
    for name, faces in (("opaque", is_opaque), ("transparent", ~is_opaque)):
        if faces.any():
            shape = f"{place.name}/shapes/{name}"
            _add_in_light(server, shape, _with_matte_colours(mesh.submesh([faces], append=True)))


def _add_bodies(
    server: viser.ViserServer, model: mujoco.MjModel, geoms: NDArray[np.int64], place: Place
) -> dict[int, Any]:
    """Adds each body that some geoms belong to, in plain colours; returns handles of viser's by number of the body."""
    added = {}
    for body in np.unique(model.geom_bodyid[geoms]).tolist():
        shapes = []
        for geom in geoms[model.geom_bodyid[geoms] == body].tolist():
            rotation = np.empty(9)
            mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
            shapes.append(_placed(_shape(model, geom), model.geom_pos[geom], rotation))
        mesh = _with_matte_colours(trimesh.util.concatenate(shapes))
        name = f"{place.name}/bodies/{get_body_name(model, body)}"
        added[body] = server.scene.add_mesh_trimesh(name, mesh, cast_shadow=False, receive_shadow=False)
    return added


def _shape(model: mujoco.MjModel, geom: int) -> trimesh.Trimesh:
    """Returns the mesh of a geom in its own frame, with a colour for each vertex."""
    kind = model.geom_type[geom]
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = mujoco_mesh_to_trimesh(model, geom)
    elif kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        # mjviser's has 4,096 faces.
        radius, half_length = model.geom_size[geom, :2]
        mesh = trimesh.creation.capsule(radius=radius, height=2 * half_length, count=_CAPSULE)
        material = model.geom_matid[geom]
        colour = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
        colours = np.tile(np.uint8(255 * colour.clip(0.0, 1.0)), (len(mesh.vertices), 1))
        mesh.visual = trimesh.visual.ColorVisuals(mesh, vertex_colors=colours)
    else:
        mesh = create_primitive_mesh(model, geom)
    mesh.merge_vertices()
    return mesh


def _placed(mesh: trimesh.Trimesh, position: NDArray[np.float64], rotation: NDArray[np.float64]) -> trimesh.Trimesh:
    """Moves a mesh to a position `(3,)` [m] and a rotation matrix `(9,)`; returns it."""
    pose = np.eye(4)
    pose[:3, :3] = rotation.reshape(3, 3)
    pose[:3, 3] = position
    return mesh.apply_transform(pose)


def _with_edges(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Returns a mesh of trimesh, with colours of vertices, whose smooth parts have no vertices in common."""
    is_smooth = mesh.face_adjacency_angles < _SMOOTH
    parts = trimesh.graph.connected_component_labels(mesh.face_adjacency[is_smooth], node_count=len(mesh.faces))
    corners = mesh.faces + len(mesh.vertices) * parts[:, np.newaxis]
    _, first, faces = np.unique(corners, return_index=True, return_inverse=True)
    vertices = mesh.faces.ravel()[first]
    colours = mesh.visual.vertex_colors[vertices]
    return trimesh.Trimesh(mesh.vertices[vertices], faces.reshape(-1, 3), vertex_colors=colours, process=False)


def _add_in_light(server: viser.ViserServer, name: str, mesh: trimesh.Trimesh) -> None:
    """Adds a mesh of trimesh that never moves, with the colours that it has in the light of `_add_light`.

    Without a graphics card, browsers take long to compute the light for each pixel.
    """
    shade = _decoded(np.array(_SHADE) / 255)
    lit = (1.0 + mesh.vertex_normals @ np.array(_LIGHT) / np.linalg.norm(_LIGHT)) / 2.0
    light = _BRIGHTNESS / math.pi * (shade + (1.0 - shade) * lit[:, np.newaxis])
    colours = mesh.visual.vertex_attributes["color"]
    lit_colours = np.rint(colours * np.pad(light, ((0, 0), (0, 1)), constant_values=1.0))
    mesh.visual.vertex_attributes["color"] = lit_colours.clip(0, 255)
    glb = mesh.export(file_type="glb", include_normals=False, tree_postprocessor=_make_unlit)
    server.scene.add_glb(name, glb, cast_shadow=False, receive_shadow=False)


def _make_unlit(tree: dict[str, Any]) -> None:
    """Lets the materials of a glTF file have their own colours, in any light."""
    tree["extensionsUsed"] = ["KHR_materials_unlit"]
    for material in tree["materials"]:
        material["extensions"] = {"KHR_materials_unlit": {}}


def _floor_mesh(
    model: mujoco.MjModel, geom: int, confined: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns vertices `(6, 3)` [m] of the two triangles of a plane, and their texture coordinates `(6, 2)`.

    Its x and y are `confined` to ranges `(2, 2)` [m].
    """
    half = np.where(model.geom_size[geom, :2] > 0.0, model.geom_size[geom, :2], _FLOOR)
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, -1), (1, 1), (-1, 1)]) * half
    corners = corners.clip(*(confined.T - model.geom_pos[geom, :2]))
    material = model.geom_matid[geom]
    scale = model.mat_texrepeat[material] / (1.0 if model.mat_texuniform[material] else 2 * half)
    return np.pad(corners, ((0, 0), (0, 1))), corners * scale


def _solid_mesh(model: mujoco.MjModel, geom: int) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Returns vertices `(3 n, 3)` [m] of the triangles of a box or mesh, and their texture coordinates `(3 n, 2)`.

    The texture covers each side once, as that of a cube does in MuJoCo. None for other shapes.
    """
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
) -> trimesh.Trimesh:
    """Returns a mesh of trimesh, of triangles `(3 n, 3)` with texture coordinates `(3 n, 2)`."""
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
