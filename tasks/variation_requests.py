"""Requests for the variation of one reset: names and values of parameters."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.tasks.randomizer import Values


@dataclasses.dataclass(frozen=True, kw_only=True)
class VariationRequest:
    """A request for the variation of one reset.

    Attributes:
      names: of the parameters that are drawn; the others have their defaults. All are drawn when None.
      values: values that replace those drawn or default.
    """

    names: frozenset[str] | None = None
    values: Mapping[str, NDArray[np.float64]] = dataclasses.field(default_factory=dict)

    def applied(self, drawn: Values, defaults: Mapping[str, NDArray[np.float64]]) -> Values:
        """Returns the values of a reset, given those drawn and the defaults of all parameters."""
        chosen = {name: drawn[name] if self.draws(name) else defaults[name] for name in drawn}
        return {**chosen, **self.values}

    def draws(self, name: str) -> bool:
        """Whether a parameter has the value drawn for it."""
        return name not in self.values and (self.names is None or name in self.names)


def flat_values(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Returns the leaves of nested dicts by their path, the parts of which are joined by `/`."""
    if not isinstance(values, Mapping):
        raise TypeError(f"variation_values must be a dict, got {values!r}")
    flat: dict[str, Any] = {}
    for name, value in values.items():
        flat |= flat_values(value, f"{prefix}{name}/") if isinstance(value, Mapping) else {f"{prefix}{name}": value}
    return flat
