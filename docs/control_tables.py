"""The tables of the page on control modes: `CONTROL_TABLES`."""

import inspect
from collections.abc import Callable

import numpy as np
from benchmark_results import read_results
from dm_env import specs
from entity_tables import markdown
from scripts import tracking

from kitchen_suite.tasks.control_modes.modes import OFFSET_MODES
from kitchen_suite.tasks.kitchen.action import CONTROL_MODES as KITCHEN_MODES
from kitchen_suite.tasks.microwave_table.task import CONTROL_MODES as MICROWAVE_TABLE_MODES

_MODES = {"kitchen": KITCHEN_MODES, "open_cabinet": OFFSET_MODES, "microwave_table": MICROWAVE_TABLE_MODES}
# Elements by mode: the specs have the names of single joints.
_ELEMENTS = {
    "joint_velocity": "9 velocities, as a share of `velocity_scale`",
    "joint_offset": "7 offsets [rad], log odds of closing the gripper",
    "joint_position": "targets of the joints [rad] and of the fingers [m]",
    "joint_delta": "7 velocities, as a share of `joint_speed`; gripper",
    "ee_delta_position": "x, y, z, as a share of `linear_speed`; gripper",
    "ee_delta_pose": "x, y, z, as a share of `linear_speed`; rotation vector, as a share of `angular_speed`; gripper",
    "ee_pose": "x, y, z [m] and quaternion w, x, y, z in the frame of the base; gripper",
}


def mode_table() -> str:
    """Returns the table of all modes: size and bounds of the action by domain, and arguments with their defaults."""
    rows = []
    for mode, elements in _ELEMENTS.items():
        domains = [domain for domain, modes in _MODES.items() if mode in modes]
        found = {domain: tracking.load(domain, mode).action_spec() for domain in domains}
        sizes = [f"{domain} {spec.shape[0]}" for domain, spec in found.items()]
        same = len({spec.shape for spec in found.values()}) == 1
        parameters = inspect.signature(_MODES[domains[0]][mode]).parameters.values()
        arguments = [f"`{parameter.name}={parameter.default!r}`" for parameter in parameters]
        if mode == "joint_position":
            arguments = [f"{argument} (kitchen)" for argument in arguments]
        rows.append(
            (
                f"`{mode}`",
                "all" if len(domains) == len(_MODES) else ", ".join(domains),
                str(found[domains[0]].shape[0]) if same else ", ".join(sizes),
                elements,
                _bounds(found[domains[0]]),
                ", ".join(arguments),
            )
        )
    return markdown(("mode", "domains", "size", "action", "bounds", "arguments"), rows)


def _bounds(spec: specs.Array) -> str:
    if not isinstance(spec, specs.BoundedArray):
        return "none"
    is_unit = np.all(spec.minimum == -1.0) and np.all(spec.maximum == 1.0)
    return "[-1, 1]" if is_unit else "joint limits"


def tracking_table() -> str:
    """Returns the table of drift and lines, from the result of `docs/control_modes.py tracking`."""
    rows = [
        (
            row["domain"],
            f"`{row['control_mode']}`",
            f"{1e3 * row['drift']:.2f}",
            f"{row['turn']:.2f}",
            *(f"{1e3 * row[key]:.1f}" if key in row else "" for key in ("lateral", "shortfall")),
            f"{row['rotation']:.2f}" if "rotation" in row else "",
        )
        for row in read_results("control_modes_tracking")
    ]
    header = ("domain", "mode", "drift [mm]", "drift [°]", "off the line [mm]", "short of its end [mm]", "rotation [°]")
    return markdown(header, rows)


def speed_table() -> str:
    """Returns the table of speeds, from the result of `docs/control_modes.py speed`."""
    rows = [
        (f"`{row['control_mode']}`", f"{row['median']:.2f}", "{:.2f} to {:.2f}".format(*row["quartiles"]))
        for row in read_results("control_modes_speed")
    ]
    return markdown(("mode", "speed relative to `joint_velocity`", "quartiles"), rows)


CONTROL_TABLES: dict[str, Callable[[], str]] = {
    "control_modes": mode_table,
    "control_modes_tracking": tracking_table,
    "control_modes_speed": speed_table,
}
