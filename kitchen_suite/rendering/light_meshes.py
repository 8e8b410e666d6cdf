"""Lighter versions of large STL meshes, made once and kept in the user's cache folder; needs the extra `pixels`.

The folder is `kitchen-suite/light-meshes` below `$XDG_CACHE_HOME`, by default `~/.cache`. It can be removed at any
time.
"""

import contextlib
import hashlib
import importlib.metadata
import io
import os
from pathlib import Path

import numpy as np

from kitchen_suite import files

# Number of faces of a light mesh. Frames with 800 and with 1,400 faces for each link of the robot take the same time.
MAX_FACES = 1_400

# Of fast-simplification, from 0 to 10: with 3, the bounding boxes of the robot's meshes change by 1 mm at most; with
# its default of 7 by 3 mm, and curved surfaces get visible edges.
_AGGRESSION = 3

_PACKAGES = ("fast-simplification", "trimesh")

# A binary STL file has a header with the number of faces in its last four bytes, and then 50 bytes for each face.
_HEADER, _FACE = 84, 50


def missing_packages() -> list[str]:
    """Returns the packages of the extra `pixels` that are not installed."""
    return [name for name in _PACKAGES if not _version(name)]


def is_large(stl: bytes) -> bool:
    """Returns whether the contents of a file are those of a binary STL file with more faces than a light mesh has."""
    return _count_faces(stl) > MAX_FACES


def light_stl(stl: bytes) -> bytes:
    """Returns a binary STL file of about `MAX_FACES` faces with the shape of a larger one.

    It is read from the cache folder. If there is none, or a damaged one, it is made, and written there if possible.

    Args:
      stl: contents of the larger file.

    Raises:
      ImportError: a package of the extra `pixels` is not installed.
    """
    path = _cache_path(stl)
    kept = path and _read(path)
    if kept:
        return kept
    made = _decimate(stl)
    if path:
        _write(path, made)
    return made


def _decimate(stl: bytes) -> bytes:
    import trimesh  # Only installed with the extra.

    mesh = trimesh.load_mesh(io.BytesIO(stl), file_type="stl")
    light = mesh.simplify_quadric_decimation(face_count=MAX_FACES, aggression=_AGGRESSION)
    contents: bytes = light.export(file_type="stl")
    return contents


def _cache_path(stl: bytes) -> Path | None:
    """Returns where the light version of a mesh is kept, by its contents and all that the result depends on."""
    folder = os.environ.get("XDG_CACHE_HOME", "")
    try:
        root = Path(folder) if os.path.isabs(folder) else Path.home() / ".cache"
    except RuntimeError:  # The user has no home.
        return None
    settings = (MAX_FACES, _AGGRESSION, *((name, _version(name)) for name in _PACKAGES))
    digest = hashlib.sha256(repr(settings).encode() + stl).hexdigest()
    return root / "kitchen-suite" / "light-meshes" / f"{digest}.npz"


def _read(path: Path) -> bytes | None:
    """Returns the contents of a light STL file; None if there is none, or what is there is damaged."""
    try:
        arrays, _ = files.load_arrays(path, "a light mesh")
    except OSError:
        return None
    stl = arrays.get("stl", np.empty(0)).tobytes()
    return stl if 0 < _count_faces(stl) <= MAX_FACES else None


def _write(path: Path, stl: bytes) -> None:
    """Writes a light STL file whole; does nothing where the folder cannot be written to."""
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        files.remove_stale_partials(path.parent)
        files.save_arrays(path, {"stl": np.frombuffer(stl, np.uint8)}, {"faces": _count_faces(stl)})


def _count_faces(stl: bytes) -> int:
    """Returns the number of faces in the contents of a binary STL file; 0 for those of another file."""
    faces = int.from_bytes(stl[_HEADER - 4 : _HEADER], "little")
    return faces if len(stl) == _HEADER + _FACE * faces else 0


def _version(package: str) -> str | None:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None
