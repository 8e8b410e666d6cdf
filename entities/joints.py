"""Joints: their addresses in a compiled model, and observables of their positions and velocities."""

import functools
from collections.abc import Callable, Sequence

import numpy as np
from dm_control import composer, mjcf
from dm_control.composer.observation import observable
from numpy.typing import NDArray

# Types of joints in the order of MuJoCo's mjtJoint, and their widths in qpos and in qvel.
_TYPES = ("free", "ball", "slide", "hinge")
_QPOS_WIDTHS = np.array([7, 4, 1, 1])
_QVEL_WIDTHS = np.array([6, 3, 1, 1])


def position_sizes(joints: Sequence[mjcf.Element]) -> list[int]:
    """Returns the number of each joint's elements in qpos."""
    return [int(_QPOS_WIDTHS[_TYPES.index(kind)]) for kind in joint_types(joints)]


def joint_types(joints: Sequence[mjcf.Element]) -> list[str]:
    """Returns the type of each joint, `free`, `ball`, `slide` or `hinge`; its own or that of its class."""
    return ["free" if joint.tag == "freejoint" else _joint_type(joint) for joint in joints]


def _joint_type(joint: mjcf.Element) -> str:
    if joint.type:
        return str(joint.type)
    default = joint.dclass or joint.root.default
    while default is not None and default.tag == "default":
        if default.joint.type:
            return str(default.joint.type)
        default = default.parent
    return "hinge"


def addresses(physics: mjcf.Physics, joints: Sequence[mjcf.Element]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Returns the indices of some joints in qpos and in qvel, joint by joint."""
    bound = physics.bind(joints)
    return _ranges(bound.qposadr, _QPOS_WIDTHS[bound.type]), _ranges(bound.dofadr, _QVEL_WIDTHS[bound.type])


def _ranges(starts: NDArray[np.int64], widths: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.concatenate([start + np.arange(width) for start, width in zip(starts, widths, strict=True)])


class JointState(observable.Observable):
    """Positions or velocities of some joints, joint by joint: copies, at the cost of one array index."""

    def __init__(self, field: str, joints: Callable[[], Sequence[mjcf.Element]]) -> None:
        """Stores what to read: the field `qpos` or `qvel` of the joints that `joints` returns.

        It is called after a model was compiled, since attaching may give an entity joints.
        """
        super().__init__(update_interval=1, buffer_size=None, delay=None, aggregator=None, corruptor=None)
        self._field, self._joints = field, joints
        # Indices into the state array, and the compiled model that they are valid for.
        self._model = None
        self._indices = np.empty(0, np.int64)

    def _callable(self, physics: mjcf.Physics) -> Callable[[], NDArray[np.float64]]:
        if self._model is not physics.model.ptr:
            self._model = physics.model.ptr
            in_qpos, in_qvel = addresses(physics, self._joints())
            self._indices = in_qpos if self._field == "qpos" else in_qvel
        return functools.partial(getattr(physics.data, self._field).__getitem__, self._indices)


class JointObservables(composer.Observables):
    """Positions and velocities of an entity's joints; disabled by default."""

    @composer.observable
    def joint_positions(self) -> JointState:
        """Positions, in the order of `joints`: `(n,)` float64, hinges [rad], slides [m]; qpos; noise by task."""
        return JointState("qpos", lambda: self._entity.joints)

    @composer.observable
    def joint_velocities(self) -> JointState:
        """Velocities, in the order of `joints`: `(n,)` float64, hinges [rad/s], slides [m/s]; qvel; noise by task."""
        return JointState("qvel", lambda: self._entity.joints)
