"""Robots: an arm with a hand, built from an MJCF file and a record of what it does not say."""

import dataclasses
import functools
import importlib.util
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from dm_control import composer, mjcf
from dm_control.composer.observation import observable
from numpy.typing import NDArray

from kitchen_suite.entities import assets
from kitchen_suite.entities.joints import JointObservables
from kitchen_suite.entities.parameters import (
    DAMPING_SCALE,
    GAIN_SCALE,
    SLIDING_FRICTION,
    Parameter,
    displacement,
    scale,
)
from kitchen_suite.types import Array, Quaternion, Vector

_MAX_JOINTS = 7  # Of an arm: pushes displace as many.

# Options of the physics with which arms and hands of other packages are stable and hold what they grasp.
PHYSICS_OPTIONS: Mapping[str, Any] = MappingProxyType(
    {"integrator": "implicitfast", "cone": "elliptic", "impratio": 10.0}
)


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class RobotSpec:
    """A robot: where its MJCF is, and what that does not say; equal only to itself, so that it can be a key.

    Limits and gains are read from the MJCF. Names are those of elements in the loaded model.

    Attributes:
      name: of the robot; the prefix of its elements and observations.
      load: returns the MJCF of arm and hand, called with `visuals`, whether to keep the visual geoms.
      servos: position actuators of the arm by joint, from the base outwards.
      hand_actuators: actuators of the hand.
      closed: target of each of them that closes the hand, in its unit.
      open: target that opens it.
      home: positions of joints at the start of an episode, by joint; those left out are 0 [rad, m].
      end_effector: site between the fingers, 0.04 to 0.05 m before their tips; z is the direction of approach, y the
        direction in which the fingers move.
      fingers: the two joints of a hand whose fingers slide apart and have a position actuator each, the left one
        first; none for other hands.
      pads: colliding geoms of the left and of the right finger whose friction is a parameter, if any.
      base_pos: position of the base from the top of the kitchen's pedestal: forwards, to the left, up [m].
      base_quat: orientation of the base there.
      physics_options: options of the physics that the robot needs in the kitchen; none if those of the kitchen suit it.
    """

    name: str
    load: Callable[..., mjcf.RootElement]
    servos: Mapping[str, str]
    hand_actuators: tuple[str, ...]
    closed: float
    open: float
    home: Mapping[str, float]
    end_effector: str = "end_effector"
    fingers: tuple[str, ...] = ()
    pads: tuple[str, ...] = ()
    base_pos: Vector = (0.0, 0.0, 0.0)
    base_quat: Quaternion = (1.0, 0.0, 0.0, 0.0)
    physics_options: Mapping[str, Any] = dataclasses.field(default_factory=lambda: dict(PHYSICS_OPTIONS))


class RobotObservables(JointObservables):
    """Joint positions and velocities, and the end effector's position; disabled by default."""

    @composer.observable
    def end_effector_position(self) -> observable.MJCFFeature:
        """Position of `end_effector` in the world: `(3,)` float64 [m]; site_xpos; no noise; no task enables it."""
        return observable.MJCFFeature("xpos", self._entity.end_effector)


