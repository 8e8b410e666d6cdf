"""The Franka Emika Panda with its two-finger hand: nine joints, each with a position servo.

A `Calibration` holds what tells one model of this robot from another; the entity builds any of them the same way.
"""

import dataclasses
from collections.abc import Sequence

from dm_control import composer, mjcf
from dm_control.composer.observation import observable

from kitchen_suite.entities import assets

# The hand is mounted on the flange, turned by -45 degrees about its axis.
_HAND_QUAT = (0.92388, 0.0, 0.0, -0.382683)
_HAND_POS = (0.0, 0.0, 0.107)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Servo:
    """A joint and the position servo that drives it.

    Attributes:
      joint: name of the joint, and of the actuator.
      range: joint limits [rad] or [m].
      damping: [N m s/rad] or [N s/m].
      armature: rotor inertia felt at the joint [kg m^2] or [kg].
      gain: servo stiffness, `kp` of MuJoCo's position actuator [N m/rad] or [N/m].
      force: greatest torque or force [N m] or [N].
      control_range: limits of the target [rad] or [m].
    """

    joint: str
    range: tuple[float, float]
    damping: float
    armature: float = 0.0
    gain: float
    force: float
    control_range: tuple[float, float]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Link:
    """A moving link of the arm.

    Attributes:
      pos: origin of the link in the frame of the link before it [m].
      rotation: the link's orientation there, as one MJCF attribute (`quat` or `euler`).
      mass: of the link's collision mesh, which its inertia is computed from [kg].
      servo: what moves it, about or along the link's z axis.
    """

    pos: tuple[float, float, float]
    rotation: dict[str, Sequence[float]]
    mass: float
    servo: Servo


@dataclasses.dataclass(frozen=True, kw_only=True)
class Calibration:
    """Everything that tells one model of the Panda from another.

    Attributes:
      base_mass: mass of link 0 [kg].
      links: links 1 to 7, from the base outwards.
      hand_mass: mass of the hand [kg].
      fingers: servos of the two fingers.
      finger_pos: where the fingers' frames sit in the frame of link 7 [m].
      end_effector_pos: where the site `end_effector` sits in the frame of link 7 [m]; its z axis is the direction of
        approach, its y axis the one the fingers move along.
    """

    base_mass: float
    links: tuple[Link, ...]
    hand_mass: float
    fingers: tuple[Servo, Servo]
    finger_pos: tuple[float, float, float]
    end_effector_pos: tuple[float, float, float]


def _kitchen_links() -> tuple[Link, ...]:
    turn, turn_back = {"quat": (0.707107, -0.707107, 0.0, 0.0)}, {"quat": (0.707107, 0.707107, 0.0, 0.0)}
    shoulder = {"damping": 100.0, "gain": 870.0, "force": 87.0}
    wrist = {"damping": 10.0, "gain": 120.0, "force": 12.0}
    # pos [m], rotation, mass [kg], joint range [rad], control range [rad], servo
    rows = (
        ((0, 0, 0.333), {}, 2.7063, (-2.8973, 2.8973), (-2.9671, 2.9671), shoulder),
        ((0, 0, 0), turn, 2.73046, (-1.7628, 1.7628), (-1.8326, 1.8326), shoulder),
        ((0, -0.316, 0), turn_back, 2.04104, (-2.8973, 2.8973), (-2.9671, 2.9671), shoulder),
        ((0.0825, 0, 0), turn_back, 2.08129, (-3.0718, -0.4), (-3.1416, 0), shoulder),
        ((-0.0825, 0.384, 0), turn, 3.00049, (-2.8973, 2.8973), (-2.9671, 2.9671), wrist),
        ((0, 0, 0), {"euler": (1.57, 0, 1.57)}, 1.3235, (-1.6573, 2.1127), (-3.7525, 2.1817), wrist),
        ((0.088, 0, 0), {"euler": (1.57, 0, 0.7854)}, 0.2, (-2.8973, 2.8973), (-2.9671, 2.9671), wrist),
    )
    return tuple(
        Link(
            pos=pos,
            rotation=rotation,
            mass=mass,
            servo=Servo(joint=f"panda0_joint{number}", range=joint_range, control_range=control_range, **servo),
        )
        for number, (pos, rotation, mass, joint_range, control_range, servo) in enumerate(rows, start=1)
    )


def _kitchen_finger(number: int) -> Servo:
    return Servo(
        joint=f"panda0_finger_joint{number}",
        range=(0, 0.04),
        damping=100,
        armature=5,
        gain=500,
        force=70,
        control_range=(0, 0.04),
    )


