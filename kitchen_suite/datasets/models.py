"""Models of episodes as MJCF that compiles anywhere, without files beside it."""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import contextlib
import dataclasses
from collections.abc import Callable, Iterator, Mapping
from xml.etree import ElementTree

import mujoco
import numpy as np
from numpy.typing import NDArray

from kitchen_suite.environment.mjcf_values import write_values
from kitchen_suite.episodes.episode import Episode
from kitchen_suite.episodes.spec import EpisodeSpec
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.gymnasium_env.observations import OF_PICTURES

# Bytes before the faces of a binary STL file, and a face.
_STL_HEADER = 84
_STL_FACE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])

# The file of a texture, or of the sides of a cube.
_TEXTURE_FILES = {"file", *(f"file{side}" for side in ("right", "left", "up", "down", "front", "back"))}


@contextlib.contextmanager
def model_writer(spec: EpisodeSpec) -> Iterator[Callable[[Episode], str]]:
    """Context with a function that returns the model of an episode at its start, for physics: without visual geoms."""
    kept = {name: value for name, value in spec.task_kwargs.items() if name not in {*OF_PICTURES, "visuals"}}
    headless = dataclasses.replace(spec, task_kwargs=kept)
    with (
        contextlib.closing(headless.make_environment(visuals=False)) as environment,
        contextlib.closing(headless.make_environment(visuals=False)) as written,
    ):
        inner = suite_env(environment).environment
        # Of an environment that plays no episodes, since values of the episodes are written to it.
        root = suite_env(written).composer_task.root_entity.mjcf_model

        def write(episode: Episode) -> str:
            environment.reset(seed=episode.seed)
            assets = root.get_assets()
            write_values(root, mujoco.MjModel.from_xml_string(root.to_xml_string(), assets), inner.physics.model.ptr)
            return without_files(root.to_xml_string(), assets)

        yield write


def without_files(mjcf: str, assets: Mapping[str, bytes]) -> str:
    """Returns MJCF with the vertices of its meshes in place of their files, and without textures from files."""
    tree = ElementTree.fromstring(mjcf)
    for asset in tree.iter("asset"):
        for mesh in asset.findall("mesh"):
            if name := mesh.attrib.pop("file", None):
                vertices, faces = _read_mesh(name, assets[name])
                mesh.set("vertex", " ".join(map(str, vertices.ravel())))
                mesh.set("face", " ".join(map(str, faces.ravel())))
        textures = [texture for texture in asset.findall("texture") if _TEXTURE_FILES.intersection(texture.keys())]
        names = {texture.get("name") for texture in textures}
        for texture in textures:
            asset.remove(texture)
        for material in asset.findall("material"):
            if material.get("texture") in names:
                del material.attrib["texture"]
            for layer in material.findall("layer"):
                if layer.get("texture") in names:
                    material.remove(layer)
    return ElementTree.tostring(tree, encoding="unicode")


def _read_mesh(name: str, contents: bytes) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Returns the vertices `(n, 3)` and the faces `(m, 3)` in a file of a mesh."""
    if name.endswith(".stl"):
        corners = np.frombuffer(contents[_STL_HEADER:], _STL_FACE)["corners"].reshape(-1, 3)
        vertices, first, inverse = np.unique(corners, axis=0, return_index=True, return_inverse=True)
        # In MuJoCo's order, so that the mesh is the same to the bit.
        order = np.argsort(first)
        return vertices[order], np.argsort(order)[inverse].reshape(-1, 3)
    # Other formats are left to MuJoCo, which moves a mesh to its centre.
    scene = (
        f'<mujoco><asset><mesh name="mesh" file="{name}"/></asset>'
        '<worldbody><geom type="mesh" mesh="mesh"/></worldbody></mujoco>'
    )
    model, rotation = mujoco.MjModel.from_xml_string(scene, {name: contents}), np.empty(9)
    mujoco.mju_quat2Mat(rotation, model.mesh_quat[0])
    vertices = model.mesh_vert @ rotation.reshape(3, 3).T + model.mesh_pos[0]
    return vertices.astype(np.float32), model.mesh_face.astype(np.int64)
