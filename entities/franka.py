"""The Franka Emika Panda with its two-finger hand: nine joints, each with a position actuator.

The entity builds any model of this robot from its `FrankaSpec`.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from dm_control import composer, mjcf
from dm_control.composer.observation import observable
from numpy.typing import NDArray

from kitchen_suite.entities import assets
from kitchen_suite.entities.franka_specs import KITCHEN_FRANKA, Finger, FrankaSpec, Inertia, JointActuator
from kitchen_suite.entities.joints import JointObservables
from kitchen_suite.entities.parameters import (
    DAMPING_SCALE,
    GAIN_SCALE,
    SLIDING_FRICTION,
    Parameter,
    displacement,
    scale,
)
from kitchen_suite.entities.robot import Robot

COLOR = (0.94, 0.935, 0.92)  # Of the visual geoms: red, green and blue from 0 to 1.

# Factors of this colour for the parts that are darker, by name. With powers of two, products are exact.
SHADES: Mapping[str, float] = MappingProxyType({"link7": 0.5, "hand": 0.5, "left_finger": 0.5, "right_finger": 0.5})


class Franka(Robot):
    """The arm with its hand; its base is at the entity's origin and faces +x."""

    def _build(self, specification: FrankaSpec = KITCHEN_FRANKA, *, visuals: bool = True, name: str = "franka") -> None:
        """Builds the robot of a specification; `name` is the prefix of its elements in a scene.

        Without `visuals` it has no visual geoms; the physics stays the same to the bit.
        """
        self._specification = specification
        self._mjcf_root = assets.new_model(name)
        self._add_defaults()
        self._add_meshes()
        self._add_arm()
        for finger in specification.fingers:
            self._add_finger(finger)
        self._mjcf_root.resolve_references()
        if not visuals:
            assets.remove_visuals(self._mjcf_root)

    def _build_observables(self) -> "FrankaObservables":
        return FrankaObservables(self)

    @property
    def specification(self) -> FrankaSpec:
        """Parameters of the robot."""
        return self._specification

    @property
    def arm_size(self) -> int:
        return len(self._specification.links)

    @property
    def home(self) -> tuple[float, ...]:
        return self._specification.home

    @property
    def grip(self) -> tuple[float, float]:
        closed, opened = self._specification.joint_limits[:, -1]
        return closed, opened

    @property
    def fingers(self) -> tuple[mjcf.Element, ...]:
        return self.joints[-2:]

    def holding_targets(self, positions: NDArray[np.float64]) -> NDArray[np.float64]:
        return positions

    @property
    def joint_actuators(self) -> tuple[JointActuator, ...]:
        """The nine joints with their actuators: the arm's from the base outwards, then the two fingers'."""
        return self._specification.joint_actuators

    @property
    def joints(self) -> tuple[mjcf.Element, ...]:
        """The nine joints in the order of `joint_actuators`."""
        return tuple(self._mjcf_root.find("joint", actuator.joint) for actuator in self.joint_actuators)

    @property
    def actuators(self) -> tuple[mjcf.Element, ...]:
        """The nine position actuators in the order of `joint_actuators`."""
        return tuple(self._mjcf_root.find("actuator", actuator.joint) for actuator in self.joint_actuators)

    @property
    def end_effector(self) -> mjcf.Element:
        """The site between the fingers."""
        return self._mjcf_root.find("site", self._specification.end_effector["name"])

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Friction of the finger pads, displacement of the arm at the start, gains of the arm's servos, damping."""
        pads = tuple(self.finger_geoms(side)[0] for side in ("left", "right"))
        owner, count = self._mjcf_root.model, len(self._specification.links)
        arm, servos = self.joints[:count], self.actuators[:count]
        return (
            # Coefficient of the first colliding geom of each finger.
            Parameter(name=f"{owner}/pad_friction", unit="1", type=SLIDING_FRICTION, elements=pads),
            displacement(f"{owner}/joint_offset", arm),
            scale(f"{owner}/gain_scale", GAIN_SCALE, servos),
            scale(f"{owner}/damping_scale", DAMPING_SCALE, arm),
        )

    def finger_geoms(self, side: str) -> tuple[mjcf.Element, ...]:
        """The colliding geoms of the `left` or the `right` finger."""
        body = self._mjcf_root.find("body", f"{side}_finger")
        return tuple(geom for geom in body.geom if not assets.is_visual(geom))

    def _add_defaults(self) -> None:
        top = self._mjcf_root.default
        visual = top.add("default", dclass="visual")
        visual.geom.set_attributes(group=1, contype=0, conaffinity=0, type="mesh", rgba=(*COLOR, 1), mass=0)
        link = top.add("default", dclass="link")
        link.geom.set_attributes(group=3, contype=1, conaffinity=1, type="mesh", rgba=(0.5, 0.6, 0.7, 1))
        # Conaffinity 0: no contacts among fingers. Geoms of the surroundings have conaffinity 1, so they still collide.
        finger = top.add("default", dclass="finger")
        finger.geom.set_attributes(group=3, contype=1, conaffinity=0, rgba=(0.5, 0.6, 0.7, 0.4))
        finger.geom.set_attributes(**self._specification.finger_contact)

    def _add_meshes(self) -> None:
        for part in (*(f"link{i}" for i in range(8)), "hand"):
            for kind in ("collision", "visual"):
                path = f"franka_assets/meshes/{kind}/{part}.stl"
                self._mjcf_root.asset.add("mesh", name=f"{part}_{kind}", file=path)
        path = "franka_assets/meshes/collision/finger.stl"
        size = self._specification.finger_scale
        self._mjcf_root.asset.add("mesh", name="finger_visual", file=path, scale=size)

    def _add_arm(self) -> None:
        specification = self._specification
        body = self._mjcf_root.worldbody.add("body", name="link0")
        self._add_part(body, "link0", specification.base_inertia)
        for number, link in enumerate(specification.links, start=1):
            body = body.add("body", name=f"link{number}", pos=link.pos, **link.rotation)
            self._add_joint(body, link.actuator, type="hinge", axis=(0, 0, 1))
            self._add_part(body, f"link{number}", link.inertia)
        pose = {"pos": specification.hand_pos, "quat": specification.hand_quat}
        self._add_part(body, "hand", specification.hand_inertia, **pose)
        body.add("site", size=(0.01,), group=3, **specification.end_effector)
        body.add("camera", name="wrist", **specification.wrist_camera)
        body.add("camera", name="hand", **specification.hand_camera)

    def _add_finger(self, finger: Finger) -> None:
        specification = self._specification
        link7 = self._mjcf_root.find("body", "link7")
        pose = {"pos": specification.finger_pos, "quat": specification.hand_quat}
        body = link7.add("body", name=f"{finger.side}_finger", **pose)
        body.add("inertial", mass=finger.inertia.mass, **finger.inertia.inertial)
        self._add_joint(body, finger.actuator, type="slide", axis=finger.axis)
        # The mesh is that of a left finger.
        orientation = {} if finger.side == "left" else {"quat": (0, 0, 0, 1)}
        self._add_visual(body, f"{finger.side}_finger", "finger_visual", **orientation)
        for geom in finger.geoms:
            body.add("geom", dclass="finger", **geom)

    def _add_part(self, body: mjcf.Element, part: str, inertia: Inertia, **pose: Any) -> None:
        """Adds a part's meshes and mass, in a new body if the part has both a pose and `inertial` attributes."""
        if pose and inertia.inertial:
            body, pose = body.add("body", name=part, **pose), {}
        if inertia.inertial:
            body.add("inertial", mass=inertia.mass, **inertia.inertial)
        self._add_visual(body, part, f"{part}_visual", **pose)
        body.add("geom", name=part, dclass="link", mesh=f"{part}_collision", mass=inertia.mass, **pose)

    def _add_visual(self, body: mjcf.Element, part: str, mesh: str, **pose: Any) -> None:
        geom = body.add("geom", name=f"{part}_visual", dclass="visual", mesh=mesh, **pose)
        if shade := SHADES.get(part):
            geom.rgba = (*(shade * channel for channel in COLOR), 1)

    def _add_joint(self, body: mjcf.Element, actuator: JointActuator, **attributes: Any) -> None:
        attributes |= {"range": actuator.range, "damping": actuator.damping, "armature": actuator.armature}
        joint = body.add("joint", name=actuator.joint, **attributes)
        self._mjcf_root.actuator.add("position", name=actuator.joint, joint=joint, **actuator.servo)


class FrankaObservables(JointObservables):
    """Joint positions and velocities, and the end effector's position; disabled by default."""

    @composer.observable
    def end_effector_position(self) -> observable.MJCFFeature:
        """Position of `end_effector` in the world: `(3,)` float64 [m]; site_xpos; no noise; no task enables it."""
        return observable.MJCFFeature("xpos", self._entity.end_effector)