# The robot of FrankaKitchen-v1, gymnasium-robotics 1.4.2 (after vikashplus/franka). Joint 6 is counted from a frame
# turned by a right angle against the Panda's own, hence its limits; right angles are written 1.57, as there.
KITCHEN = Calibration(
    base_mass=2.91242,
    links=_kitchen_links(),
    hand_mass=0.81909,
    fingers=(_kitchen_finger(1), _kitchen_finger(2)),
    finger_pos=(0, 0, 0.1654),
    end_effector_pos=(0, 0, 0.21),
)

# The inner side of a finger is a ladder of crossed capsules that narrows towards the tip, above a box.
# radius [m], y of the near and of the far end [m], z [m]; each rung is two capsules that cross.
_RUNGS = (
    (0.007, 0.006, 0.009, 0.0875),
    (0.0075, 0.007, 0.010, 0.0775),
    (0.0082, 0.008, 0.011, 0.0675),
    (0.009, 0.009, 0.012, 0.0575),
    (0.010, 0.0105, 0.0135, 0.0475),
    (0.011, 0.012, 0.015, 0.035),
)
_RUNG_HALF_WIDTH = 0.009


class Franka(composer.Entity):
    """The arm with its hand, on a base that stands at the entity's origin and faces +x."""

    def _build(self, calibration: Calibration = KITCHEN, *, visuals: bool = True, name: str = "franka") -> None:
        """Builds the robot.

        Args:
          calibration: which model of the Panda.
          visuals: `False` leaves out the geoms that only the eye needs; the physics stays the same to the bit.
          name: prefix of the robot's elements in a scene.
        """
        self._calibration = calibration
        self._mjcf_root = mjcf.RootElement(model=name, model_dir=str(assets.asset_dir()))
        self._mjcf_root.compiler.set_attributes(angle="radian", inertiagrouprange=[3, 5])
        self._add_defaults()
        self._add_meshes()
        self._add_arm()
        for side, sign, servo in zip(("left", "right"), (1, -1), calibration.fingers, strict=True):
            self._add_finger(side, sign, servo)
        self._mjcf_root.resolve_references()
        if not visuals:
            assets.remove_visuals(self._mjcf_root)

    def _build_observables(self) -> "FrankaObservables":
        return FrankaObservables(self)

    @property
    def mjcf_model(self) -> mjcf.RootElement:
        return self._mjcf_root

    @property
    def calibration(self) -> Calibration:
        """Which model of the Panda this is."""
        return self._calibration

    @property
    def servos(self) -> tuple[Servo, ...]:
        """The nine joints with their servos: the arm's from the base outwards, then the two fingers'."""
        return (*(link.servo for link in self._calibration.links), *self._calibration.fingers)

    @property
    def joints(self) -> tuple[mjcf.Element, ...]:
        """The nine joints in the order of `servos`."""
        return tuple(self._mjcf_root.find("joint", servo.joint) for servo in self.servos)

    @property
    def actuators(self) -> tuple[mjcf.Element, ...]:
        """The nine position actuators in the order of `servos`."""
        return tuple(self._mjcf_root.find("actuator", servo.joint) for servo in self.servos)

    @property
    def end_effector(self) -> mjcf.Element:
        """The site between the fingers."""
        return self._mjcf_root.find("site", "end_effector")

    def finger_geoms(self, side: str) -> tuple[mjcf.Element, ...]:
        """The colliding geoms of the `left` or the `right` finger."""
        body = self._mjcf_root.find("body", f"{side}_finger")
        return tuple(geom for geom in body.geom if not assets.is_visual(geom))

    def _add_defaults(self) -> None:
        top = self._mjcf_root.default
        visual = top.add("default", dclass="visual")
        visual.geom.set_attributes(group=1, contype=0, conaffinity=0, type="mesh", rgba=(0.95, 0.99, 0.92, 1), mass=0)
        link = top.add("default", dclass="link")
        link.geom.set_attributes(group=3, contype=1, conaffinity=1, type="mesh", rgba=(0.5, 0.6, 0.7, 1))
        # Conaffinity 0: fingers do not touch what is itself only touched (walls, counters touch them all the same).
        finger = top.add("default", dclass="finger")
        finger.geom.set_attributes(group=3, contype=1, conaffinity=0, condim=6, margin=0.001, rgba=(0.5, 0.6, 0.7, 0.4))
        finger.geom.set_attributes(friction=(1, 0.5, 0.0001), solref=(0.01, 1), solimp=(0.8, 0.9, 0.001))

    def _add_meshes(self) -> None:
        for part in (*(f"link{i}" for i in range(8)), "hand"):
            for kind in ("collision", "visual"):
                path = f"franka_assets/meshes/{kind}/{part}.stl"
                self._mjcf_root.asset.add("mesh", name=f"{part}_{kind}", file=path)
        self._mjcf_root.asset.add(
            "mesh", name="finger_visual", file="franka_assets/meshes/collision/finger.stl", scale=(1.75, 1, 1.75)
        )

    def _add_arm(self) -> None:
        calibration = self._calibration
        body = self._mjcf_root.worldbody.add("body", name="link0")
        self._add_part(body, "link0", calibration.base_mass)
        for number, link in enumerate(calibration.links, start=1):
            body = body.add("body", name=f"link{number}", pos=link.pos, **link.rotation)
            self._add_joint(body, link.servo, type="hinge", axis=(0, 0, 1))
            self._add_part(body, f"link{number}", link.mass)
        self._add_part(body, "hand", calibration.hand_mass, pos=_HAND_POS, quat=_HAND_QUAT)
        body.add(
            "site",
            name="end_effector",
            pos=calibration.end_effector_pos,
            euler=(0, 0, -0.785398),
            size=(0.01,),
            group=3,
        )
        # Beside the hand, above the fingers' plane, looking along the fingers.
        body.add("camera", name="wrist", pos=(0.06, -0.06, 0.09), xyaxes=(1, 1, 0, 0.64, -0.64, 0.427), fovy=75)

    def _add_finger(self, side: str, sign: int, servo: Servo) -> None:
        """Adds the finger that moves towards +y (`sign` 1) or -y (-1) of the hand."""
        link7 = self._mjcf_root.find("body", "link7")
        body = link7.add("body", name=f"{side}_finger", pos=self._calibration.finger_pos, quat=_HAND_QUAT)
        body.add(
            "inertial",
            pos=(sign * -1.57863e-05, sign * 0.0118731, 0.0434103),
            quat=(0.705868, sign * 0.0310348, sign * -0.0314925, 0.706962),
            mass=0.0927059,
            diaginertia=(6.57134e-05, 6.09611e-05, 1.09932e-05),
        )
        self._add_joint(body, servo, type="slide", axis=(0, sign, 0))
        facing = {} if sign > 0 else {"quat": (0, 0, 0, 1)}
        body.add("geom", name=f"{side}_finger_visual", dclass="visual", mesh="finger_visual", **facing)
        for number, (radius, near, far, z) in enumerate(_RUNGS):
            for letter, (start, end) in zip("ab", ((near, far), (far, near)), strict=True):
                ends = (_RUNG_HALF_WIDTH, sign * start, z, -_RUNG_HALF_WIDTH, sign * end, z)
                name = f"{side}_finger_rung_{number}{letter}"
                body.add("geom", name=name, dclass="finger", type="capsule", size=(radius,), fromto=ends)
        body.add(
            "geom",
            name=f"{side}_finger_box",
            dclass="finger",
            type="box",
            size=(0.0185, 0.012, 0.0175),
            pos=(0, sign * 0.014, 0.015),
            euler=(sign * 0.03, 0, 0),
        )

    def _add_part(self, body: mjcf.Element, part: str, mass: float, **pose: Sequence[float]) -> None:
        body.add("geom", name=f"{part}_visual", dclass="visual", mesh=f"{part}_visual", **pose)
        body.add("geom", name=part, dclass="link", mesh=f"{part}_collision", mass=mass, **pose)

    def _add_joint(self, body: mjcf.Element, servo: Servo, **kind: str | Sequence[float]) -> None:
        joint = body.add(
            "joint",
            name=servo.joint,
            range=servo.range,
            damping=servo.damping,
            armature=servo.armature,
            **kind,
        )
        self._mjcf_root.actuator.add(
            "position",
            name=servo.joint,
            joint=joint,
            kp=servo.gain,
            forcerange=(-servo.force, servo.force),
            ctrlrange=servo.control_range,
        )


class FrankaObservables(composer.Observables):
    """What the robot senses of itself; disabled by default."""

    @composer.observable
    def joint_positions(self) -> observable.MJCFFeature:
        """Positions of the joints: `(9,)` float64, 7 hinges [rad] and 2 fingers [m]; qpos; noise by task."""
        return observable.MJCFFeature("qpos", self._entity.joints)

    @composer.observable
    def joint_velocities(self) -> observable.MJCFFeature:
        """Velocities of the joints: `(9,)` float64, 7 hinges [rad/s] and 2 fingers [m/s]; qvel; noise by task."""
        return observable.MJCFFeature("qvel", self._entity.joints)

    @composer.observable
    def end_effector_position(self) -> observable.MJCFFeature:
        """Position of `end_effector` in the world: `(3,)` float64 [m]; site_xpos; no noise."""
        return observable.MJCFFeature("xpos", self._entity.end_effector)
