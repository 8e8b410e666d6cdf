"""Draws parameters of a scene at resets, and sets them."""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Self

import mujoco
import numpy as np
from dm_control import mjcf
from dm_control.composer import variation
from numpy.typing import NDArray

from kitchen_suite import checks
from kitchen_suite.entities.parameters import Parameter
from kitchen_suite.tasks.variations import distributions
from kitchen_suite.tasks.variations.distributions import Variation, Varied

# Fields of MuJoCo's model that `mj_setConst` computes from masses, inertias and poses.
DERIVED_FIELDS = (
    "body_subtreemass",
    "body_invweight0",
    "dof_invweight0",
    "dof_M0",
    "tendon_length0",
    "tendon_invweight0",
    "actuator_length0",
    "actuator_acc0",
)

Values = dict[str, NDArray[np.float64]]


class Randomizer:
    """Draws the wanted parameters and sets them in a physics; with none wanted, it draws and sets nothing.

    Attributes:
      values: present values of the wanted parameters by name; before the first reset, those of the built scene.
      defaults: values of the built scene by name.
    """

    values: Mapping[str, NDArray[np.float64]]
    defaults: Mapping[str, NDArray[np.float64]]

    def __init__(
        self,
        parameters: Mapping[str, Parameter],
        wanted: Mapping[str, Variation],
        *,
        owner: str = "randomization",
        ranges: Mapping[str, tuple[NDArray, NDArray]] = MappingProxyType({}),
    ) -> None:
        """Selects the wanted parameters; `bind` must be called before anything is set.

        Args:
          parameters: all that the scene offers, by name, in the order in which values are drawn.
          wanted: variations by name; None leaves a parameter as it was built.
          owner: of the parameters' names, for messages.
          ranges: least and greatest values by name; draws outside are moved to the nearest value within.

        Raises:
          TypeError: a constant is not made of real numbers.
          ValueError: there is no such parameter, or a constant has the wrong shape or is out of range.
        """
        for name in wanted:
            checks.choice(name, parameters.keys(), f"{owner}'s parameter")
        self._parameters = {name: each for name, each in parameters.items() if wanted.get(name) is not None}
        self._variations = {name: wanted[name] for name in self._parameters}
        self._labels = {name: f"{owner}'s {name}" for name in self._parameters}
        self._ranges = dict(ranges)
        self.values, self.defaults = {}, {}
        quantities = {name: parameter.quantity for name, parameter in self._parameters.items()}
        distributions.check_constants(self._variations, quantities, owner)
        self._fitting = {
            name
            for name, each in self._variations.items()
            if distributions.draws_fit(each, quantities[name], self._labels[name])
        }

    def add(self, other: Self) -> None:
        """Adds the parameters of another randomizer, to be drawn and set after the present ones.

        Raises:
          ValueError: both have the same parameter.
        """
        own = {parameter.name: self._labels[name] for name, parameter in self._parameters.items()}
        for name, parameter in other._parameters.items():
            if parameter.name in own:
                raise ValueError(f"{parameter.name} varies twice: by {own[parameter.name]} and {other._labels[name]}")
        self._parameters |= other._parameters
        self._variations |= other._variations
        self._labels |= other._labels
        self._ranges |= other._ranges
        self._fitting |= other._fitting

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the wanted parameters, in the order in which they are drawn."""
        return tuple(self._parameters)

    @property
    def model_fields(self) -> tuple[str, ...]:
        """Fields of MuJoCo's model that a reset may change and on which the physics of an episode depends."""
        physical = [each.quantity for each in self._parameters.values() if not each.quantity.visual]
        derived = DERIVED_FIELDS if any(quantity.derived for quantity in physical) else ()
        return _union((*(quantity.model_fields for quantity in physical), derived))

    @property
    def displacements(self) -> tuple[str, ...]:
        """Names of the parameters that change no field of the model."""
        return tuple(name for name, parameter in self._parameters.items() if not parameter.quantity.model_fields)

    @property
    def visual_fields(self) -> tuple[str, ...]:
        """Further fields of MuJoCo's model that a reset may change, on which only images depend."""
        quantities = (parameter.quantity for parameter in self._parameters.values())
        return _union(quantity.model_fields for quantity in quantities if quantity.visual)

    def bind(self, physics: mjcf.Physics) -> None:
        """Makes `set` change a physics, which must have the values of the built scene."""
        if not self._parameters:
            return
        self._physics, model = physics, physics.model.ptr
        is_derived = any(parameter.quantity.derived for parameter in self._parameters.values())
        self._scratch = mujoco.MjData(model) if is_derived else None
        fields = (field for field in (*self.model_fields, *self.visual_fields) if field not in DERIVED_FIELDS)
        self._built = {field: np.array(getattr(model, field)) for field in fields}
        self.defaults = {name: parameter.get(physics) for name, parameter in self._parameters.items()}
        self.values = dict(self.defaults)

    def draw(self, random_state: np.random.RandomState) -> Values:
        """Returns new values, drawn in the order of the parameters; sets nothing.

        Raises:
          TypeError: a variation returned something other than real numbers.
          ValueError: it returned the wrong shape, or numbers that are out of range.
        """
        drawn = {name: _evaluated(each, random_state) for name, each in self._variations.items()}
        drawn |= {name: np.clip(drawn[name], *bounds) for name, bounds in self._ranges.items()}
        return drawn | self.checked({name: value for name, value in drawn.items() if name not in self._fitting})

    def checked(self, values: Mapping[str, NDArray]) -> Values:
        """Returns values of the wanted parameters that `set` accepts; raises as `draw`."""
        return {
            name: self._parameters[name].quantity.checked(value, self._labels[name]) for name, value in values.items()
        }

    def set(self, values: Mapping[str, NDArray[np.float64]]) -> None:
        """Sets checked values of all wanted parameters in the scene as it was built, and updates the kinematics."""
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


