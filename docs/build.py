"""Generates the tables and pictures of these pages from the code.

python docs/build.py tables     rewrites the tables between their markers in docs/*.md
python docs/build.py pictures   renders the scene from every camera into docs/pictures/
"""

import dataclasses
import functools
import inspect
import json
import re
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np
from dm_control import mjcf
from tabulate import tabulate

from kitchen_suite import suite
from kitchen_suite.benchmarks import report as benchmark_report
from kitchen_suite.entities import CabinetConfig
from kitchen_suite.tasks import GOALS, Randomization
from kitchen_suite.tasks.kitchen import noise
from kitchen_suite.tasks.open_cabinet import grasp_reward as drawer_grasp_reward
from kitchen_suite.tasks.open_cabinet import observation as drawer_observation
from kitchen_suite.tasks.open_cabinet import reward as drawer_reward
from kitchen_suite.tasks.open_cabinet.task import DEFAULT_POSE
from kitchen_suite.training.hyperparameters import DEFAULTS, Hyperparameters

DOCS = Path(__file__).parent
PICTURE_HEIGHT, PICTURE_WIDTH = 480, 640
_MARKED = re.compile(r"(<!-- table: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)
# Joint positions of the robot [rad, m] and opening of the top drawer [m]: initial state, grasp, open drawer.
CABINET_STATES = (
    (DEFAULT_POSE, 0.0),
    ((0, 0.064, 0, -1.899, 0, 3.534, -0.785, 0.006, 0.006), 0.0),
    ((0, -1.187, 0, -2.862, 0, 3.246, -0.785, 0.006, 0.006), 0.358),
)
_UNITS = {"hinge": "rad", "slide": "m", None: "rad"}
_FREE_POSITIONS = [(part, "m") for part in "xyz"] + [(f"q{part}", "1") for part in "wxyz"]
_FREE_VELOCITIES = [(f"v{part}", "m/s") for part in "xyz"] + [(f"ω{part} in its own frame", "rad/s") for part in "xyz"]


def markdown(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Returns a table in markdown."""
    return tabulate([[*map(str, row)] for row in rows], header, tablefmt="github", disable_numparse=True) + "\n"


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
    noise_scale = noise.scale(robot_ratio=0.01, object_ratio=0.0005)
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
    """Returns the table of the seven goals of the kitchen."""
    names = [f"{9 + i}" for i in range(21)]
    rows = [
        (f"`{task}`", goal.description, ", ".join(names[i] for i in goal.elements), ", ".join(map(str, goal.value)))
        for task, goal in GOALS.items()
    ]
    return markdown(("task", "goal state", "qpos", "goal"), rows)


def suite_table() -> str:
    """Returns the table of the kitchen's tasks in the suite."""
    rows = []
    for name in suite.TASKS_BY_DOMAIN["kitchen"]:
        environment = suite.load("kitchen", name, {"visuals": False})
        tasks = ", ".join(environment.task.tasks_to_complete)
        rows.append(("`kitchen`", f"`{name}`", tasks, f"{environment.step_limit:.0f}"))
    return markdown(("domain", "task", "to be completed", "steps"), rows)


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


def hyperparameter_table() -> str:
    """Returns the table of the hyperparameters with their defaults."""
    meanings, domains = attributes(Hyperparameters), list(DEFAULTS)
    rows = [
        (
            f"`{each.name}`",
            meanings[each.name],
            *(format_value(getattr(DEFAULTS[domain], each.name)) for domain in domains),
        )
        for each in dataclasses.fields(Hyperparameters)
    ]
    return markdown(("name", "meaning", *(f"`{domain}`" for domain in domains)), rows)


def format_value(value: object) -> str:
    """Returns the text of a number or a tuple of numbers; a tuple of equal numbers as their count and value."""
    if not isinstance(value, tuple):
        return f"{value:g}"
    if len(set(value)) == 1 and len(value) > 2:
        return f"{len(value)} times {value[0]:g}"
    return ", ".join(f"{part:g}" for part in value)


def first_line(documented: object) -> str:
    """Returns the first line of a docstring, with the bars escaped for a cell of a table."""
    return (inspect.getdoc(documented) or "").splitlines()[0].replace("|", "\\|")


def attributes(documented: type) -> dict[str, str]:
    """Returns the names and texts of the section `Attributes` of a docstring."""
    section = (inspect.getdoc(documented) or "").split("Attributes:\n", 1)[1]
    entries = re.findall(r"^ {2}(\w+): (.*(?:\n {4,}.*)*)", section, re.MULTILINE)
    return {name: re.sub(r"\s+", " ", text) for name, text in entries}


TABLES: dict[str, Callable[[], str]] = {
    "observation": observation_table,
    "goals": goal_table,
    "suite": suite_table,
    "cabinet_observation": cabinet_observation_table,
    "cabinet_reward": cabinet_reward_table,
    "cabinet_grasp_reward": cabinet_grasp_reward_table,
    "cabinet_config": cabinet_config_table,
    "cabinet_randomization": cabinet_randomization_table,
    "hyperparameters": hyperparameter_table,
}


def benchmark_table(name: str) -> str:
    """Returns the tables of a result of `kitchen-benchmark --json`, as kept in docs/benchmarks/."""
    return benchmark_report.markdown(json.loads((DOCS / "benchmarks" / f"{name}.json").read_text(encoding="utf-8")))


TABLES |= {
    f"{domain}_{measure}": functools.partial(benchmark_table, f"{domain}_{measure}")
    for domain in ("kitchen", "open_cabinet")
    for measure in benchmark_report.TABLES
}


def with_tables(page: str) -> str:
    """Returns a page with its tables regenerated."""
    return _MARKED.sub(lambda match: f"{match[1]}\n{TABLES[match[2]]()}\n{match[3]}", page)


def write_tables() -> None:
    """Rewrites the tables of every page."""
    for path in sorted(DOCS.glob("*.md")):
        path.write_text(with_tables(path.read_text(encoding="utf-8")), encoding="utf-8")


def write_pictures() -> None:
    """Renders the pictures of both domains."""
    write_kitchen_pictures()
    write_cabinet_picture()


def write_cabinet_picture() -> None:
    """Renders the initial state, the grasp and the open drawer from every camera of open_cabinet."""
    from PIL import Image

    environment = suite.load("open_cabinet", "top_drawer", {"random": 0})
    environment.reset()
    columns = []
    for pose, opening in CABINET_STATES:
        with environment.physics.reset_context():
            environment.physics.bind(environment.task.scene.robot.joints).qpos = pose
            environment.physics.bind(environment.task.scene.cabinet.drawer_joint("top")).qpos = opening
        cameras = ("overview", "handle", "franka/wrist")
        columns.append(np.vstack([environment.physics.render(300, 400, camera_id=camera) for camera in cameras]))
    Image.fromarray(np.hstack(columns)).save(DOCS / "pictures" / "open_cabinet.png", optimize=True)


def write_kitchen_pictures() -> None:
    """Renders the kitchen at the start of an episode."""
    from PIL import Image

    environment = suite.load("kitchen", "all", {"random": 0})
    environment.reset()
    folder = DOCS / "pictures"
    folder.mkdir(exist_ok=True)
    model = environment.physics.model
    for name in (model.camera(i).name for i in range(model.ncam)):
        picture = environment.physics.render(PICTURE_HEIGHT, PICTURE_WIDTH, camera_id=name)
        Image.fromarray(picture).save(folder / f"kitchen_{name.replace('/', '_')}.png", optimize=True)
    sheet = [
        environment.physics.render(PICTURE_HEIGHT, PICTURE_WIDTH, camera_id="overview"),
        depth_picture(environment.physics.render(PICTURE_HEIGHT, PICTURE_WIDTH, camera_id="overview", depth=True)),
        class_picture(environment.physics.render(PICTURE_HEIGHT, PICTURE_WIDTH, "overview", segmentation=True)),
    ]
    Image.fromarray(np.hstack(sheet)).save(folder / "kitchen_rgb_depth_segmentation.png", optimize=True)


def depth_picture(depth: np.ndarray) -> np.ndarray:
    """Returns depth [m] as shades of grey: white at 1 m, black at 4 m."""
    shade = np.clip((4.0 - depth) / 3.0, 0.0, 1.0) * 255
    return np.repeat(shade.astype(np.uint8)[..., None], 3, axis=2)


def class_picture(segmentation: np.ndarray) -> np.ndarray:
    """Returns a segmentation with a colour for each geom."""
    colours = np.random.default_rng(1).integers(40, 256, (segmentation[..., 0].max() + 2, 3), dtype=np.uint8)
    colours[-1] = 0
    return colours[segmentation[..., 0]]


if __name__ == "__main__":
    commands = {"tables": write_tables, "pictures": write_pictures}
    if len(sys.argv) != 2 or sys.argv[1] not in commands:
        sys.exit(__doc__)
    commands[sys.argv[1]]()
