"""The tables of the pages that are made from the code: tasks, spaces, parameters and their defaults.

python docs/scripts/tables.py   rewrites the tables between their markers in the pages below docs/

It needs the extra `train`, of whose hyperparameters there are tables.

`result_tables.py` has the tables of measurements.
"""

import collections
import dataclasses
import enum
import functools
import inspect
import itertools
import json
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, get_args

import gymnasium
import msgspec
import numpy as np
from dm_control import composer, mjcf
from gymnasium import spaces
from numpy.typing import NDArray
from result_tables import RESULT_TABLES, markdown

from kitchen_suite import entities, suite
from kitchen_suite.domains.arguments import Argument, Owner
from kitchen_suite.entities import KITCHEN_FRANKA, PANDA, Robot
from kitchen_suite.entities.appearance import Surface
from kitchen_suite.entities.fixture_designs import KINDS, FixtureDesign
from kitchen_suite.entities.fixtures import PART_KINDS
from kitchen_suite.entities.kitchen_styles import STYLES
from kitchen_suite.entities.object_layouts import MAX_OBJECTS, MAX_PLACES, OBJECT_KINDS
from kitchen_suite.entities.objects import OBJECTS
from kitchen_suite.entities.places import PLACE_KINDS
from kitchen_suite.entities.props import BURNERS
from kitchen_suite.evaluation.protocols import PROTOCOLS, Condition, Protocol, domain_protocols
from kitchen_suite.tasks import DEFAULT_TASKS, GOALS
from kitchen_suite.tasks.episode.extra_observables import offered
from kitchen_suite.tasks.episode.noise_and_delay import NoiseAndDelay
from kitchen_suite.tasks.episode.pushes import Pushes
from kitchen_suite.tasks.generated_kitchens import mdp as kitchens
from kitchen_suite.tasks.generated_kitchens import slots
from kitchen_suite.tasks.kitchen import observation
from kitchen_suite.tasks.kitchen.variations import DONE, done_parameter
from kitchen_suite.tasks.microwave_table.task import GOAL as MICROWAVE_GOAL
from kitchen_suite.tasks.open_cabinet import observation as drawer_observation
from kitchen_suite.tasks.open_cabinet import rewards as drawer_reward
from kitchen_suite.tasks.open_cabinet.task import INSTRUCTIONS as DRAWER_INSTRUCTIONS
from kitchen_suite.tasks.pick_and_place import mdp as objects
from kitchen_suite.tasks.variations import appearance, distributions
from kitchen_suite.tasks.variations.distributions import GROUPS, Bands, Choice, Distribution
from kitchen_suite.training.recipes import ranges

