"""The tables of these pages, generated from the code: `TABLES`."""

import dataclasses
import functools
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import numpy as np
from benchmark_results import read_results
from control_tables import CONTROL_TABLES
from dm_control import mjcf
from dm_env import specs
from docstrings import attributes, first_line
from entity_tables import ENTITY_TABLES, markdown
from evaluation_tables import EVALUATION_TABLES
from gallery_tables import GALLERY_TABLES
from imitation_tables import IMITATION_TABLES
from observation_tables import OBSERVATION_TABLES
from reward_tables import REWARD_TABLES
from training_tables import TRAINING_TABLES
from variation_tables import VARIATION_TABLES

from kitchen_suite import suite
from kitchen_suite.benchmarks import benchmark_job
from kitchen_suite.entities import CabinetConfig
from kitchen_suite.tasks import GOALS, Randomization
from kitchen_suite.tasks.kitchen import observation
from kitchen_suite.tasks.microwave_table.task import GOAL as MICROWAVE_GOAL
from kitchen_suite.tasks.open_cabinet import observation as drawer_observation
from kitchen_suite.tasks.open_cabinet import reward as drawer_grasp_reward
from kitchen_suite.tasks.open_cabinet import reward as drawer_reward
from kitchen_suite.tasks.open_cabinet.task import INSTRUCTIONS as DRAWER_INSTRUCTIONS
from kitchen_suite.tasks.variations import distributions
from kitchen_suite.training.hyperparameters import Hyperparameters

DOCS = Path(__file__).parent
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
    """Returns the table of the 59 elements of the kitchen's observation."""
    kitchen = suite.load("kitchen", "all", {"visuals": False}).task.scene
    noise_scale = observation.scale(robot_ratio=0.01, object_ratio=0.0005)
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
    rows = [
        (number, f"`{key}`", name, unit, f"±{size:.3g}")
        for number, ((key, name, unit), size) in enumerate(zip(elements, noise_scale, strict=True))
    ]
    return markdown(("number", "key", "element", "unit", "noise by default"), rows)


def goal_table() -> str:
    """Returns the table of the goals of the kitchen."""
    kitchen = suite.load("kitchen", "all", {"visuals": False}).task.scene
    rows = [
        (
            f"`{task}`",
            goal.instructions[0],
            ", ".join(map(str, 9 + goal.elements_in(kitchen))),
            numbers(goal.value),
            numbers(goal.start or ()),
        )
        for task, goal in GOALS.items()
    ]
    return markdown(("task", "instruction", "qpos", "goal", "start"), rows)


def numbers(values: Iterable[float]) -> str:
    """Returns numbers as text, with at most four decimals."""
    return ", ".join(f"{round(value, 4) + 0.0:g}" for value in values)


def instruction_table() -> str:
    """Returns the table of the sentences of all goals, with their paraphrases."""
    goals = {
        "kitchen": {task: goal.instructions for task, goal in GOALS.items()},
        "open_cabinet": {f"{drawer}_drawer": instructions for drawer, instructions in DRAWER_INSTRUCTIONS.items()},
        "microwave_table": {"open": MICROWAVE_GOAL.instructions},
    }
    rows = [
        (domain, f"`{task}`", sentence, "; ".join(paraphrases))
        for domain, tasks in goals.items()
        for task, (sentence, *paraphrases) in tasks.items()
    ]
    return markdown(("domain", "task", "instruction", "paraphrases"), rows)


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


def spec_table(domain: str) -> str:
    """Returns the table of the specs of dm_env: the action of a domain's default task, and its observations."""
    environment = suite.load(domain, suite.default_task(domain), {"visuals": False})
    parts = {"action": environment.action_spec(), **environment.observation_spec()}
    rows = [(f"`{name}`", spec.shape, spec.dtype, bounds(spec)) for name, spec in parts.items()]
    return markdown(("name", "shape", "type", "bounds"), rows)


def bounds(spec: specs.Array) -> str:
    """Returns the bounds of a spec's elements."""
    if not isinstance(spec, specs.BoundedArray) or not np.isfinite([spec.minimum, spec.maximum]).all():
        return "none"
    return f"[{np.min(spec.minimum):g}, {np.max(spec.maximum):g}]"


def id_table() -> str:
    """Returns the table of the Gymnasium ids."""
    rows = [
        (f"`{name}`", f"`{record.env_id}`", ", ".join(f"`{env_id}`" for env_id in record.task_ids.values()))
        for name, record in suite.DOMAINS.items()
    ]
    return markdown(("domain", "id for any of its tasks", "ids of its tasks"), rows)


