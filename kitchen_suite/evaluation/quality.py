"""How clean the episodes of an evaluation are, measured in environments with `quality=True`."""

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from kitchen_suite import suite
from kitchen_suite.episodes.spec import EnvironmentSpec

# Contact force on the arm without the hand up to which an episode is clean [N]. Chosen: the weight of 1 kg.
STRAY_FORCE = 10.0

# Name of the measure by which the protocol `clean` ranks policies.
CLEAN_SUCCESS = "clean_success"

# Infos whose values at the end of an episode are measures of it, in every domain, with their least possible values.
INFOS: Mapping[str, float] = MappingProxyType(
    {
        "objects_disturbed": 0.0,
        "stray_contacts": 0.0,
        "peak_arm_contact_force": 0.0,
        "peak_contact_force": 0.0,
        "mean_contact_force": 0.0,
        "energy": 0.0,
        "path_length": 0.0,
        "log_dimensionless_jerk": -math.inf,
    }
)


def is_clean(infos: Mapping[str, Any]) -> bool:
    """Returns whether an episode has disturbed nothing, and its arm without the hand has hit nothing.

    Args:
      infos: its last infos, arrays without leading axis.
    """
    return bool(infos["objects_disturbed"] == 0 and infos["peak_arm_contact_force"] <= STRAY_FORCE)


def least_values() -> dict[str, float]:
    """Returns the least possible values of the infos that are measures of episodes, by name, in any domain."""
    own = {name: least for domain in suite.DOMAINS.values() for name, least in domain.measures.items()}
    return {**own, **INFOS}


def measures(spec: EnvironmentSpec, success: bool, infos: Mapping[str, Any]) -> dict[str, bool | float]:
    """Returns the measures of an episode in an environment of a specification; none without `quality`.

    Args:
      spec: of the environment.
      success: of the episode.
      infos: its last infos, arrays without leading axis.
    """
    if not measured(spec):
        return {}
    return {CLEAN_SUCCESS: success and is_clean(infos), **{name: float(infos[name]) for name in _infos_of(spec)}}


def measured(spec: EnvironmentSpec) -> tuple[str, ...]:
    """Returns the names of the measures of episodes in environments of a specification; none without `quality`."""
    return (CLEAN_SUCCESS, *_infos_of(spec)) if spec.argument("quality") else ()


def _infos_of(spec: EnvironmentSpec) -> tuple[str, ...]:
    return (*INFOS, *suite.find_domain(spec.domain_name).measures)
