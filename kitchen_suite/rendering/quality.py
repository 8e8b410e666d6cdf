"""Render quality, set in the model, so that every renderer obeys it."""

import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING

from kitchen_suite import checks
from kitchen_suite.rendering import light_meshes

if TYPE_CHECKING:
    from dm_control import mjcf

RENDER_QUALITIES = ("high", "fast")

# Faces around a cylinder, capsule or sphere, faces along it, and squares along each side of a box, of `fast`. With
# MuJoCo's own, 28, 16 and 4, these shapes have most of a scene's faces beside the robot's.
_NUM_SLICES, _NUM_STACKS, _NUM_QUADS = 20, 4, 1


def set_render_quality(root: "mjcf.RootElement", quality: str, is_visual: "Callable[[mjcf.Element], bool]") -> None:
    """Sets how a model's images look; the physics stays the same to the bit.

    Args:
      root: of the model, with all that is attached to it.
      quality: `high` leaves the model as it is. `fast` turns off shadows, reflections, the sky with its haze, and
        multisampling, which take most of the time where there is no graphics card. Primitive shapes have fewer faces,
        and so have large meshes of visual geoms with the extra `pixels`.
      is_visual: returns whether a geom is only for rendering.

    Raises:
      TypeError: the quality is no string.
      ValueError: the quality is unknown.
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
    _lighten(_large_visual_meshes(root, is_visual))


def _large_visual_meshes(root: "mjcf.RootElement", is_visual: "Callable[[mjcf.Element], bool]") -> "list[mjcf.Element]":
    """Returns the meshes with more faces than a light mesh that only visual geoms have."""
    root.resolve_references()  # A mesh that some geom has by its name is the same mesh.
    geoms = root.find_all("geom")
    of_visual = {geom.mesh for geom in geoms if is_visual(geom)}
    of_others = {geom.mesh for geom in geoms if not is_visual(geom)}
    visual = of_visual - of_others
    meshes = [mesh for mesh in root.find_all("mesh") if mesh in visual and mesh.file is not None]
    return [mesh for mesh in meshes if light_meshes.is_large(mesh.file.contents)]


def _lighten(meshes: "list[mjcf.Element]") -> None:
    """Replaces meshes by light versions, or warns that these need an extra."""
    if not meshes:
        return
    if missing := light_meshes.missing_packages():
        warnings.warn(
            "render_quality 'fast' is up to three times as fast with light meshes, which need "
            f"{' and '.join(missing)}: pip install 'kitchen-suite[pixels]'",
            stacklevel=3,
        )
        return
    from dm_control import mjcf

    for mesh in meshes:
        mesh.file = mjcf.Asset(light_meshes.light_stl(mesh.file.contents), ".stl")
