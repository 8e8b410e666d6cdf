"""Designs of generated kitchens: by number, drawn by the grammar, or read from JSON.

Every pair of a split and a number is a kitchen. Designs of different splits have different sequences of fixtures.
"""

import contextlib
import functools
import os
import re
import zlib
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite import checks, files
from kitchen_suite.entities.fixture_designs import HANDLES, HINGES, KINDS, LEVELS, FixtureDesign
from kitchen_suite.entities.fixtures import BAR_HALF_LENGTH
from kitchen_suite.entities.kitchen_grammar import draw_plan
from kitchen_suite.entities.kitchen_plans import SIDES, KitchenPlan, Row
from kitchen_suite.entities.kitchen_styles import STYLES
from kitchen_suite.entities.scenes import robot_base

SPLITS = ("train", "test")

SHOULDER = 0.333  # Height of the arm's shoulder above its base [m], by the lengths of its links.

# Distance from the shoulder to the finger tips with all links in line [m], by the lengths of the links.
REACH = 1.0


class KitchenDesign(KitchenPlan, frozen=True, kw_only=True):
    """Plan of a kitchen, and its name.

    Attributes:
      name: such as `train/7`; the empty string for a design of one's own.
    """

    name: str = ""

    @classmethod
    def make(cls, design: "Design", split: str) -> "KitchenDesign":
        """Returns a checked design.

        Args:
          design: number of a design of the split, from 0; a JSON object, or the path of a file with one; or a design,
            which is checked as well if it has no name.
          split: `train` or `test`.

        Raises:
          TypeError: a value of the wrong type.
          ValueError: a design that cannot be built; messages name the value by its path in the JSON.
        """
        checks.choice(split, SPLITS, "split")
        if isinstance(design, KitchenDesign):
            if design.name:
                return design
            design = design.to_json()
        if isinstance(design, str) and design.isdecimal():
            design = int(design)
        if isinstance(design, Mapping | str | os.PathLike):
            plan = _parsed(design if isinstance(design, Mapping) else _read(Path(design)))
            plan.check()
            _check_reach(plan)
            return cls.of(plan)
        return cls.drawn(checks.integer(design, "design", minimum=0), split)

    @classmethod
    def of(cls, plan: KitchenPlan, name: str = "") -> "KitchenDesign":
        """Returns the design of a plan."""
        return cls(counter_height=plan.counter_height, style=plan.style, kettle=plan.kettle, rows=plan.rows, name=name)

    @staticmethod
    @functools.lru_cache(maxsize=4096)
    def drawn(number: int, split: str) -> "KitchenDesign":
        """Returns the design of a number of a split: the first possible one that the grammar draws from both."""
        name = f"{split}/{number}"
        generator = np.random.default_rng([SPLITS.index(split), number])
        while True:
            plan = draw_plan(generator)
            # A quarter of the sequences of fixtures is for tests.
            if SPLITS[zlib.crc32(plan.sequence.encode()) % 4 == 0] != split:
                continue
            kinds = {placed.design.kind for placed in plan.placed}
            if kinds & {"oven", "stove"} and kinds - {"oven", "stove", "hood"}:
                with contextlib.suppress(ValueError):
                    plan.check()
                    return KitchenDesign.of(plan, name)

    def to_json(self) -> dict[str, Any]:
        """Returns the design as a JSON object, without its name and what is None."""
        value: dict[str, Any] = msgspec.json.decode(msgspec.json.encode(self))
        del value["name"]
        return value


Design = int | str | os.PathLike[str] | Mapping[str, Any] | KitchenDesign
"""A design, the number of one, or its JSON or the path of a file with it; see `KitchenDesign.make`."""


def _read(path: Path) -> Any:
    try:
        return files.load_json(path, "a design")
    except OSError as error:
        problem = f"design must be a number, a JSON object or a file with one: {error}"
        raise ValueError(checks.shortened(problem, 500)) from None


def _parsed(value: object) -> KitchenPlan:
    """Returns the plan in a JSON object, of values that are allowed each by itself."""
    try:
        return msgspec.convert(msgspec.to_builtins(value, str_keys=True, enc_hook=_builtin), KitchenPlan)
    except msgspec.ValidationError as error:
        message = str(error)
    except (RecursionError, SystemError, TypeError, UnicodeError) as error:
        # Keys that are no strings, or a SystemError of msgspec before 0.21 for an int that is too large for a float.
        raise ValueError(f"design is no JSON object ({error}), got {checks.shown(value)}") from None
    raise _refusal(value, message)


