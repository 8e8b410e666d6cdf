"""Draws parameters of a scene at resets, and sets them."""

import dataclasses
from collections.abc import Iterable, Mapping
from typing import Any

import mujoco
import numpy as np
from dm_control import mjcf
from dm_control.composer import variation
from numpy.typing import NDArray

from kitchen_suite.entities.parameters import Parameter
from kitchen_suite.tasks.variations import distributions
from kitchen_suite.tasks.variations.distributions import Variation
from kitchen_suite.types import Array

# Fields of MuJoCo's model that `mj_setConst` computes from masses, inertias and poses: also those that depend on poses
# alone, which other parameters may have set.
DERIVED_FIELDS = (
    "body_subtreemass",
    "body_invweight0",
    "dof_invweight0",
    "dof_M0",
    "dof_length",
    "cam_poscom0",
    "cam_pos0",
    "cam_mat0",
    "light_poscom0",
    "light_pos0",
    "light_dir0",
    "eq_data",
    "tendon_length0",
    "tendon_invweight0",
    "actuator_length0",
    "actuator_acc0",
)

Values = dict[str, Array]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Draw:
    """A parameter, and the variation that draws its value at a reset.

    Attributes:
      parameter: of the scene or the task.
      variation: a composer variation, a constant, or a list of these for the elements of a vector.
      bounds: least and greatest value; draws outside are moved to the nearest value within. None for no bounds.
    """

    parameter: Parameter
    variation: Variation
    bounds: tuple[Array, Array] | None = None


class Randomizer:
    """Draws parameters and sets them in a physics; without parameters, it draws and sets nothing.

    Attributes:
      values: current values by name of the parameter; before the first reset, those of the built scene.
      defaults: values of the built scene by name.
    """

    values: Mapping[str, Array]
    defaults: Mapping[str, Array]

    def __init__(self, physics: mjcf.Physics, draws: Iterable[Draw]) -> None:
        """Reads the values of the built scene.

        Args:
          physics: the compiled scene, with the values of the built one.
          draws: of the parameters, in the order in which they are drawn; none occurs twice.
        """
        self._draws = {draw.parameter.name: draw for draw in draws}
        self._parameters = {name: draw.parameter for name, draw in self._draws.items()}
        self._fitting = {
            name
            for name, draw in self._draws.items()
            if distributions.draws_fit(draw.variation, draw.parameter.type, f"variation's {name}")
        }
        self._physics = physics
        model = physics.model.ptr
        is_derived = any(parameter.type.derived for parameter in self._parameters.values())
        self._scratch = mujoco.MjData(model) if is_derived else None
        fields = (field for field in (*self.model_fields, *self.visual_fields) if field not in DERIVED_FIELDS)
        self._built = {field: np.array(getattr(model, field)) for field in fields}
        self.defaults = {name: parameter.get(physics) for name, parameter in self._parameters.items()}
        self.values = dict(self.defaults)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, in the order in which they are drawn."""
        return tuple(self._parameters)

    @property
    def model_fields(self) -> tuple[str, ...]:
        """Fields of MuJoCo's model that a reset may change and on which the physics of an episode depends."""
        types = [each.type for each in self._parameters.values() if not each.type.visual]
        derived = DERIVED_FIELDS if any(each.derived for each in types) else ()
        return _union((*(each.model_fields for each in types), derived))

    @property
    def displacements(self) -> tuple[str, ...]:
        """Names of the parameters that change no field of the model."""
        return tuple(name for name, parameter in self._parameters.items() if not parameter.type.model_fields)

    @property
    def visual_fields(self) -> tuple[str, ...]:
        """Further fields of MuJoCo's model that a reset may change, on which only images depend."""
        return _union(each.type.model_fields for each in self._parameters.values() if each.type.visual)

    def draw(self, random_state: np.random.RandomState) -> Values:
        """Returns new values, drawn in the order of the parameters; sets nothing.

        Raises a TypeError or a ValueError if a variation returned something that its parameter does not take.
        """
        drawn = {name: _evaluated(draw.variation, random_state) for name, draw in self._draws.items()}
        drawn |= {name: np.clip(drawn[name], *draw.bounds) for name, draw in self._draws.items() if draw.bounds}
        return drawn | self.checked({name: value for name, value in drawn.items() if name not in self._fitting})

    def checked(self, values: Mapping[str, NDArray]) -> Values:
        """Returns values of parameters that `set` accepts; raises as `draw`."""
        return {
            name: self._parameters[name].type.checked(value, f"variation's {name}") for name, value in values.items()
        }

    def set(self, values: Mapping[str, Array]) -> None:
        """Sets checked values of all parameters in the scene as it was built, and updates the kinematics."""
        if not self._parameters:
            return
        model = self._physics.model.ptr
        for field, built in self._built.items():
            getattr(model, field)[:] = built
        self.values = {name: np.array(values[name], np.float64) for name in self._parameters}
        for name, value in self.values.items():
            self._parameters[name].set(self._physics, value)
        if self._scratch:
            # `mj_setConst` moves the data that it computes with to the model's default pose.
            mujoco.mj_setConst(model, self._scratch)
        mujoco.mj_kinematics(model, self._physics.data.ptr)


def _evaluated(each: Variation, random_state: np.random.RandomState) -> Any:
    # `evaluate` is for nested structures, and ten times as slow.
    if isinstance(each, variation.Variation):
        return each(random_state=random_state)
    return variation.evaluate(each, random_state=random_state)


def _union(groups: Iterable[Iterable[str]]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(field for group in groups for field in group))
