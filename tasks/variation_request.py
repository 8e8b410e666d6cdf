"""Requests for the variation of one reset: parameters that keep their defaults, and given values."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kitchen_suite import checks
from kitchen_suite.tasks.randomizer import Randomizer, Values
from kitchen_suite.tasks.varied import Varied


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