def _builtin(value: object) -> object:
    """Returns a NumPy scalar as a number, another mapping as a dict, and what JSON does not have as a string."""
    if isinstance(value, np.generic):
        return value.item()
    return dict(value) if isinstance(value, Mapping) else checks.shown(value)


# Where msgspec found a problem, such as ` - at `$.rows[0].fixtures[1].kind``, and a step on the way there.
_PLACE = re.compile(r"(?s)(?P<problem>.*) - at `\$(?P<path>(?:\.\w+|\[\d+\])+)`")
_STEP = re.compile(r"\.(?P<key>\w+)|\[(?P<index>\d+)\]")

_CHOICES: Mapping[str, Collection[str]] = {
    "style": STYLES,
    "side": SIDES,
    "level": LEVELS,
    "kind": KINDS,
    "handle": HANDLES,
    "hinge": HINGES,
}


def _refusal(design: object, message: str) -> TypeError | ValueError:
    """Returns the error for a message of msgspec, with the value at its place.

    Raises it, with the choices and the nearest of them, for a name or a key.
    """
    match = _PLACE.fullmatch(message)
    problem, path = match.groups() if match else (message, "")
    try:
        value = _value_at(design, path)
    except (LookupError, TypeError):  # An unknown key of the design looks like a place.
        value, path = design, ""
    place = path.removeprefix(".") or "design"
    name = path.rpartition(".")[2]
    if name in _CHOICES:
        checks.choice(value, _CHOICES[name], place)
    if "unknown field" in problem:
        for key in value:
            checks.choice(key, _keys(value, path), f"key of {place}")
    problem = problem.replace("Number out of range", "Expected a number in range")
    if not problem.startswith("Expected "):
        return ValueError(f"{place}: {checks.shortened(problem, 500)}")
    # A value of another type is named by msgspec, one out of bounds is not.
    expected = problem.removeprefix("Expected ").replace("`", "")
    refusal = f"{place} must be {expected.partition(', got ')[0]}, got {checks.shown(value)}"
    return TypeError(refusal) if ", got " in expected else ValueError(refusal)


def _value_at(value: Any, path: str) -> Any:
    """Returns what stands at a path in JSON."""
    for step in _STEP.finditer(path):
        value = value[step["key"] or int(step["index"])]
    return value


def _keys(value: Mapping[str, Any], path: str) -> tuple[str, ...]:
    """Returns the keys of the JSON object at a path: a fixture, a row or the design."""
    if "fixtures" in path:
        return ("kind", *KINDS[value["kind"]].__struct_fields__)
    return Row.__struct_fields__ if path else KitchenPlan.__struct_fields__


def _check_reach(plan: KitchenPlan) -> None:
    """Raises a ValueError if the arm is too short for a handle of a plan."""
    # An end of a bar may be nearer than its middle.
    reach = REACH + BAR_HALF_LENGTH
    shoulder = np.add(robot_base(), (0.0, 0.0, SHOULDER))
    for placed in plan.placed:
        for name, position in _handles(placed.design):
            distance = np.linalg.norm(placed.in_world(position) - shoulder)
            if distance > reach:
                raise ValueError(
                    f"{placed.path} ({placed.design.kind}) has {name} out of reach: {distance:.2f} m from the "
                    f"robot's shoulder, at most {reach:.2f} m"
                )


@functools.cache
def _handles(design: FixtureDesign) -> tuple[tuple[str | None, NDArray[np.float64]], ...]:
    """Returns each part's joint and the position of its handle in the frame of its fixture [m]."""
    prop, parts = design.build(next(iter(STYLES.values())), visuals=False, name=design.kind)
    physics = mjcf.Physics.from_mjcf_model(prop.mjcf_model)
    sites = [(part.joint, prop.mjcf_model.find("site", part.handle)) for part in parts]
    return tuple((joint, np.add(design.origin, physics.bind(site).xpos)) for joint, site in sites)
