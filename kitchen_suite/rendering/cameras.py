"""Cameras of a model with their intrinsics and extrinsics, and the image sizes that it can render."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kitchen_suite import checks

if TYPE_CHECKING:
    from dm_control import mjcf


def camera_names(physics: "mjcf.Physics") -> list[str]:
    """Returns the names of all cameras, in order of their ids."""
    return [physics.model.id2name(camera_id, "camera") for camera_id in range(physics.model.ncam)]


def find_camera(physics: "mjcf.Physics", camera: str) -> int:
    """Returns the id of a model's camera, which is given by its name, or its id in decimal digits."""
    names = camera_names(physics)
    if not camera.isdecimal():
        return names.index(checks.choice(camera, names, "camera"))
    if int(camera) >= len(names):
        numbers = ", ".join(f"{number} ({name})" for number, name in enumerate(names))
        raise ValueError(f"camera {camera} does not exist; choose from {numbers}")
    return int(camera)


class CameraParameters(NamedTuple):
    """Intrinsics and extrinsics of a camera, with OpenCV's axes: x to the right, y down, z forward.

    Attributes:
      intrinsics: `(..., 3, 3)` [pixels]; image coordinates are column and row, and integers are centres of pixels.
      world_from_camera: `(..., 4, 4)`, pose of the camera in the world [m], which maps points in the camera's frame to
        points in the world.
    """

    intrinsics: NDArray[np.float64]
    world_from_camera: NDArray[np.float64]


def camera_parameters(physics: "mjcf.Physics", camera: str, width: int, height: int) -> CameraParameters:
    """Returns the present parameters of a camera, see `find_camera`, for images of `width` x `height` pixels."""
    number = find_camera(physics, camera)
    size = np.array([checks.integer(width, "width", minimum=1), checks.integer(height, "height", minimum=1)])
    # The angle of view of a camera is that of the height, and pixels are square.
    focal_length = size[1] / 2 / np.tan(np.deg2rad(physics.model.cam_fovy[number]) / 2)
    intrinsics, pose = np.diag([focal_length, focal_length, 1.0]), np.eye(4)
    intrinsics[:2, 2] = (size - 1) / 2
    # MuJoCo's cameras have y up and z backward.
    pose[:3, :3] = physics.data.cam_xmat[number].reshape(3, 3) * (1, -1, -1)
    pose[:3, 3] = physics.data.cam_xpos[number]
    return CameraParameters(intrinsics, pose)


def check_size(physics: "mjcf.Physics", width: int, height: int) -> None:
    """Raises a ValueError unless the model's offscreen buffer holds an image of `width` x `height` pixels."""
    buffer = physics.model.vis.global_
    if width > buffer.offwidth or height > buffer.offheight:
        raise ValueError(
            f"a video of {width} x {height} pixels is too large: the model's offscreen buffer has "
            f"{buffer.offwidth} x {buffer.offheight}"
        )
