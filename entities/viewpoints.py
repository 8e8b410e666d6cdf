"""Parameters of lights and cameras, which only images depend on.

Offsets, rotations and factors are relative to the built scene: they are written to a model that has its built values.
"""

from collections.abc import Callable

import mujoco
import numpy as np
from dm_control import mjcf
from numpy.typing import ArrayLike, NDArray

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
    types = (("offset", "m", CAMERA_OFFSET), ("rotation", "rad", CAMERA_ROTATION), ("fovy", "deg", FIELD_OF_VIEW))
    return tuple(
        Parameter(name=f"{camera_prefix(camera.full_identifier)}{name}", unit=unit, type=each, elements=(camera,))
        for camera in root.find_all("camera")
        for name, unit, each in types
    )


def camera_prefix(camera: str) -> str:
    """Returns the beginning of the names of the parameters of a camera with a given full name."""
    return f"{camera}_camera_" if "/" in camera else f"camera/{camera}_"


def _relative(
    *fields: str,
    change: Callable[[NDArray, NDArray[np.float64]], NDArray],
    default: ArrayLike = 0.0,
    non_negative: bool = False,
) -> ParameterType:
    """Returns a kind of parameter by which lights or cameras differ from the built scene.

    Args:
      *fields: of MuJoCo's model.
      change: returns the values of the elements in a field, given the built ones and the parameter's value.
      default: value that changes nothing.
      non_negative: whether negative values are refused.
    """

    def write(physics: mjcf.Physics, elements: Elements, value: NDArray[np.float64]) -> None:
        if not elements:
            return
        ids, model = np.atleast_1d(physics.bind(elements).element_id), physics.model.ptr
        for field in fields:
            values = getattr(model, field)
            values[ids] = change(values[ids], value)

    return ParameterType(
        read=lambda physics, elements: default,
        write=write,
        model_fields=fields,
        shape=np.shape(default),
        non_negative=non_negative,
        visual=True,
    )


def _turned(directions: NDArray[np.float64], rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    if rotation.any():
        for direction in directions:
            mujoco.mju_rotVecQuat(direction, direction.copy(), _quaternion(rotation))
    return directions


def _turned_frames(quaternions: NDArray[np.float64], rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    for quaternion in quaternions:
        mujoco.mju_mulQuat(quaternion, quaternion.copy(), _quaternion(rotation))
    return quaternions


def _quaternion(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the quaternion of a rotation vector [rad]."""
    angle = np.linalg.norm(rotation)
    quaternion = np.empty(4)
    mujoco.mju_axisAngle2Quat(quaternion, rotation / (angle or 1.0), angle)
    return quaternion


def _write_field_of_view(physics: mjcf.Physics, cameras: Elements, value: NDArray[np.float64]) -> None:
    physics.bind(cameras).fovy = value


# Factor of the diffuse and specular colours of lights.
BRIGHTNESS = _relative(
    "light_diffuse", "light_specular", change=lambda colors, factor: colors * factor, default=1.0, non_negative=True
)

# Relative surplus of red, and lack of blue, in the diffuse colours of lights; negative for cold light.
WARMTH = _relative("light_diffuse", change=lambda colors, surplus: colors * np.array([1 + surplus, 1.0, 1 - surplus]))

# Grey light from all sides, added to that of the built scene; 1 lights a white surface fully.
AMBIENT = _relative("light_ambient", change=lambda colors, grey: colors + grey, non_negative=True)

# Rotation vector in the world frame, by which the directions of lights are turned.
LIGHT_ROTATION = _relative("light_dir", change=_turned, default=np.zeros(3))

# Translation from the built position, in the frame of the parent body.
CAMERA_OFFSET = _relative("cam_pos", change=lambda positions, offset: positions + offset, default=np.zeros(3))

# Rotation vector from the built orientation, in the camera's frame: x is right, y up, z backwards.
CAMERA_ROTATION = _relative("cam_quat", change=_turned_frames, default=np.zeros(3))

# Vertical field of view.
FIELD_OF_VIEW = ParameterType(
    read=lambda physics, cameras: physics.bind(cameras[0]).fovy,
    write=_write_field_of_view,
    model_fields=("cam_fovy",),
    non_negative=True,
    visual=True,
)
