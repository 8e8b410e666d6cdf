"""Domain randomisation of open_cabinet: cabinet pose, drawer resistance and pad friction, drawn at resets."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import mujoco
import numpy as np
from dm_control import mjcf
from dm_control.composer import variation
from dm_control.composer.variation import distributions
from numpy.typing import NDArray

from kitchen_suite import checks
from kitchen_suite.entities import OpenCabinetScene

# A composer variation or a constant.
Variation = Any

# Fields of MuJoCo's model that a `Randomizer` changes.
MODEL_FIELDS = ("body_pos", "body_quat", "dof_damping", "dof_frictionloss", "geom_friction")


def checked(values: Mapping[str, Any]) -> dict[str, NDArray[np.float64]]:
    """Returns values of a `Randomization`'s attributes, by name, as arrays.

    Raises:
      TypeError: one of them is not made of real numbers.
      ValueError: one of them has the wrong shape, is not finite, or is negative where it must not be.
    """
    return {name: _checked(name, value) for name, value in values.items()}


def _checked(name: str, value: Any) -> NDArray[np.float64]:
    what = f"randomization's {name}"
    if name == "cabinet_offset":
        return checks.vector(value, 3, what)
    array = checks.array_of(value, what)
    if array.shape:
        raise ValueError(f"{what} must be one number, got {value!r}")
    if name == "cabinet_yaw":
        return checks.vector(array[np.newaxis], 1, what)[0]
    return np.array(checks.number(array.item(), what))


def _is_constant(value: Variation) -> bool:
    parts = value if isinstance(value, list | tuple) else (value,)
    return not any(callable(part) for part in parts)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Randomization:
    """Parameters of the scene that are drawn at every reset.

    Each is a composer variation, a constant, or `None` for the scene as it was built. Constants are checked at once,
    values of variations at each reset. Friction and damping must not be negative.

    Attributes:
      cabinet_offset: `(3,)`, translation of the cabinet from its built position, in the world frame [m].
      cabinet_yaw: rotation of the cabinet about the vertical [rad].
      drawer_friction: dry friction of the drawer's slides [N].
      drawer_damping: damping of the drawer's slides [N s/m].
      pad_friction: coefficient of sliding friction of the finger pads; a contact has the greater one of pad and bar.
    """

    cabinet_offset: Variation | None = None
    cabinet_yaw: Variation | None = None
    drawer_friction: Variation | None = None
    drawer_damping: Variation | None = None
    pad_friction: Variation | None = None

    def __post_init__(self) -> None:
        wanted = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        checked({name: value for name, value in wanted.items() if value is not None and _is_constant(value)})


# A few centimetres and degrees, and resistances within about a third of the default ones.
MODERATE = Randomization(
    cabinet_offset=distributions.Uniform(low=(-0.03, -0.05, 0.0), high=(0.03, 0.05, 0.0)),
    cabinet_yaw=distributions.Uniform(low=-0.1, high=0.1),
    drawer_friction=distributions.Uniform(low=2.5, high=4.0),
    drawer_damping=distributions.Uniform(low=10.0, high=20.0),
    pad_friction=distributions.Uniform(low=1.2, high=1.8),
)


class Randomizer:
    """Applies a `Randomization` to a compiled scene; draws nothing for parameters that are `None`.

    Attributes:
      values: present values of the parameters that are drawn, by name; before the first reset, those of the built
        scene.
    """

    def __init__(
        self, scene: OpenCabinetScene, drawer: str, randomization: Randomization, physics: mjcf.Physics
    ) -> None:
        """Stores the values of the built scene; to be called before anything has been drawn."""
        self._physics = physics
        self._cabinet = scene.cabinet
        self._slide = physics.bind(scene.cabinet.drawer_joint(drawer))
        self._pads = [physics.bind(scene.robot.finger_geoms(side)[0]) for side in ("left", "right")]
        self._built_position = np.array(physics.bind(mjcf.get_attachment_frame(scene.cabinet.mjcf_model)).pos)
        built = {
            "cabinet_offset": np.zeros(3),
            "cabinet_yaw": np.zeros(()),
            "drawer_friction": self._slide.frictionloss[0],
            "drawer_damping": self._slide.damping[0],
            "pad_friction": self._pads[0].friction[0],
        }
        wanted = {name: getattr(randomization, name) for name in built}
        self._variations = {name: value for name, value in wanted.items() if value is not None}
        self._setters: dict[str, Callable[[NDArray[np.float64]], None]] = {
            "cabinet_offset": self._set_cabinet_offset,
            "cabinet_yaw": self._set_cabinet_yaw,
            "drawer_friction": self._set_drawer_friction,
            "drawer_damping": self._set_drawer_damping,
            "pad_friction": self._set_pad_friction,
        }
        self.values = {name: np.array(built[name]) for name in self._variations}

    def draw(self, random_state: np.random.RandomState) -> dict[str, NDArray[np.float64]]:
        """Returns new values, drawn in the order of `Randomization`'s attributes; sets nothing.

        Raises:
          TypeError: a variation returned something else than real numbers.
          ValueError: it returned the wrong shape, or numbers that are out of range.
        """
        return checked(
            {name: variation.evaluate(wanted, random_state=random_state) for name, wanted in self._variations.items()}
        )

    def set(self, values: Mapping[str, NDArray[np.float64]]) -> None:
        """Sets checked values, and updates the kinematics."""
        self.values = {name: np.array(value, np.float64) for name, value in values.items()}
        for name, value in self.values.items():
            self._setters[name](value)
        mujoco.mj_kinematics(self._physics.model.ptr, self._physics.data.ptr)

    def _set_cabinet_offset(self, offset: NDArray[np.float64]) -> None:
        self._cabinet.set_pose(self._physics, position=self._built_position + offset)

    def _set_cabinet_yaw(self, yaw: NDArray[np.float64]) -> None:
        self._cabinet.set_pose(self._physics, quaternion=(np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)))

    def _set_drawer_friction(self, friction: NDArray[np.float64]) -> None:
        self._slide.frictionloss = friction

    def _set_drawer_damping(self, damping: NDArray[np.float64]) -> None:
        self._slide.damping = damping

    def _set_pad_friction(self, friction: NDArray[np.float64]) -> None:
        for pad in self._pads:
            pad.friction[0] = friction
