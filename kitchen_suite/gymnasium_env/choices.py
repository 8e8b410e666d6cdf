"""Keyword arguments that all Gymnasium environments share, grouped by what they choose."""

import dataclasses
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from kitchen_suite.gymnasium_env.control import ControlSettings
from kitchen_suite.gymnasium_env.observations import ObservationSettings

# Classes whose attributes are keyword arguments of every environment.
CHOICES = (ObservationSettings, ControlSettings)

# Their values where they are omitted.
DEFAULTS: Mapping[str, Any] = MappingProxyType(
    {field.name: field.default for kind in CHOICES for field in dataclasses.fields(kind)}
)


def split_choices(choices: Mapping[str, Any]) -> tuple[ObservationSettings, ControlSettings]:
    """Returns what arguments choose of the observation and of the control mode; each is an attribute of `CHOICES`."""
    observation, control = (
        {field.name: choices[field.name] for field in dataclasses.fields(kind) if field.name in choices}
        for kind in CHOICES
    )
    return ObservationSettings(**observation), ControlSettings(**control)
