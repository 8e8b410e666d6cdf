"""Parameters of lights and cameras, which only images depend on.

Offsets, rotations and factors are relative to the built scene: they are written to a model that has its built values.
"""

import mujoco
import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities.parameters import Elements, Parameter, ParameterType


def light_parameters(root: mjcf.RootElement) -> tuple[Parameter, ...]:
    """Returns the parameters of a scene's lights.

    Those of the arena share brightness, warmth and direction; the lights of other entities have a brightness each.

    Args:
      root: of the scene's model, with all that is attached to it.
    """
    lights = root.find_all("light")
    room = tuple(light for light in lights if light.root is root)
    others = (light for light in lights if light.root is not root)
    return (
        Parameter(name="light/brightness", unit="1", type=BRIGHTNESS, elements=room),
        Parameter(name="light/warmth", unit="1", type=WARMTH, elements=room),
        Parameter(name="light/ambient", unit="1", type=AMBIENT, elements=room[:1]),
        Parameter(name="light/rotation", unit="rad", type=LIGHT_ROTATION, elements=room),
        *(
            Parameter(name=f"{light.full_identifier}_brightness", unit="1", type=BRIGHTNESS, elements=(light,))
            for light in others
        ),
    )


def camera_parameters(root: mjcf.RootElement) -> tuple[Parameter, ...]:
    """Returns offset, rotation and vertical field of view of all cameras of a scene.

    Their names are such as `camera/left_offset` for a camera `left` of the arena, and `franka/wrist_camera_offset` for
    a camera `wrist` of the robot.

    Args:
      root: of the scene's model, with all that is attached to it.
    """
    return tuple(parameter for camera in root.find_all("camera") for parameter in _of_camera(camera))


def camera_prefix(camera: str) -> str:
    """Returns the beginning of the names of the parameters of a camera with a given full name."""
    return f"{camera}_camera_" if "/" in camera else f"camera/{camera}_"


def _of_camera(camera: mjcf.Element) -> tuple[Parameter, ...]:
    prefix, elements = camera_prefix(camera.full_identifier), (camera,)
    return (
        Parameter(name=f"{prefix}offset", unit="m", type=CAMERA_OFFSET, elements=elements),
        Parameter(name=f"{prefix}rotation", unit="rad", type=CAMERA_ROTATION, elements=elements),
        Parameter(name=f"{prefix}fovy", unit="deg", type=FIELD_OF_VIEW, elements=elements),
    )


def _ids(physics: mjcf.Physics, elements: Elements) -> NDArray[np.int64]:
    return np.atleast_1d(physics.bind(elements).element_id) if elements else np.empty(0, np.int64)


def _write_brightness(physics: mjcf.Physics, lights: Elements, value: NDArray[np.float64]) -> None:
    ids, model = _ids(physics, lights), physics.model.ptr
    model.light_diffuse[ids] *= value
    model.light_specular[ids] *= value


def _write_warmth(physics: mjcf.Physics, lights: Elements, value: NDArray[np.float64]) -> None:
    physics.model.ptr.light_diffuse[_ids(physics, lights)] *= np.array([1 + value, 1.0, 1 - value])


def _write_ambient(physics: mjcf.Physics, lights: Elements, value: NDArray[np.float64]) -> None:
    physics.model.ptr.light_ambient[_ids(physics, lights)] += value


def _write_light_rotation(physics: mjcf.Physics, lights: Elements, value: NDArray[np.float64]) -> None:
    if not value.any():
        return
    turn, directions = _quaternion(value), physics.model.ptr.light_dir
    for light in _ids(physics, lights).tolist():
        mujoco.mju_rotVecQuat(directions[light], directions[light].copy(), turn)


def _write_camera_offset(physics: mjcf.Physics, cameras: Elements, value: NDArray[np.float64]) -> None:
    physics.model.ptr.cam_pos[_ids(physics, cameras)] += value


def _write_camera_rotation(physics: mjcf.Physics, cameras: Elements, value: NDArray[np.float64]) -> None:
    quaternions = physics.model.ptr.cam_quat
    for camera in _ids(physics, cameras).tolist():
        mujoco.mju_mulQuat(quaternions[camera], quaternions[camera].copy(), _quaternion(value))


def _write_field_of_view(physics: mjcf.Physics, cameras: Elements, value: NDArray[np.float64]) -> None:
    physics.bind(cameras).fovy = value


def _quaternion(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the quaternion of a rotation vector [rad]."""
    angle = np.linalg.norm(rotation)
    quaternion = np.empty(4)
    mujoco.mju_axisAngle2Quat(quaternion, rotation / (angle or 1.0), angle)
    return quaternion


# Factor of the diffuse and specular colours of lights.
BRIGHTNESS = ParameterType(
    read=lambda physics, lights: 1.0,
    write=_write_brightness,
    model_fields=("light_diffuse", "light_specular"),
    non_negative=True,
    visual=True,
)

# Relative surplus of red, and lack of blue, in the diffuse colours of lights; negative for cold light.
WARMTH = ParameterType(
    read=lambda physics, lights: 0.0, write=_write_warmth, model_fields=("light_diffuse",), visual=True
)

# Grey light from all sides, added to that of the built scene; 1 lights a white surface fully.
AMBIENT = ParameterType(
    read=lambda physics, lights: 0.0,
    write=_write_ambient,
    model_fields=("light_ambient",),
    non_negative=True,
    visual=True,
)

# Rotation vector in the world frame, by which the directions of lights are turned.
LIGHT_ROTATION = ParameterType(
    read=lambda physics, lights: np.zeros(3),
    write=_write_light_rotation,
    model_fields=("light_dir",),
    shape=(3,),
    visual=True,
)

# Translation from the built position, in the frame of the parent body.
CAMERA_OFFSET = ParameterType(
    read=lambda physics, cameras: np.zeros(3),
    write=_write_camera_offset,
    model_fields=("cam_pos",),
    shape=(3,),
    visual=True,
)

# Rotation vector from the built orientation, in the camera's frame: x is right, y up, z backwards.
CAMERA_ROTATION = ParameterType(
    read=lambda physics, cameras: np.zeros(3),
    write=_write_camera_rotation,
    model_fields=("cam_quat",),
    shape=(3,),
    visual=True,
)

# Vertical field of view.
FIELD_OF_VIEW = ParameterType(
    read=lambda physics, cameras: physics.bind(cameras[0]).fovy,
    write=_write_field_of_view,
    model_fields=("cam_fovy",),
    non_negative=True,
    visual=True,
)
