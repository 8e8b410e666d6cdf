"""Cameras of a model, and the image sizes that it can render."""

from typing import TYPE_CHECKING

from kitchen_suite import checks

if TYPE_CHECKING:
    from dm_control import mjcf


def camera_names(physics: "mjcf.Physics") -> list[str]:
    """Returns the names of all cameras, in order of their ids."""
    return [physics.model.id2name(camera_id, "camera") for camera_id in range(physics.model.ncam)]


def find_camera(physics: "mjcf.Physics", camera: str) -> int:
    """Returns the id of a camera.

    Args:
      physics: of the model that has the camera.
      camera: name, or id in decimal digits.
    """
    names = camera_names(physics)
    if not camera.isdecimal():
        return names.index(checks.choice(camera, names, "camera"))
    if int(camera) >= len(names):
        numbers = ", ".join(f"{number} ({name})" for number, name in enumerate(names))
        raise ValueError(f"camera {camera} does not exist; choose from {numbers}")
    return int(camera)


def check_size(physics: "mjcf.Physics", width: int, height: int) -> None:
    """Raises a ValueError unless the model's offscreen buffer holds an image of `width` x `height` pixels."""
    buffer = physics.model.vis.global_
    if width > buffer.offwidth or height > buffer.offheight:
        raise ValueError(
            f"a video of {width} x {height} pixels is too large: the model's offscreen buffer has "
            f"{buffer.offwidth} x {buffer.offheight}"
        )
