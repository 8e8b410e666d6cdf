"""Control modes by name, built from the arguments of tasks."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

from kitchen_suite import checks, signatures
from kitchen_suite.tasks.control_modes.action_mode import ActionMode
from kitchen_suite.tasks.control_modes.end_effector import (
    EndEffectorDeltaPose,
    EndEffectorDeltaPosition,
    EndEffectorPose,
)
from kitchen_suite.tasks.control_modes.joints import JointDelta, JointOffset, JointPosition

# Modes that every domain has.
SHARED_MODES: Mapping[str, Callable[..., ActionMode]] = MappingProxyType(
    {
        "joint_delta": JointDelta,
        "ee_delta_position": EndEffectorDeltaPosition,
        "ee_delta_pose": EndEffectorDeltaPose,
        "ee_pose": EndEffectorPose,
    }
)

# Modes of the domains with the cabinet's control; the first is the default.
OFFSET_MODES: Mapping[str, Callable[..., ActionMode]] = MappingProxyType(
    {"joint_offset": JointOffset, "joint_position": JointPosition, **SHARED_MODES}
)


def split_options(
    options: Mapping[str, Any], modes: Mapping[str, Callable[..., ActionMode]]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Returns the options that are arguments of any of the modes, and the others."""
    names = signatures.names(*modes.values())
    control = {name: value for name, value in options.items() if name in names}
    return control, {name: value for name, value in options.items() if name not in names}


def make_mode(name: str, modes: Mapping[str, Callable[..., ActionMode]], options: Mapping[str, Any]) -> ActionMode:
    """Builds the control mode of a name with options of its class; those that are None count as omitted.

    Raises:
      TypeError: no mode has such an argument.
      ValueError: the name is unknown, or an argument belongs to other modes.
    """
    make = modes[checks.choice(name, modes.keys(), "control_mode")]
    checks.keywords(options, signatures.names(*modes.values()), what="argument")
    given = {option: value for option, value in options.items() if value is not None}
    for option in given:
        owners = [mode for mode, each in modes.items() if option in signatures.names(each)]
        if name not in owners:
            raise ValueError(f"{option} is an argument of control_mode {' and '.join(owners)}, not of {name!r}")
    return make(**given)


def names_for_any_robot(modes: Mapping[str, Callable[..., ActionMode]]) -> list[str]:
    """Returns the names of the classes of modes that move other arms than the Franka as well."""
    classes = {name: mode for name, mode in modes.items() if isinstance(mode, type) and issubclass(mode, ActionMode)}
    return [name for name, mode in classes.items() if mode.suits_any_robot]
