"""Cameras of a model, and the image sizes that it can render."""

from dm_control import mjcf

from kitchen_suite import checks


def camera_names(physics: mjcf.Physics) -> list[str]:
    """Returns the names of all cameras, in order of their ids."""
    return [physics.model.id2name(camera_id, "camera") for camera_id in range(physics.model.ncam)]


def find_camera(physics: mjcf.Physics, camera: str) -> int:
    """Returns the id of a camera.

    Args:
      physics: of the model that has the camera.
      camera: name, or id in decimal digits.

    Raises:
      ValueError: the model has no such camera.
    """
    names = camera_names(physics)
    if camera.isdecimal() and int(camera) < len(names):
        return int(camera)
    return names.index(checks.choice(camera, names, "camera"))


def check_size(physics: mjcf.Physics, width: int, height: int) -> None:
    """Checks that the model's offscreen buffer holds an image of `width` x `height` pixels.

    Raises:
      ValueError: the image is too large.
    """
    buffer = physics.model.vis.global_
    if width > buffer.offwidth or height > buffer.offheight:
        raise ValueError(
            f"a video of {width} x {height} pixels is too large: the model's offscreen buffer has "
            f"{buffer.offwidth} x {buffer.offheight}"
        )