class Robot(assets.NamedEntity):
    """An arm and a hand with a gripper; its base is at the entity's origin and faces +x.

    Its joints are those of the arm, from the base outwards, then the hand's. Its actuators are the position servos of
    the arm's joints, in their order, then those of the hand.
    """

    def _build(self, specification: RobotSpec, *, visuals: bool = True, name: str | None = None) -> None:
        """Loads the robot; `name`, that of the specification when omitted, is the prefix of its elements in a scene.

        Without `visuals` it has no visual geoms; the physics stays the same to the bit.
        """
        if not 0 < len(specification.servos) <= _MAX_JOINTS:
            raise ValueError(f"robot {specification.name!r} must have 1 to {_MAX_JOINTS} servos of its arm")
        self._specification = specification
        self._mjcf_root = specification.load(visuals=visuals)
        self._mjcf_root.model = name or specification.name
        arm = self._find_all("joint", specification.servos)
        self._joints = (*arm, *(joint for joint in self._mjcf_root.find_all("joint") if joint not in arm))
        self._actuators = self._find_all("actuator", (*specification.servos.values(), *specification.hand_actuators))
        (self._end_effector,) = self._find_all("site", (specification.end_effector,))
        self._fingers = self._find_all("joint", specification.fingers)
        self._pads = self._find_all("geom", specification.pads)
        home = dict(zip(self._find_all("joint", specification.home), specification.home.values(), strict=True))
        self._home = tuple(home.get(joint, 0.0) for joint in self._joints)

    def _build_observables(self) -> RobotObservables:
        return RobotObservables(self)

    def _find_all(self, kind: str, names: Iterable[str]) -> tuple[mjcf.Element, ...]:
        return tuple(self._find(kind, name) for name in names)

    def _find(self, kind: str, name: str) -> mjcf.Element:
        if (element := self._mjcf_root.find(kind, name)) is None:
            names = [each.full_identifier for each in self._mjcf_root.find_all(kind) if each.name]
            raise ValueError(f"the MJCF of robot {self._specification.name!r} has no {kind} {name!r}, but {names}")
        return element

    @property
    def specification(self) -> RobotSpec:
        """The record that the robot was built from."""
        return self._specification

    @property
    def arm_size(self) -> int:
        """Number of the arm's joints."""
        return len(self._specification.servos)

    @property
    def joints(self) -> tuple[mjcf.Element, ...]:
        """The joints of arm and hand."""
        return self._joints

    @property
    def actuators(self) -> tuple[mjcf.Element, ...]:
        """The actuators of arm and hand."""
        return self._actuators

    @property
    def end_effector(self) -> mjcf.Element:
        """The site between the fingers: z is the direction of approach, y the direction in which the fingers move."""
        return self._end_effector

    @property
    def fingers(self) -> tuple[mjcf.Element, ...]:
        """Two sliding joints whose positions add up to the distance between the fingers; empty for other hands."""
        return self._fingers

    @property
    def pads(self) -> tuple[mjcf.Element, ...]:
        """Colliding geoms of the left and of the right finger; empty where the specification names none."""
        return self._pads

    @property
    def home(self) -> tuple[float, ...]:
        """Positions of the joints at the start of an episode [rad, m]; the hand is open."""
        return self._home

    @property
    def grip(self) -> tuple[float, float]:
        """Targets of the hand's actuators that close it, and that open it, in their unit."""
        return self._specification.closed, self._specification.open

    @property
    def joint_limits(self) -> Array:
        """Least and greatest position `(2, n)` of each joint [rad, m], infinite where it has none; read-only."""
        return _compiled(self._specification).joint_limits

    @property
    def gains(self) -> Array:
        """Stiffness `(arm_size,)` of the arm's servos [N m/rad]; read-only."""
        return _compiled(self._specification).gains

    @property
    def damping(self) -> Array:
        """Damping `(arm_size,)` of the arm's joints, with that of their servos [N m s/rad]; read-only."""
        return _compiled(self._specification).damping

    def holding_targets(self, positions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns targets `(..., m)` of the actuators that hold the arm at joint positions `(..., n)`.

        Fingers with an actuator each are held as well. Another hand is opened.
        """
        if self._fingers:
            return positions
        size = self.arm_size
        hand = np.full((*positions.shape[:-1], len(self._actuators) - size), self._specification.open)
        return np.concatenate([positions[..., :size], hand], axis=-1)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Friction of the pads, displacement of the arm at the start, gains of the arm's servos, damping."""
        owner = self._mjcf_root.model
        arm, servos = self._joints[: self.arm_size], self._actuators[: self.arm_size]
        pad_friction = Parameter(name=f"{owner}/pad_friction", unit="1", type=SLIDING_FRICTION, elements=self._pads)
        return (
            *([pad_friction] if self._pads else []),
            displacement(f"{owner}/joint_offset", arm),
            scale(f"{owner}/gain_scale", GAIN_SCALE, servos),
            scale(f"{owner}/damping_scale", DAMPING_SCALE, arm),
        )


class _Compiled(NamedTuple):
    """Numbers of a robot's compiled model; see the properties of `Robot`."""

    joint_limits: Array
    gains: Array
    damping: Array


@functools.cache
def _compiled(specification: RobotSpec) -> _Compiled:
    robot = Robot(specification, visuals=False)
    physics = mjcf.Physics.from_mjcf_model(robot.mjcf_model)
    joints = physics.bind(robot.joints)
    arm = physics.bind(robot.joints[: robot.arm_size])
    servos = physics.bind(robot.actuators[: robot.arm_size])
    model = physics.model
    limited = zip(model.jnt_limited[arm.element_id], model.actuator_ctrllimited[servos.element_id], strict=True)
    for (joint, name), bias, limits in zip(specification.servos.items(), servos.biasprm, limited, strict=True):
        if bias[1] >= 0.0 or not all(limits):
            wanted = f"a range of joint {joint!r}, and a position servo {name!r} with a control range"
            raise ValueError(f"robot {specification.name!r} needs {wanted}")
    unlimited = np.array([[-np.inf], [np.inf]])
    compiled = _Compiled(
        joint_limits=np.where(model.jnt_limited[joints.element_id], joints.range.T, unlimited),
        gains=np.array(servos.gainprm[:, 0]),
        damping=model.dof_damping[arm.dofadr] - servos.biasprm[:, 2],
    )
    for array in compiled:
        array.flags.writeable = False
    return compiled


def load_package_mjcf(package: str, file: str, *, visuals: bool) -> mjcf.RootElement:
    """Parses an MJCF file in the folder of a package, without importing the package; see `prepare_mjcf`.

    Raises an ImportError if the package is missing.
    """
    spec = importlib.util.find_spec(package)
    if spec is None or not spec.submodule_search_locations:
        raise ImportError(f"the MJCF {file} is in the package {package}, which is not installed")
    return load_mjcf(Path(next(iter(spec.submodule_search_locations)), file), visuals=visuals)


def load_mjcf(path: Path, *, visuals: bool) -> mjcf.RootElement:
    """Parses an MJCF file that was not written for the suite; a slash in its names becomes a backslash."""
    return prepare_mjcf(mjcf.from_path(str(path), escape_separators=True), visuals=visuals)


def prepare_mjcf(model: mjcf.RootElement, *, visuals: bool) -> mjcf.RootElement:
    """Returns a model without what belongs to a scene of its own, with visual geoms only where they are wanted.

    Raises a ValueError if its angles are in degrees.
    """
    if model.compiler.angle != "radian":
        raise ValueError(f"angles of the MJCF {model.model!r} must be in radians: it has compiler angle='degree'")
    for kind in ("light", "sensor", "key"):
        for element in model.find_all(kind, exclude_attachments=True):
            element.remove()
    # Bodies without an inertia of their own have that of their colliding geoms, with and without visual ones.
    for geom in model.find_all("geom", exclude_attachments=True):
        if assets.is_visual(geom):
            geom.mass = 0
    for options in (model.option, model.visual, model.statistic, model.size):
        options.remove()
    (assets.split_visual_geoms if visuals else assets.remove_visuals)(model)
    return model
