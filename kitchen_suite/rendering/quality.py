"""Render quality, set in the model, so that it holds for every renderer."""

import contextlib
import hashlib
import io
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from kitchen_suite import checks, files, installation

if TYPE_CHECKING:
    from dm_control import mjcf

# Number of faces of a light mesh. Frames with 800 and with 1,400 faces for each link of the robot take the same time.
MAX_FACES = 1_400

# Of fast-simplification, from 0 to 10: with 3, the bounding boxes of the robot's meshes change by 1 mm at most; with
# its default of 7 by 3 mm, and curved surfaces get visible edges.
_AGGRESSION = 3

PACKAGES = ("fast-simplification", "trimesh")

# A binary STL file has a header with the number of faces in its last four bytes, and then 50 bytes for each face.
_HEADER, _FACE = 84, 50

RENDER_QUALITIES = ("high", "fast")

# Faces around a cylinder, capsule or sphere, faces along it, and squares along each side of a box, of `fast`. With
# MuJoCo's own, 28, 16 and 4, these shapes have most of a scene's faces beside the robot's.
_NUM_SLICES, _NUM_STACKS, _NUM_QUADS = 20, 4, 1


def missing_packages() -> list[str]:
    """Returns the packages of the extra `pixels` that are not installed."""
    return [name for name in PACKAGES if not installation.version_of(name)]


def is_large(stl: bytes) -> bool:
    """Returns whether the contents of a file are those of a binary STL file with more faces than a light mesh has."""
    return _count_faces(stl) > MAX_FACES


def light_stl(stl: bytes) -> bytes:
    """Returns the contents of a binary STL file of about `MAX_FACES` faces with the shape of a larger one.

    It is read from the cache folder. If there is none, or a damaged one, it is made, and written there if possible.
    """
    # By the contents of the mesh and all that the result depends on.
    settings = (MAX_FACES, _AGGRESSION, *((name, installation.version_of(name)) for name in PACKAGES))
    digest, root = hashlib.sha256(repr(settings).encode() + stl).hexdigest(), files.cache_folder()
    path = root and root / "light-meshes" / f"{digest}.npz"
    if path and (kept := _read(path)):
        return kept
    import trimesh  # Only installed with the extra.

    mesh = trimesh.load_mesh(io.BytesIO(stl), file_type="stl")
    light = mesh.simplify_quadric_decimation(face_count=MAX_FACES, aggression=_AGGRESSION)
    made: bytes = light.export(file_type="stl")
    # Whole, or not at all where the folder cannot be written to.
    with contextlib.suppress(OSError):
        if path:
            path.parent.mkdir(parents=True, exist_ok=True)
            files.save_arrays(path, {"stl": np.frombuffer(made, np.uint8)}, {"faces": _count_faces(made)})
    return made


def _read(path: Path) -> bytes | None:
    """Returns the contents of a light STL file; None if there is none, or what is there is damaged."""
    try:
        arrays, _ = files.load_arrays(path, "a light mesh")
    except OSError:
        return None
    stl = arrays.get("stl", np.empty(0)).tobytes()
    return stl if 0 < _count_faces(stl) <= MAX_FACES else None


def _count_faces(stl: bytes) -> int:
    """Returns the number of faces in the contents of a binary STL file; 0 for those of another file."""
    faces = int.from_bytes(stl[_HEADER - 4 : _HEADER], "little")
    return faces if len(stl) == _HEADER + _FACE * faces else 0


def set_render_quality(
    root: "mjcf.RootElement", quality: str, is_visual: "Callable[[mjcf.Element], bool]", *, warn: bool = True
) -> None:
    """Sets how the images of a model and all that is attached to it look; the physics stays the same to the bit.

    The quality `high` leaves the model as it is. `fast` turns off shadows, reflections, the sky with its haze, and
    multisampling, which take most of the time where there is no graphics card. Primitive shapes have fewer faces, and
    so have large meshes of geoms that are only for rendering (`is_visual`) with the extra `pixels`.
    """
    if checks.choice(quality, RENDER_QUALITIES, "render_quality") == "high":
        return
    # A shadow map of size 0 is none.
    root.visual.quality.set_attributes(
        shadowsize=0, offsamples=0, numslices=_NUM_SLICES, numstacks=_NUM_STACKS, numquads=_NUM_QUADS
    )
    for material in root.find_all("material"):
        material.reflectance = 0
    for texture in root.find_all("texture"):
        if texture.type == "skybox":
            texture.remove()
    # Meshes that only visual geoms have; one that some geom has by its name is the same mesh.
    root.resolve_references()
    geoms = root.find_all("geom")
    visual = {geom.mesh for geom in geoms if is_visual(geom)} - {geom.mesh for geom in geoms if not is_visual(geom)}
    meshes = [mesh for mesh in root.find_all("mesh") if mesh in visual and mesh.file is not None]
    if not (large := [mesh for mesh in meshes if is_large(mesh.file.contents)]):
        return
    if missing := missing_packages():
        if warn:
            warnings.warn(
                "render_quality 'fast' is up to three times as fast with light meshes, which need "
                f"{' and '.join(missing)}: {installation.install_command('pixels')}",
                stacklevel=2,
            )
        return
    from dm_control import mjcf

    for mesh in large:
        mesh.file = mjcf.Asset(light_stl(mesh.file.contents), ".stl")