DOCS = Path(__file__).resolve().parent.parent
_MARKED = re.compile(r"(<!-- table: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)


def with_tables(page: str) -> str:
    """Returns a page with its tables regenerated."""
    return _MARKED.sub(lambda match: f"{match[1]}\n{TABLES[match[2]]()}\n{match[3]}", page)


def first_line(documented: object) -> str:
    """Returns the first line of a docstring, with the bars escaped for a cell of a table."""
    return (inspect.getdoc(documented) or "").splitlines()[0].replace("|", "\\|")


def attributes(documented: type) -> dict[str, str]:
    """Returns the names and texts of the section `Attributes` of a docstring."""
    return entries_of(documented, "Attributes")


def entries_of(documented: object, heading: str) -> dict[str, str]:
    """Returns the names and texts of a section of a docstring."""
    text = inspect.getdoc(documented) or ""
    section = text.partition(f"{heading}:\n")[2].partition("\n\n")[0]
    entries = re.findall(r"^ {2}(\w+): (.*(?:\n {4,}.*)*)", section, re.MULTILINE)
    return {name: re.sub(r"\s+", " ", text) for name, text in entries}


def code_list(names: Iterable[str]) -> str:
    """Returns names in a cell of a table."""
    return ", ".join(f"`{name}`" for name in names)


def numbers(values: Iterable[float]) -> str:
    """Returns numbers as text, with at most four decimals."""
    return ", ".join(f"{round(value, 4) + 0.0:g}" for value in values)


# Tasks.


def task_table(domain: str) -> str:
    """Returns the table of a domain's tasks."""
    record = suite.DOMAINS[domain]
    rows = [
        (f"`{task}`", arguments_text(arguments), f"`{record.task_ids[task]}`", record.episode_steps)
        for task, arguments in record.tasks.items()
    ]
    return markdown(("task", "arguments", "Gymnasium id", "control steps"), rows)


def arguments_text(arguments: Mapping[str, object]) -> str:
    """Returns arguments as text, such as `drawer`: top."""
    values = {
        name: ", ".join(map(str, value)) if isinstance(value, tuple) else value for name, value in arguments.items()
    }
    return "; ".join(f"`{name}`: {value}" for name, value in values.items())


def set_table() -> str:
    """Returns the table of the kitchen's tasks that ask for several goals; those that draw them share a row."""
    record = suite.DOMAINS["kitchen"]
    rows, drawn = [], []
    for task, arguments in record.tasks.items():
        goals = arguments["tasks_to_complete"]
        if "tasks_per_episode" in arguments:
            drawn.append(task)
        elif len(goals) > 1:
            names = "the first seven below" if goals == DEFAULT_TASKS else ", ".join(goals)
            rows.append((f"`{task}`", names, f"`{record.task_ids[task]}`"))
    first, last = drawn[0], drawn[-1]
    ids = f"`{record.task_ids[first]}` to `{record.task_ids[last]}`"
    rows.append((f"`{first}` to `{last}`", "as many of the first seven, drawn at each reset", ids))
    return markdown(("task", "goals", "Gymnasium id"), rows)


def goal_table() -> str:
    """Returns the table of the goals of the kitchen, with the ranges of their joints."""
    environment = suite.load("kitchen", "all", {"visuals": False})
    environment.reset()
    kitchen, rows = environment.task.scene, []
    for task, goal in GOALS.items():
        elements = [9 + element for element in goal.elements_in(kitchen)]
        places = f"{elements[0]}-{elements[-1]}" if len(elements) > 1 else str(elements[0])
        joints = [joint for joint in goal.joints_in(kitchen) if joint.tag == "joint"]
        ranges = environment.physics.bind(joints).range if joints else ()
        bounds = ", ".join(f"{low:.2f} to {high:.2f}" for low, high in ranges)
        rows.append((f"`{task}`", places, numbers(goal.value), numbers(goal.start or ()), bounds or "free"))
    return markdown(("task", "qpos", "goal", "start", "range of the joints"), rows)


# Arguments.

# Pages that docstrings name.
_NAMED_PAGE = re.compile(r"docs/(guide|domains)/(\w+)\.md")


def argument_rows(domain: str) -> list[tuple[str, ...]]:
    """Returns the rows of all arguments of a domain's environments."""
    record = suite.DOMAINS[domain]
    found = {
        "make": record.arguments(record.env_class),
        "make_vec": record.arguments(record.vector_env_class, record.env_class),
        "load": record.arguments(),
    }
    arguments = {name: argument for table in reversed(found.values()) for name, argument in table.items()}
    rows = []
    for name, argument in sorted(arguments.items(), key=lambda item: (get_args(Owner).index(item[1].owner), item[0])):
        fronts = [front for front, table in found.items() if name in table]
        rows.append(
            (
                f"`{name}`",
                argument.owner,
                "all" if len(fronts) == len(found) else code_list(fronts),
                default_of_modes(record, name) if argument.owner == "control" else default_text(argument.default),
                meaning_of(name, argument),
            )
        )
    return rows


def default_of_modes(record: suite.Domain, name: str) -> str:
    """Returns the default of an argument of a domain's control modes, which is the same in all that have it."""
    parameters = [inspect.signature(mode).parameters for mode in record.resolve("task").control_modes.values()]
    (default,) = {each[name].default for each in parameters if name in each}
    return default_text(default)


def default_text(default: object) -> str:
    """Returns the default of an argument as text."""
    if default is None:
        return "none"
    return f"`{default.value if isinstance(default, enum.Enum) else default!r}`"


def meaning_of(name: str, argument: Argument) -> str:
    """Returns the first sentence on an argument, of the innermost function whose docstring describes it.

    Pages that it names are links, from a page of the guide.
    """
    for taker in reversed(argument.takers):
        function = taker.func if isinstance(taker, functools.partial) else taker
        texts = entries_of(function.__init__ if isinstance(function, type) else function, "Args")
        if name in texts:
            sentence = texts[name].partition(". ")[0].removesuffix(".").replace("|", "\\|")
            return _NAMED_PAGE.sub(_link, sentence)
    raise KeyError(f"no docstring describes the argument {name!r}")


def _link(page: re.Match[str]) -> str:
    """Returns a link from a page of the guide to one that a docstring names."""
    folder, name = page.groups()
    return f"[{name.replace('_', ' ')}]({'' if folder == 'guide' else f'../{folder}/'}{name}.md)"


def argument_table(domain: str | None = None) -> str:
    """Returns the table of the arguments that all domains have, or of the other arguments of one domain."""
    rows = {name: argument_rows(name) for name in suite.DOMAINS}
    shared = [row for row in next(iter(rows.values())) if all(row in others for others in rows.values())]
    chosen = shared if domain is None else [row for row in rows[domain] if row not in shared]
    return markdown(("argument", "belongs to", "taken by", "default", "meaning"), chosen)


# Pictures of tasks that have no picture of their own.
_OTHER_PICTURES = {"partial": "expert_complete.jpg", "open": "microwave_table.jpg"}

_INSTRUCTIONS = {
    **{name.replace(" ", "_"): goal.instructions[0] for name, goal in GOALS.items()},
    **{f"{drawer}_drawer": instructions[0] for drawer, instructions in DRAWER_INSTRUCTIONS.items()},
    "open": MICROWAVE_GOAL.instructions[0],
}


def gallery(domain: str) -> str:
    """Returns the gallery of a domain's tasks, those that are drawn at each reset left out."""
    return '<div class="gallery" markdown>\n\n' + "\n\n".join(_entries(domain)) + "\n\n</div>\n"


def _entries(domain: str) -> Iterator[str]:
    record = suite.DOMAINS[domain]
    for task, arguments in record.tasks.items():
        picture = _OTHER_PICTURES.get(task, f"expert_{task}.jpg")
        if "tasks_per_episode" not in arguments:
            asked = _INSTRUCTIONS.get(task) or "; ".join(arguments["tasks_to_complete"])
            title = f"### {task}\n\n{asked[0].upper()}{asked[1:]}. `{record.task_ids[task]}`"
            yield f"<div markdown>\n\n{title}\n\n[![{asked}](../pictures/{picture})]({domain}.md)\n\n</div>"


# Generated kitchens.


def fixture_table() -> str:
    """Returns the table of the kinds of fixtures of generated kitchens."""
    rows = []
    for name, kind in KINDS.items():
        values = _option_values(kind)
        most = {option: allowed[-1] for option, allowed in values.items()}
        if most.get("count") == 2:
            del most["hinge"]
        parts = kind(**most).build(STYLES["oak"], visuals=False, name=name).parts
        words = ", ".join(dict.fromkeys(part.kind for part in parts))
        options = "; ".join(f"`{option}` {_values(allowed)}" for option, allowed in values.items())
        count = f"1 to {len(parts)}" if "count" in values else len(parts)
        rows.append((f"`{name}`", f"`{kind.level}`", options or "none", f"{words}, {count}"))
    return markdown(("kind", "level", "options", "parts that move"), rows)


def _option_values(kind: type[FixtureDesign]) -> dict[str, Sequence[Any]]:
    """Returns the bounds of each number of a kind's designs [m], its possible counts, and the choices of the others."""
    values: dict[str, Sequence[Any]] = {}
    for field in msgspec.inspect.type_info(kind).fields:
        match field.type:
            case msgspec.inspect.FloatType(ge=low, le=high) if field.name != "gap":
                values[field.name] = (low, high)
            case msgspec.inspect.IntType(ge=low, le=high):
                values[field.name] = range(low, high + 1)
            case msgspec.inspect.LiteralType(values=choices):
                values[field.name] = choices
            case msgspec.inspect.UnionType(types=(msgspec.inspect.LiteralType(values=choices), _)):
                values[field.name] = choices
    return values


def _values(values: Sequence[Any]) -> str:
    """Returns the bounds of a number [m], or the choices, as text."""
    if isinstance(values[0], float):
        return f"{values[0]:g} to {values[-1]:g} m"
    return f"{', '.join(map(str, values[:-1]))} or {values[-1]}"


# What the parts of the observation of generated kitchens, and of its slots, hold.
_KITCHENS_CONTENT = {
    "joint_positions": "arm [rad] and fingers [m], ±1 mrad or mm",
    "joint_velocities": "their velocities [rad/s, m/s], ±1 mrad/s or mm/s",
    "hand_pose": "position of the hand [m], and the first two columns of its rotation matrix",
    "slots": f"{kitchens.MAX_PARTS} slots of {slots.SLOT_SIZE} numbers",
}
_SLOT_CONTENT = {
    "kind": f"1 for its kind, 0 for the others: {', '.join(PART_KINDS)}",
    "position": "of the handle [m], ±2 mm",
    "offset": "from the hand to the handle [m], with the same noise",
    "into": "direction into the fixture, which turns with a door",
    "along": "direction along the handle's bar",
    "opening": "0 closed or off, 1 wide open or on, ±0.005",
    "goal": "opening that is requested, 0 or 1; 0 for parts that are not",
    "requested": "whether the episode asks for it, 0 or 1",
}


# What the parts of the observation of kitchens with objects, and of its objects and places, hold.
_OBJECTS_CONTENT = {
    **_KITCHENS_CONTENT,
    "objects": f"{MAX_OBJECTS} slots of {objects.OBJECT_SIZE} numbers",
    "places": f"{MAX_PLACES} slots of {objects.PLACE_SIZE} numbers",
    "slots": f"{_KITCHENS_CONTENT['slots']}, of parts that open, as in generated kitchens",
}
_OBJECT_CONTENT = {
    "kind": f"1 for its kind, 0 for the others: {', '.join(OBJECT_KINDS)}",
    "position": "of the middle of its box [m], ±2 mm",
    "offset": "from the hand to it [m], with the same noise",
    "x_axis": "direction of its x axis, in which the handle of a mug and the long side of a carton point",
    "z_axis": "direction of its z axis, up where it stands",
    "half_size": "of its box, along its own axes [m]",
    "requested": "whether the episode asks for it, 0 or 1",
    "goal_kind": f"of the place where it is to be, 0 without one: {', '.join(PLACE_KINDS)}",
    "goal_position": "middle of this place's support [m], which moves with a drawer",
    "goal_half_size": "of this place, along the world's axes [m]",
}
_PLACE_CONTENT = {
    "kind": f"1 for its kind, 0 for the others: {', '.join(PLACE_KINDS)}",
    "position": "middle of its support [m], which moves with a drawer",
    "half_size": "along the world's axes [m]",
}


def object_table() -> str:
    """Returns the table of the objects that stand in kitchens: size, mass, and what the hand grasps."""
    rows = []
    for name, kind in OBJECTS.items():
        made = kind(visuals=False)
        physics = mjcf.Physics.from_mjcf_model(made.mjcf_model)
        size = " x ".join(f"{1e3 * length:.0f}" for length in np.subtract(*made.bounds[::-1]))
        rows.append((f"`{name}`", size, f"{1e3 * float(physics.bind(made.body).mass):.0f}", _GRASPED[name]))
    return markdown(("object", "box around it [mm]", "mass [g]", "grasped, from above"), rows)


_GRASPED = {"can": "around it", "carton": "across its 35 mm", "mug": "by its handle", "bottle": "by its neck"}


def part_table(parts: Mapping[str, slice], contents: Mapping[str, str]) -> str:
    """Returns the table of the parts of an observation."""
    rows = [(span(part.start, part.stop - 1), f"`{name}`", contents[name]) for name, part in parts.items()]
    return markdown(("index", "key", "content"), rows)


# Specs, spaces and observations.


def id_table() -> str:
    """Returns the table of the Gymnasium ids."""
    rows = [
        (f"`{name}`", f"`{record.env_id}`", f"`{next(iter(record.task_ids.values()))}`", len(record.task_ids))
        for name, record in suite.DOMAINS.items()
    ]
    return markdown(("domain", "id for any of its tasks", "id of its first task", "ids of tasks"), rows)


_UNITS = {"hinge": "rad", "slide": "m", None: "rad"}
_FREE_POSITIONS = [(part, "m") for part in "xyz"] + [(f"q{part}", "1") for part in "wxyz"]
_FREE_VELOCITIES = [(f"v{part}", "m/s") for part in "xyz"] + [(f"ω{part} in its own frame", "rad/s") for part in "xyz"]


def joint_elements(joint: mjcf.Element, *, velocity: bool) -> list[tuple[str, str]]:
    """Returns the name and unit of each element of the observation that belongs to a joint."""
    if joint.tag == "freejoint":
        prefix = joint.parent.full_identifier.strip("/")
        return [(f"{prefix} {part}", unit) for part, unit in (_FREE_VELOCITIES if velocity else _FREE_POSITIONS)]
    kind = joint.type or (joint.dclass and joint.dclass.joint.type)
    return [(joint.name, _UNITS[kind] + ("/s" if velocity else ""))]


def observation_table() -> str:
    """Returns the table of the 59 elements of the kitchen's observation; neighbours that are alike share a row."""
    kitchen = suite.load("kitchen", "all", {"visuals": False}).task.scene
    noise_scale = observation.noise_scale(robot_ratio=0.01, object_ratio=0.0005)
    parts = (
        ("franka/joint_positions", kitchen.robot.joints, False),
        ("franka/joint_velocities", kitchen.robot.joints, True),
        ("object_positions", kitchen.object_joints, False),
        ("object_velocities", kitchen.object_joints, True),
    )
    elements = [
        (key, *element)
        for key, joints, velocity in parts
        for joint in joints
        for element in joint_elements(joint, velocity=velocity)
    ]
    numbered = [
        (number, name, (key, unit, f"±{size:.3g}"))
        for number, ((key, name, unit), size) in enumerate(zip(elements, noise_scale, strict=True))
    ]
    rows = []
    for (key, unit, size), group in itertools.groupby(numbered, key=lambda row: row[2]):
        indices, names, _ = zip(*group, strict=True)
        rows.append((span(indices[0], indices[-1]), f"`{key}`", ", ".join(names), unit, size))
    return markdown(("index", "key", "elements", "unit", "noise by default"), rows)


def span(first: int, last: int) -> str:
    """Returns the text of a range of indices."""
    return str(first) if first == last else f"{first}-{last}"


def cabinet_observation_table() -> str:
    """Returns the table of the parts of open_cabinet's observation."""
    rows = []
    for name, compute in drawer_observation.QUANTITIES.items():
        part = drawer_observation.SLICES[name]
        rows.append((span(part.start, part.stop - 1), f"`{name}`", first_line(compute).split(": ", 1)[1]))
    return markdown(("index", "key", "content"), rows)


# What each camera is for; those of the robot are the same in all domains.
_PURPOSES = {
    "workspace": "knobs, switch, doors, kettle and burners in small images; default of all kitchens",
    "overview": "robot and furniture; default of open_cabinet and microwave_table; the kitchen's is the original's",
    "handle": "close-up of the handles and the gripper",
    "left": "from the left",
    "right": "from the right",
    "franka/hand": "finger tips and what is between them",
    "franka/wrist": "view along the fingers, which shows the hand",
    "left_cap": "number 0 of FrankaKitchen-v1, which shows the counter; kept for compatibility",
    "right_cap": "number 1 of FrankaKitchen-v1, which shows the counter; kept for compatibility",
}


def observation_type_table() -> str:
    """Returns the table of the observation types with their spaces by domain."""
    rows = []
    for name, record in suite.DOMAINS.items():
        env_class = record.env_class
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
    """Returns the table of the extra observables; those of the same domains and content share a row.

    Those of what a generated kitchen happens to have are left out.
    """
    found = collections.defaultdict(list)
    for name in suite.DOMAINS:
        scene = suite.load(name, suite.default_task(name), {"visuals": False}).task.scene
        of_kitchen = {each.name for each in scene.design.placed} if isinstance(scene, entities.GeneratedKitchen) else ()
        if isinstance(scene, entities.PickAndPlaceKitchen):
            of_kitchen = {*of_kitchen, *scene.layout.names}
        for key, extra in offered(scene).items():
            if key.partition("/")[0] in of_kitchen:
                continue
            part = "`agent_pos`" if extra.of_robot else "`environment_state`"
            found[part, key, extra.size, extra.content].append(name)
    names = collections.defaultdict(list)
    for (part, key, size, content), domains in sorted(found.items()):
        where = "all" if len(domains) == len(suite.DOMAINS) else ", ".join(domains)
        names[part, where, size, content].append(f"`{key}`")
    rows = [(", ".join(keys), where, size, content, part) for (part, where, size, content), keys in names.items()]
    return markdown(("names", "domains", "elements", "content", "part"), rows)


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


_MODES = {name: domain.resolve("task").control_modes for name, domain in suite.DOMAINS.items()}
# Elements by mode: the specs have the names of single joints.
_ELEMENTS = {
    "joint_velocity": "9 velocities, as a fraction of `velocity_scale`",
    "joint_offset": "7 offsets [rad], log odds of closing the gripper",
    "joint_position": "targets of the joints [rad] and of the fingers [m]",
    "joint_delta": "7 velocities, as a fraction of `joint_speed`; gripper",
    "ee_delta_position": "x, y, z, as a fraction of `linear_speed`; gripper",
    "ee_delta_pose": "x, y, z, as a fraction of `linear_speed`; rotation vector, of `angular_speed`; gripper",
    "ee_pose": "x, y, z [m] and quaternion w, x, y, z in the frame of the base; gripper",
}


def control_mode_table() -> str:
    """Returns the table of all modes: size and bounds of the action by domain, and arguments with their defaults."""
    rows = []
    for mode, elements in _ELEMENTS.items():
        domains = [domain for domain, modes in _MODES.items() if mode in modes]
        found = {
            domain: gymnasium.make(suite.DOMAINS[domain].env_id, control_mode=mode).action_space for domain in domains
        }
        sizes = [f"{domain} {spec.shape[0]}" for domain, spec in found.items()]
        same = len({spec.shape for spec in found.values()}) == 1
        rows.append(
            (
                f"`{mode}`",
                "all" if len(domains) == len(_MODES) else ", ".join(domains),
                str(found[domains[0]].shape[0]) if same else ", ".join(sizes),
                elements,
                bounds_by_domain(found),
                ", ".join(mode_arguments(mode, domains)),
            )
        )
    return markdown(("mode", "domains", "size", "action", "bounds", "arguments"), rows)


def mode_arguments(mode: str, domains: Sequence[str]) -> list[str]:
    """Returns the arguments of a mode with their defaults, with the names of the domains where not all have these."""
    owners = collections.defaultdict(list)
    for domain in domains:
        for parameter in inspect.signature(_MODES[domain][mode]).parameters.values():
            owners[f"`{parameter.name}={parameter.default!r}`"].append(domain)
    return [text if len(having) == len(domains) else f"{text} ({', '.join(having)})" for text, having in owners.items()]


def bounds_by_domain(found: Mapping[str, spaces.Box]) -> str:
    """Returns the bounds of actions as text; by domain where they differ."""
    texts = {domain: action_bounds(space) for domain, space in found.items()}
    if len({*texts.values()}) == 1:
        return texts[next(iter(texts))]
    return ", ".join(f"{domain} {text}" for domain, text in texts.items())


def action_bounds(space: spaces.Box) -> str:
    """Returns the bounds of an action as text."""
    if not space.is_bounded():
        return "none"
    is_unit = np.all(space.low == -1.0) and np.all(space.high == 1.0)
    return "[-1, 1]" if is_unit else "joint limits"


# Rewards, scenes and their parameters.


def cabinet_reward_table() -> str:
    """Returns the table of the terms of open_cabinet's original reward."""
    rows = [
        (i, f"`{name}`", first_line(getattr(drawer_reward, name)))
        for i, name in enumerate(drawer_reward.REWARDS["original"], 1)
    ]
    return markdown(("term", "name", "value"), rows)


def cabinet_grasp_reward_table() -> str:
    """Returns the table of the terms in which the grasp reward differs from the original one."""
    own = {
        "orientation": drawer_reward.grasp_orientation,
        "grasp": drawer_reward.grip_closing,
        "opening": drawer_reward.grasp_opening,
    }
    rows = [
        (1 + [*drawer_reward.REWARDS["original"]].index(name), f"`{name}`", first_line(term))
        for name, term in own.items()
    ]
    return markdown(("term", "name", "value"), rows)


# Classes that are not built by calling them without arguments.
_NOT_ALONE = (Robot, entities.GraspedObject, entities.KitchenProp, entities.Prop, entities.SiteArena)


def builders() -> dict[str, Callable[[], composer.Entity]]:
    """Returns what builds each entity, by the expression that does so: the robots, the props, the domains' arenas."""
    public = (getattr(entities, name) for name in entities.__all__)
    kinds = [each for each in public if isinstance(each, type) and issubclass(each, composer.Entity)]
    tasks = (suite.load(domain, suite.default_task(domain), {"visuals": False}).task for domain in suite.DOMAINS)
    kinds += [type(task.root_entity) for task in tasks]
    robots = {"Robot(PANDA)": lambda: Robot(PANDA), "Robot(KITCHEN_FRANKA)": lambda: Robot(KITCHEN_FRANKA)}
    return robots | {f"{kind.__name__}()": kind for kind in kinds if kind not in _NOT_ALONE}


def joint_table() -> str:
    """Returns the table of all joints, with the ranges of a compiled model."""
    rows = []
    for name, build in builders().items():
        entity = build()
        joints = entity.mjcf_model.find_all("joint")
        physics = mjcf.Physics.from_mjcf_model(entity.mjcf_model)
        rows += [(f"`{name}`", f"`{joint.name}`", *joint_cells(physics, joint)) for joint in joints]
        if getattr(entity, "free", False):
            rows.append((f"`{name}`", "free joint, added when it is attached", "free", "none"))
    return markdown(("entity", "joint", "type", "range"), rows)


def joint_cells(physics: mjcf.Physics, joint: mjcf.Element) -> tuple[str, str]:
    """Returns the type of a slide or hinge, and its range with the unit."""
    kind, unit = ("slide", "m") if physics.bind(joint).type == 2 else ("hinge", "rad")
    low, high = physics.bind(joint).range
    return kind, f"{low:.4g} to {high:.4g} {unit}" if physics.bind(joint).limited else "none"


# Variations.


def distribution_table() -> str:
    """Returns the table of the distributions that JSON describes, with their arguments."""
    rows = [(f"`{name}`", ", ".join(each.arguments)) for name, each in distributions.DISTRIBUTIONS.items()]
    return markdown(("distribution", "arguments"), [*rows, ("`choice`", "the values, each with the same probability")])


# Parameters that exist only where observations have noise.
_NOISY = {"open_cabinet": {"observation_noise": {"handle_offset": 0.01}}}
_PALETTES = {name: each for name, each in vars(appearance).items() if isinstance(each, appearance.Palette)}


def parameter_rows(domain: str) -> dict[str, tuple[str, ...]]:
    """Returns group, unit, default, seen and held-out values of the parameters that a domain's groups vary, by name."""
    options = {"visuals": False, **_NOISY.get(domain, {})}
    present = {row.group for row in suite.DOMAINS[domain].resolve("task").varied}
    groups = [group for group in GROUPS if group in present]
    task = suite.load(domain, suite.default_task(domain), options | {"variations": groups}).task
    own = (*NoiseAndDelay(task.mdp, task.robot).parameters, *Pushes.parameters)
    units = {each.name: each.unit for each in (*task.scene.parameters, *own)}
    if DONE in task.variations.by_name:
        units[DONE] = done_parameter(task.scene, dict).unit
    return {
        name: (
            variation.group,
            units[name],
            _number_or_vector(task.variations.randomizer.defaults[name]),
            *(
                _described(task.scene.arena.surfaces, name, task.variations.randomizer.defaults[name], each)
                for each in (variation.seen, variation.held_out)
            ),
        )
        for name, variation in task.variations.by_name.items()
    }


def parameter_table(groups: Sequence[str]) -> str:
    """Returns the table of the parameters that some groups vary; equal ones of several domains share a row."""
    domains = collections.defaultdict(list)
    for domain in suite.DOMAINS:
        for name, row in parameter_rows(domain).items():
            if row[0] in groups:
                domains[name, row].append(domain)
    names = collections.defaultdict(list)
    for (name, row), found in domains.items():
        where = "" if len(found) == len(suite.DOMAINS) else ", ".join(found)
        names[where, *row].append(f"`{name}`")
    rows = sorted(names, key=lambda row: GROUPS.index(row[1]))
    header = ("parameter", "domain", "group", "unit", "default", "seen", "held out")
    return markdown(header, [(", ".join(names[row]), *row) for row in rows])


# Longer lists of values are of consecutive integers.
_MOST_LISTED = 20


def _described(surfaces: Sequence[Surface], name: str, default: NDArray[np.float64], distribution: Distribution) -> str:
    if isinstance(distribution, Bands):
        return _bands(distribution.intervals, default)
    assert isinstance(distribution, Choice)
    if name.endswith("color"):
        return _colors(distribution.values)
    labels = _labels(surfaces, name)
    if len(distribution.values) > _MOST_LISTED:
        low, high = distribution.values[[0, -1]]
        return f"integers from {low:g} to {high:g}"
    numbers = (f"{value:g}" for value in distribution.values)
    return ", ".join(f"{number} {labels[int(number)]}" if labels else number for number in numbers)


def _labels(surfaces: Sequence[Surface], name: str) -> Sequence[str]:
    """Returns meanings of the values of a parameter that is an index; none of other parameters."""
    textures = {f"{surface.prefix}texture": surface.textures for surface in surfaces}
    if name in textures:
        return ["as built", *(texture.name.replace("_", " ") for texture in textures[name])]
    return [burner.replace("_", " ") for burner in BURNERS] if name == "kettle/burner" else []


def _colors(values: NDArray[np.float64]) -> str:
    for name, palette in _PALETTES.items():
        for colors in (palette.seen, palette.held_out):
            shades = len(values) // len(colors)
            if len(values) == shades * len(colors) and np.allclose(values[shades - 1 :: shades], colors):
                return f"{len(colors)} of `{name}`"
    raise ValueError(f"no palette has the colours {values.tolist()}")


def _bands(bands: NDArray[np.float64], default: NDArray[np.float64]) -> str:
    """Returns the text of intervals `(k, 2)` or `(k, 2, n)`; of a vector, one text where all elements share it."""
    if not default.shape:
        return _intervals(bands, float(default))
    texts = [_intervals(bands[:, :, i], value) for i, value in enumerate(default)]
    return _vector(texts)


def _intervals(bands: NDArray[np.float64], default: float) -> str:
    """Returns the text of intervals `(k, 2)` of one number."""
    if (bands[:, 0] == bands[:, 1]).all():
        values, counts = np.unique(bands[:, 0], return_counts=True)
        shares = [f"{value:g} ({100 * count / len(bands):.0f} %)" for value, count in zip(values, counts, strict=True)]
        return " or ".join(shares) if len(shares) > 1 else f"{values[0]:g}"
    intervals = np.unique(bands, axis=0)
    offsets = intervals - default
    middle = "" if default == 0 else f"{default:.5g} "
    if np.allclose(offsets, -offsets[::-1, ::-1]):
        low, high = np.abs(offsets[-1])
        return f"{middle}± {high:.3g}" if len(intervals) == 1 else f"{middle}± ({low:.3g} to {high:.3g})"
    return " or ".join(f"{low:.5g} to {high:.5g}" for low, high in intervals)


def _number_or_vector(value: NDArray[np.float64]) -> str:
    return _vector([f"{each:.5g}" for each in value]) if value.shape else f"{value:.5g}"


def _vector(texts: Sequence[str]) -> str:
    return f"{len(texts)} times {texts[0]}" if len({*texts}) == 1 else f"({', '.join(texts)})"


# Training and evaluation.


def hyperparameter_table() -> str:
    """Returns the table of the hyperparameters with their defaults."""
    from kitchen_suite.training.ppo import PPOHyperparameters

    meanings = attributes(PPOHyperparameters)
    intervals = ranges(PPOHyperparameters)
    defaults = {domain: PPOHyperparameters.for_domain(domain) for domain in suite.DOMAINS}
    rows = [
        (
            f"`{each.name}`",
            meanings[each.name],
            f"`{intervals[each.name]}`",
            *(format_value(getattr(values, each.name)) for values in defaults.values()),
        )
        for each in dataclasses.fields(PPOHyperparameters)
    ]
    return markdown(("name", "meaning", "range", *(f"`{domain}`" for domain in defaults)), rows)


def format_value(value: object) -> str:
    """Returns the text of a number or a tuple of numbers; a tuple of equal numbers as their count and value."""
    if not isinstance(value, tuple):
        return f"{value:g}"
    if not value:
        return "by control mode"
    if len(set(value)) == 1 and len(value) > 2:
        return f"{len(value)} times {value[0]:g}"
    return ", ".join(f"{part:g}" for part in value)


def preset_table() -> str:
    """Returns the table of the sets of demonstrations of all domains."""
    rows = [
        (f"`{name}`", domain.name, f"`{preset['task_name']}`", _preset_arguments(preset), f"`{preset['policy']}`")
        for domain in suite.DOMAINS.values()
        for name, preset in (domain.resolve("recording") or {}).items()
    ]
    return markdown(("`--preset`", "domain", "task", "arguments", "policy"), rows)


def _preset_arguments(preset: Any) -> str:
    return ", ".join(f"`{name}`: {value}" for name, value in preset.get("task_kwargs", {}).items())


def cloning_table() -> str:
    """Returns the table of the hyperparameters of behaviour cloning with their defaults."""
    from kitchen_suite.training.bc import BCHyperparameters

    meanings = attributes(BCHyperparameters)
    intervals = ranges(BCHyperparameters)
    rows = [
        (f"`{each.name}`", meanings[each.name], f"`{intervals[each.name]}`", f"{each.default}")
        for each in dataclasses.fields(BCHyperparameters)
    ]
    return markdown(("name", "meaning", "range", "default"), rows)


# Conditions whose arguments are shown; of more, their number.
_MOST_CONDITIONS = 3


# Those that people start with.
_MAIN_PROTOCOLS = ("default", "strict", "clean", "unseen-kitchens", "unseen-pick-and-place", "shift", "d4rl")


def main_protocols() -> str:
    """Returns the protocols that people start with, a heading and a list each."""
    return _protocol_list([PROTOCOLS[name] for name in _MAIN_PROTOCOLS])


def further_protocols() -> str:
    """Returns all other protocols, a heading and a list each."""
    return _protocol_list([protocol for name, protocol in PROTOCOLS.items() if name not in _MAIN_PROTOCOLS])


def _protocol_list(protocols: Sequence[Protocol]) -> str:
    return "\n".join(_protocol_entry(protocol) for protocol in protocols)


def _protocol_entry(protocol: Protocol) -> str:
    tasks = dict.fromkeys(_task(condition, protocol.domain_name) for condition in protocol.conditions)
    details = {
        "domain": protocol.domain_name or "all",
        "task": ", ".join(tasks),
        "arguments": _arguments(protocol),
        "episodes": f"{protocol.num_episodes:,} of each condition, seeds from {protocol.seed:,}",
        "control steps": protocol.max_episode_steps or "the domain's",
    }
    lines = "".join(f"- {name}: {value}\n" for name, value in details.items())
    return f"### `{protocol.name}`\n\n{protocol.follows[0].upper()}{protocol.follows[1:]}.\n\n{lines}"


def protocol_differences() -> str:
    """Returns a list of what protocols do not have as their sources have it."""
    found = [protocol for protocol in PROTOCOLS.values() if protocol.differences]
    return "".join(f"- `{protocol.name}`: {protocol.differences}\n" for protocol in found)


def _task(condition: Condition, domain_name: str | None) -> str:
    if condition.task_name:
        return f"`{condition.task_name}`"
    elsewhere = "" if domain_name else "; elsewhere the domain's default"
    return f"`{domain_protocols('kitchen').task_name}`{elsewhere}"


def _arguments(protocol: Protocol) -> str:
    if len(protocol.conditions) > _MOST_CONDITIONS:
        first, *others = (condition.task_kwargs for condition in protocol.conditions)
        shared = {name: value for name, value in first.items() if all(each.get(name) == value for each in others)}
        own = f"others in each of {len(protocol.conditions)} conditions"
        return f"{_assignments(shared)}, and {own}" if shared else own
    return _assignments(protocol.conditions[0].task_kwargs) or "none"


def _assignments(arguments: Mapping[str, Any]) -> str:
    return ", ".join(f"`{name}={json.dumps(value)}`" for name, value in arguments.items())


def example(name: str, marks: str = "") -> str:
    """Returns a script of docs/examples, with the marks of its block."""
    return f"```python{marks}\n{(DOCS / 'examples' / f'{name}.py').read_text(encoding='utf-8')}```\n"


_GENERATED = ("kitchens", "pick_and_place")

TABLES: dict[str, Callable[[], str]] = {
    "arguments": argument_table,
    **{f"{domain}_arguments": functools.partial(argument_table, domain) for domain in suite.DOMAINS},
    "kitchen_sets": set_table,
    "goals": goal_table,
    # The tasks of generated kitchens are shown on their own pages.
    "gallery": lambda: "\n".join(
        f"## {domain}\n\n{gallery(domain)}" for domain in suite.DOMAINS if domain not in _GENERATED
    ),
    "ids": id_table,
    "observation": observation_table,
    "cabinet_observation": cabinet_observation_table,
    "observation_types": observation_type_table,
    "extra_observables": extra_table,
    "cameras": camera_table,
    "control_modes": control_mode_table,
    "cabinet_reward": cabinet_reward_table,
    "cabinet_grasp_reward": cabinet_grasp_reward_table,
    "entity_joints": joint_table,
    "distributions": distribution_table,
    "hyperparameters": hyperparameter_table,
    "imitation_hyperparameters": cloning_table,
    "presets": preset_table,
    "protocols": main_protocols,
    "further_protocols": further_protocols,
    "protocol_differences": protocol_differences,
    "my_task": functools.partial(example, "my_task"),
    "mug": functools.partial(example, "mug"),
    "my_control_mode": functools.partial(example, "my_control_mode"),
    "my_arm": functools.partial(example, "my_arm", " full"),
    "fixtures": fixture_table,
    "kitchens_tasks": functools.partial(task_table, "kitchens"),
    "kitchens_observation": functools.partial(part_table, kitchens.SLICES, _KITCHENS_CONTENT),
    "kitchens_slots": functools.partial(part_table, slots.SLOT_SLICES, _SLOT_CONTENT),
    "objects": object_table,
    "pick_and_place_tasks": functools.partial(task_table, "pick_and_place"),
    "pick_and_place_observation": functools.partial(part_table, objects.SLICES, _OBJECTS_CONTENT),
    "pick_and_place_objects": functools.partial(part_table, objects.OBJECT_SLICES, _OBJECT_CONTENT),
    "pick_and_place_places": functools.partial(part_table, objects.PLACE_SLICES, _PLACE_CONTENT),
    "open_cabinet_tasks": functools.partial(task_table, "open_cabinet"),
    "variations": functools.partial(parameter_table, GROUPS[:4]),
    "variations_of_looks": functools.partial(parameter_table, GROUPS[4:]),
    **RESULT_TABLES,
}


def main() -> None:
    """Rewrites the tables of every page."""
    for path in sorted(DOCS.rglob("*.md")):
        path.write_text(with_tables(path.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    if sys.argv[1:]:
        sys.exit(__doc__)
    main()
