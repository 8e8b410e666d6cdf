"""Keyword arguments that all Gymnasium environments share, grouped by what they choose."""

import dataclasses
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from kitchen_suite.gymnasium_env.control import ControlSettings
from kitchen_suite.gymnasium_env.observations import ObservationSettings
from kitchen_suite.gymnasium_env.varied import VariationSettings

# Classes whose attributes are keyword arguments of every environment.
CHOICES = (ObservationSettings, ControlSettings, VariationSettings)

# Their values where they are omitted.
DEFAULTS: Mapping[str, Any] = MappingProxyType(
    {field.name: field.default for kind in CHOICES for field in dataclasses.fields(kind)}
)


def split_choices(choices: Mapping[str, Any]) -> tuple[ObservationSettings, ControlSettings, VariationSettings]:
    """Returns what arguments choose of observation, control mode and variations; each is an attribute of `CHOICES`."""
    observation, control, variation = (
        {field.name: choices[field.name] for field in dataclasses.fields(kind) if field.name in choices}
        for kind in CHOICES
    )
    return ObservationSettings(**observation), ControlSettings(**control), VariationSettings(**variation)