def cabinet_observation_table() -> str:
    """Returns the table of the parts of open_cabinet's observation."""
    rows = []
    for name, part in drawer_observation.PARTS.items():
        part_slice = drawer_observation.SLICES[name]
        index = str(part_slice.start) if part.size == 1 else f"{part_slice.start}-{part_slice.stop - 1}"
        rows.append((index, f"`{name}`", first_line(part.compute).split(": ", 1)[1]))
    return markdown(("index", "key", "content"), rows)


def cabinet_reward_table() -> str:
    """Returns the table of the terms of open_cabinet's original reward."""
    rows = [(i, f"`{name}`", first_line(getattr(drawer_reward, name))) for i, name in enumerate(drawer_reward.TERMS, 1)]
    return markdown(("term", "name", "value"), rows)


def cabinet_grasp_reward_table() -> str:
    """Returns the table of the terms in which the grasp reward differs from the original one."""
    rows = [
        (i, f"`{name}`", first_line(getattr(drawer_grasp_reward, name)))
        for i, name in enumerate(drawer_reward.TERMS, 1)
        if hasattr(drawer_grasp_reward, name)
    ]
    return markdown(("term", "name", "value"), rows)


def cabinet_config_table() -> str:
    """Returns the table of the parameters of the cabinet."""
    meanings = attributes(CabinetConfig)
    rows = [(f"`{each.name}`", each.default, meanings[each.name]) for each in dataclasses.fields(CabinetConfig)]
    return markdown(("parameter", "default", "meaning"), rows)


def cabinet_randomization_table() -> str:
    """Returns the table of the randomization options of open_cabinet."""
    rows = [(f"`{name}`", meaning) for name, meaning in attributes(Randomization).items()]
    return markdown(("option", "meaning"), rows)


def distribution_table() -> str:
    """Returns the table of the distributions that JSON describes, with their arguments."""
    rows = [(f"`{name}`", ", ".join(each.arguments)) for name, each in distributions.DISTRIBUTIONS.items()]
    return markdown(("distribution", "arguments"), [*rows, ("`choice`", "the values, each with the same probability")])


def hyperparameter_table() -> str:
    """Returns the table of the hyperparameters with their defaults."""
    meanings = attributes(Hyperparameters)
    defaults = {domain: Hyperparameters.defaults(domain) for domain in suite.DOMAINS}
    rows = [
        (
            f"`{each.name}`",
            meanings[each.name],
            *(format_value(getattr(values, each.name)) for values in defaults.values()),
        )
        for each in dataclasses.fields(Hyperparameters)
    ]
    return markdown(("name", "meaning", *(f"`{domain}`" for domain in defaults)), rows)


def format_value(value: object) -> str:
    """Returns the text of a number or a tuple of numbers; a tuple of equal numbers as their count and value."""
    if not isinstance(value, tuple):
        return f"{value:g}"
    if len(set(value)) == 1 and len(value) > 2:
        return f"{len(value)} times {value[0]:g}"
    return ", ".join(f"{part:g}" for part in value)


def my_task() -> str:
    """Returns the example of a task of one's own."""
    return f"```python\n{(DOCS / 'my_task.py').read_text(encoding='utf-8')}```\n"


TABLES: dict[str, Callable[[], str]] = {
    "observation": observation_table,
    "goals": goal_table,
    "instructions": instruction_table,
    "ids": id_table,
    "cabinet_observation": cabinet_observation_table,
    "cabinet_reward": cabinet_reward_table,
    "cabinet_grasp_reward": cabinet_grasp_reward_table,
    "cabinet_config": cabinet_config_table,
    "cabinet_randomization": cabinet_randomization_table,
    "distributions": distribution_table,
    "hyperparameters": hyperparameter_table,
    "my_task": my_task,
    **IMITATION_TABLES,
    **ENTITY_TABLES,
    **CONTROL_TABLES,
    **EVALUATION_TABLES,
    **GALLERY_TABLES,
    **OBSERVATION_TABLES,
    **REWARD_TABLES,
    **TRAINING_TABLES,
    **VARIATION_TABLES,
}


def benchmark_table(name: str) -> str:
    """Returns the tables of a result of `kitchen-benchmark --json`, as kept in docs/benchmarks/."""
    return benchmark_job.markdown(read_results(name))


TABLES |= {
    f"{domain}_{kind}": functools.partial(table, domain)
    for domain in suite.DOMAINS
    for kind, table in (("tasks", task_table), ("specs", spec_table))
}
TABLES |= {
    f"{domain}_{measure}": functools.partial(benchmark_table, f"{domain}_{measure}")
    for domain, record in suite.DOMAINS.items()
    if record.benchmark
    for measure in benchmark_job.TABLES
}
