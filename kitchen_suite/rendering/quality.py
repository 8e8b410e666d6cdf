"""Render quality, set in the model, so that every renderer obeys it."""

from typing import TYPE_CHECKING

from kitchen_suite import checks

if TYPE_CHECKING:
    from dm_control import mjcf

RENDER_QUALITIES = ("high", "fast")


def set_render_quality(root: "mjcf.RootElement", quality: str) -> None:
    """Sets what a model's images show beside its geoms; the physics stays the same to the bit.

    Args:
      root: of the model, with all that is attached to it.
      quality: `high` leaves the model as it is. `fast` turns off shadows, reflections, the sky with its haze, and
        multisampling, which take most of the time where there is no graphics card.

    Raises:
      TypeError: the quality is no string.
      ValueError: the quality is unknown.
    """
    if checks.choice(quality, RENDER_QUALITIES, "render_quality") == "high":
        return
    # A shadow map of size 0 is none.
    root.visual.quality.shadowsize = 0
    root.visual.quality.offsamples = 0
    for material in root.find_all("material"):
        material.reflectance = 0
    for texture in root.find_all("texture"):
        if texture.type == "skybox":
            texture.remove()
