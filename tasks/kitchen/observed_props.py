"""The table of the kitchen's observed props: start and noise of each joint.

Starts and amplitudes are those of the reference, which has the amplitudes from a table for another scene, hence no
pattern.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from kitchen_suite.entities.joints import joint_types
from kitchen_suite.entities.props import Prop


class ObservedJoint(NamedTuple):
    """A joint of a prop whose positions and velocities are observed.

    Attributes:
      name: of the joint in the prop's own model; a free joint, which has none, is called as its prop.
      start: its positions at the start of an episode [rad or m; a free joint: m and a quaternion w, x, y, z].
      position_noise: greatest noise of each position at a noise ratio of 1, in its unit.
      velocity_noise: greatest noise of each velocity at a noise ratio of 1 [rad/s or m/s].
    """

    name: str
    start: tuple[float, ...]
    position_noise: tuple[float, ...]
    velocity_noise: tuple[float, ...]

    @property
    def sizes(self) -> tuple[int, int, int]:
        """Numbers of the elements of start and noise."""
        return len(self.start), len(self.position_noise), len(self.velocity_noise)


# Those of a joint of a type; all others have one position and one velocity.
_SIZES = {"free": (7, 7, 6)}


def _joint(name: str, start: float, *, position_noise: float, velocity_noise: float) -> ObservedJoint:
    """Returns a hinge or a slide."""
    return ObservedJoint(name, (start,), (position_noise,), (velocity_noise,))


OBSERVED_PROPS: Mapping[str, tuple[ObservedJoint, ...]] = MappingProxyType(
    {
        "oven": (
            _joint("knob_Joint_1", -0.00026627985, position_noise=0.1, velocity_noise=0.005),
            _joint("bottom_right_burner", -5.18043486e-05, position_noise=0.005, velocity_noise=0.005),
            _joint("knob_Joint_2", 3.1287722e-05, position_noise=0.005, velocity_noise=0.005),
            _joint("bottom_left_burner", -4.51199853e-05, position_noise=0.0005, velocity_noise=0.005),
            _joint("knob_Joint_3", -3.90842156e-06, position_noise=0.0005, velocity_noise=0.005),
            _joint("top_right_burner", -4.22629655e-05, position_noise=0.0005, velocity_noise=0.005),
            _joint("knob_Joint_4", 6.28065475e-05, position_noise=0.0005, velocity_noise=0.005),
            _joint("top_left_burner", 4.04984708e-05, position_noise=0.0005, velocity_noise=0.005),
        ),
        "hood": (
            _joint("light_switch", 0.000462730939, position_noise=0.0005, velocity_noise=0.005),
            _joint("light_joint", -0.000226906415, position_noise=0.005, velocity_noise=0.005),
        ),
        "slide_cabinet": (_joint("slide_cabinet", -0.000465501369, position_noise=0.005, velocity_noise=0.005),),
        "hinge_cabinet": (
            _joint("left_hinge_cabinet", -0.00644129196, position_noise=0.005, velocity_noise=0.1),
            _joint("right_hinge_cabinet", -0.00177048263, position_noise=0.1, velocity_noise=0.1),
        ),
        "microwave": (_joint("microwave", 0.00108009684, position_noise=0.1, velocity_noise=0.1),),
        "kettle": (
            ObservedJoint(
                "kettle",
                start=(
                    *(-0.26939744, 0.350383255, 1.61944683),
                    *(1.00618764, 0.0040639512, -0.00662095997, -0.000268278933),
                ),
                position_noise=(0.1, 0.005, 0.005, 0.005, 0.1, 0.1, 0.1),
                velocity_noise=(0.005, 0.005, 0.005, 0.1, 0.1, 0.1),
            ),
        ),
    }
)
"""The joints of each prop with joints, by the prop's name: props and joints in the order in which they are observed."""

_JOINTS = tuple(joint for joints in OBSERVED_PROPS.values() for joint in joints)

# Of all joints, end to end; see `ObservedJoint`.
OBJECT_STARTS = tuple(number for joint in _JOINTS for number in joint.start)
POSITION_NOISE = tuple(number for joint in _JOINTS for number in joint.position_noise)
VELOCITY_NOISE = tuple(number for joint in _JOINTS for number in joint.velocity_noise)


def check_observed(props: Mapping[str, Prop]) -> None:
    """Raises a ValueError, which names the prop, unless the table has the joints of a scene's props, in their order."""
    observed = {name: prop for name, prop in props.items() if prop.joints}
    for name, prop in observed.items():
        table = {joint.name: joint.sizes for joint in OBSERVED_PROPS.get(name, ())}
        kinds = zip(prop.joints, joint_types(prop.joints), strict=True)
        joints = {joint.name or name: _SIZES.get(kind, (1, 1, 1)) for joint, kind in kinds}
        if [*table.items()] != [*joints.items()]:
            raise ValueError(
                f"OBSERVED_PROPS of {__name__} must have the joints of prop {name!r}, with the numbers of their "
                f"starts, noises of positions and noises of velocities: {joints}, got {table}"
            )
    if tuple(observed) != tuple(OBSERVED_PROPS):
        names = tuple(OBSERVED_PROPS)
        raise ValueError(f"the kitchen's props with joints must be {names}, in this order, got {tuple(observed)}")
