"""Parameters: numbers of a compiled scene that may differ from episode to episode, offered by the entities."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import mujoco
import numpy as np
from dm_control import composer, mjcf
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks
from kitchen_suite.entities.joints import joint_types

Elements = tuple[mjcf.Element, ...]


@dataclasses.dataclass(frozen=True, kw_only=True)
class ParameterType:
    """A kind of parameter: the values that it takes, and how they are read from and written to a compiled scene.

    Attributes:
      read: returns the value that some elements have in a physics.
      write: sets the value of some elements in a physics; derived quantities are not updated.
      model_fields: fields of MuJoCo's model that `write` changes; none if it changes only the state.
      shape: `()` or `(n,)`.
      non_negative: whether negative values are refused.
      visual: whether only images depend on it.
      choices: number of choices, if it is the index of one; else None.
      derived: whether MuJoCo derives other fields of the model from these (`mj_setConst`).
    """

    read: Callable[[mjcf.Physics, Elements], ArrayLike]
    write: Callable[[mjcf.Physics, Elements, NDArray[np.float64]], None]
    model_fields: tuple[str, ...]
    shape: tuple[int, ...] = ()
    non_negative: bool = False
    visual: bool = False
    choices: int | None = None
    derived: bool = False

    def checked(self, value: Any, name: str) -> NDArray[np.float64]:
        """Returns a value as an array; raises a TypeError or ValueError, which begins with `name`, if it is refused."""
        if self.shape:
            array = checks.vector(value, self.shape[0], name)
            if self.non_negative and (array < 0).any():
                raise ValueError(f"{name} must be finite and non-negative, got {checks.shown(value)}")
            return array
        array = checks.array_of(value, name)
        if array.shape:
            raise ValueError(f"{name} must be one number, got {checks.shown(value)}")
        if self.choices is not None and array.item() not in range(self.choices):
            raise ValueError(f"{name} must be an integer from 0 to {self.choices - 1}, got {checks.shown(value)}")
        if self.non_negative:
            return np.array(checks.number(array.item(), name))
        return checks.vector(array[np.newaxis], 1, name)[0]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Parameter:
    """A number, or a vector, of certain elements of a scene that may differ from episode to episode.

    Attributes:
      name: owner first, such as `cabinet/drawer_top_friction`.
      unit: of its values.
      type: kind of the parameter.
      elements: MJCF elements, all of which get the same value.
    """

    name: str
    unit: str
    type: ParameterType
    elements: Elements

    def get(self, physics: mjcf.Physics) -> NDArray[np.float64]:
        """Returns the present value, in the shape of its type."""
        return np.array(self.type.read(physics, self.elements), np.float64)

    def set(self, physics: mjcf.Physics, value: NDArray[np.float64]) -> None:
        """Sets a checked value; what MuJoCo derives from it is not updated."""
        self.type.write(physics, self.elements, value)


def task_parameter(
    name: str, unit: str, *, default: float = 0.0, shape: tuple[int, ...] = (), non_negative: bool = True
) -> Parameter:
    """Returns a parameter that no field of the physics has: the task reads its value."""
    kind = ParameterType(
        read=lambda *_: np.full(shape, default),
        write=lambda *_: None,
        model_fields=(),
        shape=shape,
        non_negative=non_negative,
    )
    return Parameter(name=name, unit=unit, type=kind, elements=())


def pose_parameters(entity: composer.Entity) -> tuple[Parameter, ...]:
    """Returns the offset and the yaw of an entity that stands upright, attached without a free joint."""
    owner, frame = entity.mjcf_model.model, (mjcf.get_attachment_frame(entity.mjcf_model),)
    return (
        Parameter(name=f"{owner}/offset", unit="m", type=POSITION_OFFSET, elements=frame),
        Parameter(name=f"{owner}/yaw", unit="rad", type=YAW, elements=frame),
    )


def joint_parameters(name: str, joint: mjcf.Element) -> tuple[Parameter, ...]:
    """Returns dry friction and damping of a slide or hinge; their names start with `name`, which includes the owner."""
    force, damping = ("N", "N s/m") if joint.type == "slide" else ("N m", "N m s/rad")
    return (
        Parameter(name=f"{name}_friction", unit=force, type=JOINT_FRICTION, elements=(joint,)),
        Parameter(name=f"{name}_damping", unit=damping, type=JOINT_DAMPING, elements=(joint,)),
    )


def built_position(frame: mjcf.Element) -> NDArray[np.float64]:
    """Returns the position of a frame in its parent as the scene is built [m]."""
    return np.zeros(3) if frame.pos is None else frame.pos


def _read_yaw(physics: mjcf.Physics, elements: Elements) -> ArrayLike:
    w, _, _, z = physics.bind(elements[0]).quat
    return 2 * np.arctan2(z, w)


def _write_yaw(physics: mjcf.Physics, elements: Elements, value: NDArray[np.float64]) -> None:
    quaternion = np.array([np.cos(value / 2), 0.0, 0.0, np.sin(value / 2)])
    physics.bind(elements[0]).quat = quaternion / np.linalg.norm(quaternion)


def _place(physics: mjcf.Physics, elements: Elements, *column: int) -> tuple[Any, ...]:
    """Returns the index of elements in a field of the model, of joints in one by `dof`; or in a column of the field."""
    bound = physics.bind(elements)
    return (bound.dofadr if elements[0].tag == "joint" else bound.element_id, *column)


def shared_value(field: str, *column: int, visual: bool = False) -> ParameterType:
    """Returns the kind of a non-negative number that elements share in a field of the model, or in a column of it."""

    def write(physics: mjcf.Physics, elements: Elements, value: NDArray[np.float64]) -> None:
        getattr(physics.model.ptr, field)[_place(physics, elements, *column)] = value

    return ParameterType(
        read=lambda physics, elements: getattr(physics.model.ptr, field)[_place(physics, elements, *column)][0],
        write=write,
        model_fields=(field,),
        non_negative=True,
        visual=visual,
    )


# dm_control sets it to 0 where a pose is written: the body's frame is no longer that of its inertia.
_SAMEFRAME = "body_sameframe"

# Translation from the built position, in the frame of the parent.
POSITION_OFFSET = ParameterType(
    read=lambda physics, frames: physics.bind(frames[0]).pos - built_position(frames[0]),
    write=lambda physics, frames, value: setattr(physics.bind(frames[0]), "pos", built_position(frames[0]) + value),
    model_fields=("body_pos", _SAMEFRAME),
    shape=(3,),
)

# Rotation about the z axis of the parent.
YAW = ParameterType(read=_read_yaw, write=_write_yaw, model_fields=("body_quat", _SAMEFRAME))

JOINT_FRICTION = shared_value("dof_frictionloss")
JOINT_DAMPING = shared_value("dof_damping")

# Coefficient of sliding friction of geoms; a contact has the greater one of its two geoms' coefficients.
SLIDING_FRICTION = shared_value("geom_friction", 0)


def displacement(
    name: str, joints: Sequence[mjcf.Element], *, followers: Sequence[mjcf.Element] = (), ratio: float = 0.0
) -> Parameter:
    """Returns the displacement of all slides or all hinges from where an episode starts: a number, or one for each.

    An equality constraint couples followers to these joints one by one; `ratio` is the displacement of a follower for
    one unit of its joint's.
    """
    count = len(joints)
    shape = () if count == 1 else (count,)

    def write(physics: mjcf.Physics, elements: Elements, value: NDArray[np.float64]) -> None:
        physics.bind(elements[:count]).qpos += value
        if followers:
            physics.bind(elements[count:]).qpos += ratio * value

    parameter_type = ParameterType(
        read=lambda physics, elements: np.zeros(shape), write=write, model_fields=(), shape=shape
    )
    unit = "m" if joint_types(joints)[0] == "slide" else "rad"
    return Parameter(name=name, unit=unit, type=parameter_type, elements=(*joints, *followers))


def _displace_freely(physics: mjcf.Physics, elements: Elements, value: NDArray[np.float64]) -> None:
    (joint,) = elements
    x, y, yaw = value
    start = int(physics.bind(joint).qposadr)
    position, quaternion = np.split(physics.data.ptr.qpos[start : start + 7], [3])
    position[:2] += x, y
    if yaw:
        rotation = np.array([np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)])
        mujoco.mju_mulQuat(quaternion, rotation, quaternion.copy())


# Displacement of a free joint from where an episode starts: x and y [m], and rotation about the vertical [rad].
FREE_DISPLACEMENT = ParameterType(
    read=lambda physics, elements: np.zeros(3), write=_displace_freely, model_fields=(), shape=(3,)
)


def _scale_type(**columns: int | None) -> ParameterType:
    """Returns the kind of a factor, 1 in the built scene, of fields of the model, or of a column of each."""

    def write(physics: mjcf.Physics, elements: Elements, value: NDArray[np.float64]) -> None:
        for field, column in columns.items():
            place = _place(physics, elements, *(() if column is None else (column,)))
            getattr(physics.model.ptr, field)[place] *= value

    return ParameterType(
        read=lambda physics, elements: 1.0, write=write, model_fields=tuple(columns), non_negative=True
    )


def _write_mass(physics: mjcf.Physics, elements: Elements, value: NDArray[np.float64]) -> None:
    bound = physics.bind(elements[0])
    ratio = value / bound.mass
    bound.inertia *= ratio
    bound.mass = value


DAMPING_SCALE = _scale_type(dof_damping=None)
FRICTION_SCALE = _scale_type(dof_frictionloss=None)

SLIDING_FRICTION_SCALE = _scale_type(geom_friction=0)  # Factor of the coefficients of sliding friction of geoms.

# Factor of the gains of position servos: gain * (target - position).
GAIN_SCALE = _scale_type(actuator_gainprm=0, actuator_biasprm=1)

# Factor of the masses of bodies, with inertia in proportion.
MASS_SCALE = dataclasses.replace(_scale_type(body_mass=None, body_inertia=None), derived=True)

# Mass of a body [kg], with inertia in proportion.
MASS = ParameterType(
    read=lambda physics, elements: physics.bind(elements[0]).mass,
    write=_write_mass,
    model_fields=("body_mass", "body_inertia"),
    non_negative=True,
    derived=True,
)


def scale(name: str, parameter_type: ParameterType, elements: Sequence[mjcf.Element]) -> Parameter:
    """Returns a factor of what the built scene has, 1 by default."""
    return Parameter(name=name, unit="1", type=parameter_type, elements=tuple(elements))


def door_parameters(owner: str, joints: Sequence[mjcf.Element]) -> tuple[Parameter, ...]:
    """Returns factors of damping and of dry friction of an owner's doors, drawers or knobs."""
    return (
        scale(f"{owner}/damping_scale", DAMPING_SCALE, joints),
        scale(f"{owner}/friction_scale", FRICTION_SCALE, joints),
    )