@dataclasses.dataclass(frozen=True, kw_only=True)
class VariationRequest:
    """The variation that one reset is asked for.

    Attributes:
      excluded: parameters that are not drawn, but have their defaults.
      values: values that replace those drawn or default.
    """

    excluded: frozenset[str] = frozenset()
    values: Mapping[str, NDArray[np.float64]] = dataclasses.field(default_factory=dict)

    def applied(self, drawn: Values, defaults: Mapping[str, NDArray[np.float64]]) -> Values:
        """Returns the values of a reset, given those drawn and the defaults of all parameters."""
        chosen = {name: defaults[name] if name in self.excluded else drawn[name] for name in drawn}
        return {**chosen, **self.values}

    def draws(self, name: str) -> bool:
        """Whether a parameter has the value drawn."""
        return name not in self.values and name not in self.excluded


def make_request(
    wanted: Mapping[str, Varied],
    randomizer: Randomizer,
    names: str | Sequence[str] | None,
    values: Mapping[str, Any] | None,
) -> VariationRequest:
    """Returns the checked request for a reset of a task.

    Args:
      wanted: parameters that vary in the task, by name.
      randomizer: of the task.
      names: parameters and groups that are drawn; the other ones of `wanted` have their defaults. All when None.
      values: values of parameters by name, or in nested dicts by the parts of the names.

    Raises:
      TypeError: an argument of the wrong type.
      ValueError: an unknown name, or a value of the wrong shape or outside the parameter's range.
    """
    if (names or values) and not wanted:
        raise ValueError("nothing varies: build the environment with variations")
    flat = flat_values(values or {})
    for name in flat:
        checks.choice(name, wanted, "parameter of variation_values")
    checked = randomizer.checked(flat)
    for name, value in checked.items():
        wanted[name].check(value)
    excluded = set() if names is None else wanted.keys() - _chosen(wanted, names)
    return VariationRequest(excluded=frozenset(excluded), values=checked)


def group_names(value: str | Sequence[str], what: str) -> tuple[object, ...]:
    """Returns names that are alone, in a sequence, or joined by commas; `what` is for messages.

    Raises:
      TypeError: the value is no sequence of names.
      ValueError: a name is repeated.
    """
    if isinstance(value, list | tuple) and not value:
        return ()
    return checks.unique_names(value.split(",") if isinstance(value, str) else value, what)


def flat_values(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Returns the leaves of nested dicts by their path, the parts of which are joined by `/`."""
    if not isinstance(values, Mapping):
        raise TypeError(f"variation_values must be a dict, got {values!r}")
    flat: dict[str, Any] = {}
    for name, value in values.items():
        flat |= flat_values(value, f"{prefix}{name}/") if isinstance(value, Mapping) else {f"{prefix}{name}": value}
    return flat


def _chosen(wanted: Mapping[str, Varied], names: str | Sequence[str]) -> set[str]:
    """Returns the names of wanted parameters that names of parameters and groups stand for."""
    choices = {name: [name] for name in wanted}
    for name, varied in wanted.items():
        choices.setdefault(varied.group, []).append(name)
    each = (checks.choice(name, choices, "variation") for name in group_names(names, "variation"))
    return {name for one in each for name in choices[one]}
