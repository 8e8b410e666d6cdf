"""Objects that scenes are furnished with."""

from collections.abc import Sequence

import numpy as np
from dm_control import composer, mjcf
from numpy.typing import ArrayLike, NDArray

from kitchen_suite.entities import assets
from kitchen_suite.entities.joints import JointObservables
from kitchen_suite.entities.parameters import (
    FREE_DISPLACEMENT,
    MASS,
    Elements,
    Parameter,
    ParameterType,
    built_position,
    displacement,
    door_parameters,
    pose_parameters,
)


class Prop(assets.NamedEntity):
    """An object with a fixed list of joints.

    Attributes:
      free: whether scenes attach it with a free joint.
      is_tuned: whether the physics of scenes without free objects is tuned to it, so that it needs no other options.
    """

    free = False
    is_tuned = False

    @property
    def joints(self) -> tuple[mjcf.Element, ...]:
        """The joints, in the order in which scenes observe them; none unless a prop says otherwise."""
        return ()

    def _build_observables(self) -> composer.Observables:
        return JointObservables(self) if self.joints else super()._build_observables()

    @property
    def handles(self) -> tuple[mjcf.Element, ...]:
        """The sites at its handles, knobs and switches."""
        return tuple(self.mjcf_model.find_all("site", exclude_attachments=True))


class KitchenProp(Prop):
    """An object with a fixed list of joints, described by one MJCF file.

    Attributes:
      xml_name: name of the MJCF file without its ending.
      joint_names: its joints, in the order in which scenes observe them.
      movable: whether its parameters include its pose.
    """

    xml_name: str
    joint_names: Sequence[str] = ()
    movable = False

    def _build(self, *, visuals: bool = True, name: str | None = None) -> None:
        """Loads the prop's MJCF; `name`, its own when omitted, is the prefix of the prop's elements in a scene.

        Without `visuals` it has no visual geoms; the physics stays the same to the bit.
        """
        self._mjcf_root = assets.load_mjcf(self.xml_name, visuals=visuals)
        self._mjcf_root.model = name or self.xml_name

    @property
    def joints(self) -> tuple[mjcf.Element, ...]:
        return tuple(self._mjcf_root.find("joint", name) for name in self.joint_names)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Offset and yaw of a movable prop in a scene."""
        return pose_parameters(self) if self.movable and self.parent else ()


class Counter(KitchenProp):
    """The L-shaped counter with drawers, sink and faucet; without joints."""

    xml_name = "counter"


class Walls(KitchenProp):
    """The back wall and the left wall."""

    xml_name = "walls"


class Oven(KitchenProp):
    """The oven with four knobs and four burners; a knob's angle [rad] is 174 times its burner's travel [m]."""

    xml_name = "oven"
    joint_names = (
        *("knob_Joint_1", "bottom_right_burner", "knob_Joint_2", "bottom_left_burner"),
        *("knob_Joint_3", "top_right_burner", "knob_Joint_4", "top_left_burner"),
    )

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Displacement of the knobs at the start, with the burners; factor of the knobs' damping."""
        owner = self.mjcf_model.model
        knobs, burners = self.joints[::2], self.joints[1::2]
        return (
            displacement(f"{owner}/knobs", knobs, followers=burners, ratio=1 / 174),
            door_parameters(owner, knobs)[0],
        )


class Hood(KitchenProp):
    """The hood with the light switch; the switch's angle [rad] is 14 times the lamp's travel [m]."""

    xml_name = "hood"
    movable = True
    joint_names = ("light_switch", "light_joint")

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Offset and yaw; displacement of the switch at the start, with the lamp; factors of its resistances."""
        owner = self.mjcf_model.model
        switch, lamp = self.joints
        return (
            *super().parameters,
            displacement(f"{owner}/switch", (switch,), followers=(lamp,), ratio=1 / 14),
            *door_parameters(owner, (switch,)),
        )


class Cupboard(KitchenProp):
    """An object with one or two doors, which may stand elsewhere."""

    movable = True

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Offset and yaw; displacement of the doors at the start; factors of their damping and friction."""
        owner, count = self.mjcf_model.model, len(self.joints)
        doors = displacement(f"{owner}/{'door' if count == 1 else 'doors'}", self.joints)
        return (*super().parameters, doors, *door_parameters(owner, self.joints))


class SlideCabinet(Cupboard):
    """The cabinet whose door slides to the right."""

    xml_name = "slide_cabinet"
    joint_names = ("slide_cabinet",)


class HingeCabinet(Cupboard):
    """The cabinet with a left and a right hinged door."""

    xml_name = "hinge_cabinet"
    joint_names = ("left_hinge_cabinet", "right_hinge_cabinet")


class Microwave(Cupboard):
    """The microwave, its door hinged on the left."""

    xml_name = "microwave"
    joint_names = ("microwave",)


# Number of each burner as value of the parameter; on the first one the kettle stands by default.
BURNERS = ("bottom_left", "bottom_right", "top_right", "top_left")

# Displacement of the kettle from the first burner to each of them [m]: the differences between the positions of the
# burners in `xml/oven.xml`.
BURNER_DISPLACEMENTS = np.array([(0.0, 0.0, 0.0), (0.446, 0.0, 0.0), (0.444, 0.441, 0.0), (0.003, 0.441, 0.0)])


def _read_burner(physics: mjcf.Physics, joints: Elements) -> ArrayLike:
    (joint,) = joints
    moved = physics.bind(joint).qpos[:3] - built_position(joint.parent)
    return np.argmin(np.linalg.norm(BURNER_DISPLACEMENTS - moved, axis=1))


def _write_burner(physics: mjcf.Physics, joints: Elements, value: NDArray[np.float64]) -> None:
    (joint,) = joints
    physics.bind(joint).qpos[:3] += BURNER_DISPLACEMENTS[int(value)]


# The burner on which a free object stands; writing it moves the object from the first burner.
BURNER = ParameterType(read=_read_burner, write=_write_burner, model_fields=(), choices=len(BURNERS))


class FreeProp(KitchenProp):
    """An object that moves freely; `composer.Arena.add_free_entity` or a scene adds its free joint."""

    free = True

    @property
    def joints(self) -> tuple[mjcf.Element, ...]:
        """The free joint that the arena added: 7 positions, 6 velocities. Empty while it is not attached."""
        freejoint = mjcf.get_frame_freejoint(self._mjcf_root) if self.parent else None
        return () if freejoint is None else (freejoint,)

    def _build_observables(self) -> JointObservables:
        return JointObservables(self)


class Kettle(FreeProp):
    """The kettle, with its handle on top."""

    xml_name = "kettle"
    is_tuned = True
    joint_names = ("kettle",)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Displacement at the start: x, y and rotation about the vertical; the burner at the start; mass.

        None while it is not attached.
        """
        if not self.joints:
            return ()
        owner, body = self.mjcf_model.model, self.mjcf_model.find("body", "kettle")
        return (
            Parameter(name=f"{owner}/pose", unit="m, m, rad", type=FREE_DISPLACEMENT, elements=self.joints),
            Parameter(name=f"{owner}/burner", unit="index", type=BURNER, elements=self.joints),
            Parameter(name=f"{owner}/mass", unit="kg", type=MASS, elements=(body,)),
        )
