"""The tables of what can be observed: observation types, extra observables, cameras."""

import itertools
from collections.abc import Callable
from types import MappingProxyType

from entity_tables import markdown
from gymnasium import spaces

from kitchen_suite import suite
from kitchen_suite.tasks.observables import offered

# What each camera is for; those of the robot are the same in all domains.
_PURPOSES = MappingProxyType(
    {
        "workspace": "knobs, switch, doors, kettle and burners in small pictures; default of the kitchen",
        "overview": "robot and furniture; default of open_cabinet and microwave_table; the kitchen's is the original's",
        "handle": "close-up of the handles and the gripper",
        "left": "from the left",
        "right": "from the right",
        "franka/hand": "finger tips and what is between them",
        "franka/wrist": "view along the fingers of earlier versions, which shows the hand; kept for compatibility",
        "left_cap": "number 0 of FrankaKitchen-v1, which shows the counter; kept for compatibility",
        "right_cap": "number 1 of FrankaKitchen-v1, which shows the counter; kept for compatibility",
    }
)


def type_table() -> str:
    """Returns the table of the observation types with their spaces by domain."""
    rows = []
    for name, record in suite.DOMAINS.items():
        env_class = record.resolve("env")
        for obs_type in env_class.obs_types:
            env = env_class(obs_type=obs_type, **({"goal_format": "flat"} if obs_type == "goal" else {}))
            default = " (default)" if obs_type == env_class.obs_types[0] else ""
            rows.append((f"`{name}`", f"`{obs_type}`{default}", describe(env.observation_space)))
    return markdown(("domain", "`obs_type`", "observation"), rows)


def describe(space: spaces.Space) -> str:
    """Returns keys, types and shapes of a space."""
    if isinstance(space, spaces.Dict):
        return ", ".join(f"`{key}`: {describe(part)}" for key, part in space.items())
    return f"{space.dtype} {space.shape}"


def extra_table() -> str:
    """Returns the table of the extra observables by domain."""
    rows = []
    for name in suite.DOMAINS:
        scene = suite.load(name, suite.default_task(name), {"visuals": False}).task.scene
        for key, extra in offered(scene).items():
            part = "`agent_pos`" if extra.of_robot else "`environment_state`"
            rows.append((f"`{key}`", name, extra.size, extra.content, part))
    by_key = itertools.groupby(sorted(rows, key=lambda row: (row[4], row[0])), key=lambda row: (row[0], *row[2:]))
    merged = [(key, ", ".join(f"`{row[1]}`" for row in group), *rest) for (key, *rest), group in by_key]
    return markdown(("name", "domains", "elements", "content", "part"), merged)


def camera_table() -> str:
    """Returns the table of the cameras by domain."""
    tasks = {name: suite.load(name, suite.default_task(name), {"visuals": False}).task for name in suite.DOMAINS}
    names = {
        name: {camera.full_identifier for camera in task.root_entity.mjcf_model.find_all("camera")}
        for name, task in tasks.items()
    }
    rows = [
        (f"`{camera}`", ", ".join(f"`{domain}`" for domain, present in names.items() if camera in present), purpose)
        for camera, purpose in _PURPOSES.items()
    ]
    unknown = {camera for present in names.values() for camera in present} - {*_PURPOSES}
    if unknown:
        raise ValueError(f"cameras without a purpose: {sorted(unknown)}")
    return markdown(("camera", "domains", "content"), rows)


OBSERVATION_TABLES: MappingProxyType[str, Callable[[], str]] = MappingProxyType(
    {"observation_types": type_table, "extra_observables": extra_table, "cameras": camera_table}
)
