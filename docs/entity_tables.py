"""The tables of the entities: joints, sites and cameras."""

from collections.abc import Callable, Iterable, Sequence
from types import MappingProxyType

from dm_control import composer, mjcf
from tabulate import tabulate

from kitchen_suite import entities, suite
from kitchen_suite.entities import KITCHEN_FRANKA, PANDA, Franka

# Classes that are not built by calling them without arguments.
_NOT_ALONE = (Franka, entities.KitchenProp)


def builders() -> dict[str, Callable[[], composer.Entity]]:
    """Returns what builds each entity, by the expression that does so: the robots, the props, the domains' arenas."""
    public = (getattr(entities, name) for name in entities.__all__)
    kinds = [each for each in public if isinstance(each, type) and issubclass(each, composer.Entity)]
    tasks = (suite.load(domain, suite.default_task(domain), {"visuals": False}).task for domain in suite.DOMAINS)
    kinds += [type(task.root_entity) for task in tasks]
    robots = {"Franka(PANDA)": lambda: Franka(PANDA), "Franka(KITCHEN_FRANKA)": lambda: Franka(KITCHEN_FRANKA)}
    return robots | {f"{kind.__name__}()": kind for kind in kinds if kind not in _NOT_ALONE}


def markdown(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Returns a table in markdown."""
    return tabulate([[*map(str, row)] for row in rows], header, tablefmt="github", disable_numparse=True) + "\n"


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


def frame_table() -> str:
    """Returns the table of the sites and cameras of all entities."""
    rows = []
    for name, build in builders().items():
        root = build().mjcf_model
        rows.append((f"`{name}`", names(root.find_all("site")), names(root.find_all("camera"))))
    return markdown(("entity", "sites", "cameras"), rows)


def names(elements: Iterable[mjcf.Element]) -> str:
    """Returns the names of elements as text."""
    return ", ".join(f"`{each.name}`" for each in elements) or "-"


ENTITY_TABLES = MappingProxyType({"entity_joints": joint_table, "entity_frames": frame_table})
