"""Digests of a scene and of arguments, by which an environment tells states of other environments from its own.

They are of what was asked, not of what was compiled: the same in every process, on every machine, and whether or not
there are visuals.
"""

import dataclasses
import hashlib
import json
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence, Set
from typing import Any

import numpy as np
from dm_control import mjcf

from kitchen_suite import checks
from kitchen_suite.entities.assets import VISUAL_BODY

# Key of states: digests by name, of the scene, of the task's class and of arguments.
DIGESTS = "digests"

# Names of those that are of no argument.
SCENE, TASK = "scene", "task"

# Digits of numbers that count: rounding on another processor may change later ones.
_DIGITS = 12

# Integers below it are floats as well.
_EXACT = 2**53

# Elements that only pictures and sensors depend on, and attributes that only pictures do.
_IGNORED = ("camera", "light", "material", "sensor", "skin", "texture", "visual")
_LOOKS = ("material", "rgba")

# What a geom has that neither collides nor has mass.
_NO_PHYSICS = {"contype": "0", "conaffinity": "0", "mass": "0"}


def digest(value: Any) -> str:
    """Returns the first 16 hexadecimal digits of the SHA-256 of an argument, however it is written.

    A list is as a tuple or an array, 1 as 1.0, and the order of a dict's keys does not count. Of functions and of
    objects without a representation of their own, only the name counts, or that of their class.
    """
    return _sha256(json.dumps(_plain(value), sort_keys=True))


def digests(values: Mapping[str, Any]) -> dict[str, str]:
    """Returns the digest of each value."""
    return {name: digest(value) for name, value in values.items()}


def scene_digest(root: mjcf.RootElement) -> str:
    """Returns the digest of a scene's MJCF, without what only pictures and sensors depend on."""
    xml = root.to_xml(precision=_DIGITS, zero_threshold=10.0**-_DIGITS)
    used = {geom.get("mesh") for geom in xml.iter("geom") if not _is_visual(geom)}
    return _sha256("\n".join(_lines(xml, used)))


def check_same(found: Any, own: Mapping[str, str], of_scene: Collection[str]) -> None:
    """Raises a ValueError that names what differs if a state's digests are of another environment.

    Arguments of which only one of the two knows, such as an environment that was built from a task, do not count.

    Args:
      found: the digests in the state.
      own: those of the environment.
      of_scene: names of the arguments of the scene, which count only where the scene differs: it may be the same
        although they are written in another way.
    """
    if not isinstance(found, Mapping):
        raise TypeError(f"state[{DIGESTS!r}] must be a dict of digests, got {checks.shown(found)}")
    compared = {SCENE, TASK} | (found.keys() & own.keys())
    if found.get(SCENE) == own[SCENE]:
        compared -= {*of_scene}
    if different := [name for name in own if name in compared and found.get(name) != own[name]]:
        raise ValueError(
            f"the state is of another environment, which differs in {', '.join(different)}: set it in one that is "
            "built with the same arguments"
        )


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _plain(value: Any) -> Any:
    """Returns a value as JSON can hold it, the same for all ways to write it."""
    if value is None or isinstance(value, bool | str):
        return value
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, int) and abs(value) >= _EXACT:
        return str(value)
    if isinstance(value, int | float):
        # Minus zero is zero.
        return f"{value + 0.0:.{_DIGITS}g}"
    if isinstance(value, Mapping):
        return {str(key): _plain(part) for key, part in value.items()}
    if isinstance(value, Set):
        return sorted(json.dumps(_plain(part), sort_keys=True) for part in value)
    if isinstance(value, Sequence):
        return [_plain(part) for part in value]
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {field.name: _plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
        return [type(value).__qualname__, fields]
    if callable(value) and hasattr(value, "__qualname__"):
        return value.__qualname__
    text = repr(value)
    # An address is another one in every process.
    return type(value).__qualname__ if " at 0x" in text else text


def _is_visual(geom: Any) -> bool:
    """As `assets.is_visual`, of XML; also for a geom without a class that neither collides nor has mass."""
    name = geom.get("class", "").rpartition("/")[2].rpartition("\\")[2]
    return name.startswith("visual") or all(geom.get(key) == value for key, value in _NO_PHYSICS.items())


def _lines(element: Any, meshes: Collection[str | None]) -> Iterator[str]:
    """Yields a line for each element on which the physics depends, and one for its end.

    Args:
      element: of the XML.
      meshes: names of the meshes that count.
    """
    if element.tag in _IGNORED or element.get("name", "").endswith(VISUAL_BODY):
        return
    if element.tag == "mesh" and element.getparent().tag == "asset" and element.get("name") not in meshes:
        return
    if element.tag == "geom" and element.getparent().tag != "default" and _is_visual(element):
        return
    yield f"{element.tag} {sorted(_counting(element.attrib.items()))}"
    for child in element:
        yield from _lines(child, meshes)
    yield "end"


def _counting(attributes: Iterable[tuple[str, str]]) -> Iterator[tuple[str, list[str]]]:
    """Yields names and values on which the physics depends, in words; minus zero is zero."""
    for name, value in attributes:
        if name not in _LOOKS:
            yield name, ["0" if word == "-0" else word for word in value.split()]
