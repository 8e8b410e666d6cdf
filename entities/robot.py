"""Robots: what tasks and control modes need of an arm with a hand, and arms that are loaded from MJCF of others."""

import abc
import dataclasses
import functools
import importlib
import importlib.util
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite import checks
from kitchen_suite.entities import assets
from kitchen_suite.entities.assets import Vector
from kitchen_suite.entities.franka_specs import JointActuator
from kitchen_suite.entities.joints import JointObservables

Quaternion = tuple[float, float, float, float]


class Robot(assets.NamedEntity, abc.ABC):
    """An arm and a hand with a gripper; its joints are those of the arm, from the base outwards, then the hand's.

    Its actuators are the position servos of the arm's joints, in their order, then those of the hand.
    """

    @property
    @abc.abstractmethod
    def arm_size(self) -> int:
        """Number of the arm's joints."""

    @property
    @abc.abstractmethod
    def joints(self) -> tuple[mjcf.Element, ...]:
        """The joints of arm and hand."""

    @property
    @abc.abstractmethod
    def actuators(self) -> tuple[mjcf.Element, ...]:
        """The actuators of arm and hand."""

    @property
    @abc.abstractmethod
    def joint_actuators(self) -> tuple[JointActuator, ...]:
        """Parameters of joints and their actuators; those of the arm are the first."""

    @property
    @abc.abstractmethod
    def end_effector(self) -> mjcf.Element:
        """The site between the fingers: z is the direction of approach, y the direction in which the fingers move."""

    @property
    @abc.abstractmethod
    def home(self) -> tuple[float, ...]:
        """Positions of the joints at the start of an episode in the kitchen [rad, m]; the hand is open."""

    @property
    @abc.abstractmethod
    def grip(self) -> tuple[float, float]:
        """Targets of the hand's actuators that close it, and that open it, in their unit."""

    @property
    def fingers(self) -> tuple[mjcf.Element, ...]:
        """Two sliding joints whose positions add up to the distance between the fingers; empty for other hands."""
        return ()

    def holding_targets(self, positions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns targets `(..., m)` of the actuators for joint positions `(..., n)`, with an open hand."""
        size = self.arm_size
        hand = np.full((*positions.shape[:-1], len(self.actuators) - size), self.grip[1])
        return np.concatenate([positions[..., :size], hand], axis=-1)


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class ArmSpec:
    """An arm whose MJCF is loaded, and how it stands in the kitchen; equal only to itself, so that it can be a key.

    What is not said here, such as limits and gains, is read from the MJCF.

    Attributes:
      name: of the robot; the prefix of its elements and observations.
      arm: loads the MJCF of the arm, perhaps with its hand.
      servos: position actuators of the arm by joint, from the base outwards.
      hand_actuators: actuators of the hand; the names are those within the arm's model.
      closed: target of each of them that closes the hand, in its unit.
      open: target that opens it.
      tool: body to which the end effector's site is fixed.
      tool_pos: position of the site in its frame, 0.04 to 0.05 m before the tips of the fingers [m].
      tool_quat: orientation of the site; its z axis is the direction of approach, the fingers move along y.
      home: positions of joints at the start of an episode, by joint; those left out are 0 [rad, m].
      hand: loads the MJCF of a hand that is attached at the arm's site `mount`; None where the arm has one.
      mount: name of that site.
      base_pos: position of the base from the top of the kitchen's pedestal: forwards, to the left, up [m].
      base_quat: orientation of the base there.
    """

    name: str
    arm: Callable[[], mjcf.RootElement]
    servos: Mapping[str, str]
    hand_actuators: tuple[str, ...]
    closed: float
    open: float
    tool: str
    tool_pos: Vector
    tool_quat: Quaternion = (1.0, 0.0, 0.0, 0.0)
    home: Mapping[str, float]
    hand: Callable[[], mjcf.RootElement] | None = None
    mount: str = "attachment_site"
    base_pos: Vector = (0.0, 0.0, 0.0)
    base_quat: Quaternion = (1.0, 0.0, 0.0, 0.0)


_MAX_JOINTS = 7  # Of an arm: pushes displace as many.

# Options of the physics with which these arms and hands are stable and hold what they grasp.
PHYSICS_OPTIONS: Mapping[str, Any] = MappingProxyType(
    {"integrator": "implicitfast", "cone": "elliptic", "impratio": 10.0}
)


class Arm(Robot):
    """An arm of an `ArmSpec`."""

    def _build(self, specification: ArmSpec, *, visuals: bool = True) -> None:
        """Loads the arm and its hand; without `visuals` it has no visual geoms, and the physics stays the same."""
        if not 0 < len(specification.servos) <= _MAX_JOINTS:
            raise ValueError(f"robot {specification.name!r} must have 1 to {_MAX_JOINTS} servos of its arm")
        self._specification = specification
        self._mjcf_root = _prepared(specification.arm(), visuals)
        self._mjcf_root.model = specification.name
        if specification.hand:
            self._find("site", specification.mount).attach(_prepared(specification.hand(), visuals))
        pose = {"pos": specification.tool_pos, "quat": specification.tool_quat}
        self._find("body", specification.tool).add("site", name="end_effector", size=(0.01,), group=5, **pose)

    def _build_observables(self) -> JointObservables:
        return JointObservables(self)

    def _find(self, kind: str, name: str) -> mjcf.Element:
        if (element := self._mjcf_root.find(kind, name)) is None:
            names = [each.full_identifier for each in self._mjcf_root.find_all(kind) if each.name]
            raise ValueError(f"the MJCF of robot {self._specification.name!r} has no {kind} {name!r}, but {names}")
        return element

    @property
    def specification(self) -> ArmSpec:
        """Parameters of the robot."""
        return self._specification

    @property
    def arm_size(self) -> int:
        return len(self._specification.servos)

    @property
    def joints(self) -> tuple[mjcf.Element, ...]:
        arm = [self._find("joint", name) for name in self._specification.servos]
        return (*arm, *(joint for joint in self._mjcf_root.find_all("joint") if joint not in arm))

    @property
    def actuators(self) -> tuple[mjcf.Element, ...]:
        names = (*self._specification.servos.values(), *self._specification.hand_actuators)
        return tuple(self._find("actuator", name) for name in names)

    @property
    def joint_actuators(self) -> tuple[JointActuator, ...]:
        return _servos(self._specification)

    @property
    def end_effector(self) -> mjcf.Element:
        return self._find("site", f"{self._specification.tool.rpartition('/')[0]}/end_effector".lstrip("/"))

    @property
    def home(self) -> tuple[float, ...]:
        angles = {self._find("joint", name): angle for name, angle in self._specification.home.items()}
        return tuple(angles.get(joint, 0.0) for joint in self.joints)

    @property
    def grip(self) -> tuple[float, float]:
        return self._specification.closed, self._specification.open


def _prepared(model: mjcf.RootElement, visuals: bool) -> mjcf.RootElement:
    """Returns a model without what belongs to a scene of its own, with visual geoms only where they are wanted."""
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


@functools.cache
def _servos(specification: ArmSpec) -> tuple[JointActuator, ...]:
    """Reads the parameters of the arm's joints and servos."""
    robot = Arm(specification, visuals=False)
    physics = mjcf.Physics.from_mjcf_model(robot.mjcf_model)
    joints = physics.bind(robot.joints[: robot.arm_size])
    servos = physics.bind(robot.actuators[: robot.arm_size])
    model = physics.model
    limited = zip(model.jnt_limited[joints.element_id], model.actuator_ctrllimited[servos.element_id], strict=True)
    for (joint, name), bias, limits in zip(specification.servos.items(), servos.biasprm, limited, strict=True):
        if bias[1] >= 0.0 or not all(limits):
            wanted = f"a range of joint {joint!r}, and a position servo {name!r} with a control range"
            raise ValueError(f"robot {specification.name!r} needs {wanted}")
    columns = {
        "joint": specification.servos,
        "range": map(tuple, joints.range.tolist()),
        "damping": physics.model.dof_damping[joints.dofadr].tolist(),
        "armature": physics.model.dof_armature[joints.dofadr].tolist(),
        "gain": servos.gainprm[:, 0].tolist(),
        "velocity_gain": (-servos.biasprm[:, 2]).tolist(),
        "force": servos.forcerange[:, 1].tolist(),
        "control_range": map(tuple, servos.ctrlrange.tolist()),
    }
    rows = zip(*columns.values(), strict=True)
    return tuple(JointActuator(**dict(zip(columns, row, strict=True))) for row in rows)


def load_package_mjcf(package: str, file: str, robot: str, install: str | None = None) -> mjcf.RootElement:
    """Parses an MJCF file in the folder of a package, without importing the package, for a robot.

    Raises an ImportError with the command to `install` it, by default that of the extra `arms`, if it is missing.
    """
    spec = importlib.util.find_spec(package)
    if spec is None or not spec.submodule_search_locations:
        raise ImportError(f"robot {robot!r} needs {package}: {install or checks.install_command('arms')}")
    return load_mjcf(Path(next(iter(spec.submodule_search_locations)), file))


def load_menagerie_mjcf(folder: str, file: str, robot: str) -> mjcf.RootElement:
    """Parses an MJCF file of MuJoCo Menagerie for a robot; the package mujoco-menagerie downloads its folder once.

    Where the variable MENAGERIE_ROOT names a copy of Menagerie's folder, nothing is downloaded.
    """
    checks.installed(("mujoco_menagerie",), f"robot {robot!r}", "arms")
    menagerie = importlib.import_module("mujoco_menagerie")
    try:
        downloaded: Path = menagerie.get(folder).path()
    except menagerie.MenagerieError as error:
        raise OSError(f"robot {robot!r} needs the folder {folder} of MuJoCo Menagerie: {error}") from error
    return load_mjcf(downloaded / file)


def load_mjcf(path: Path) -> mjcf.RootElement:
    """Parses an MJCF file of others; a slash in its names becomes a backslash."""
    return mjcf.from_path(str(path), escape_separators=True)
