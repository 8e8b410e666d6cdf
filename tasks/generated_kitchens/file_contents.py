"""Arguments of generated kitchens without files: designs that are read, tasks that a user's certificate lists."""

import os
from collections.abc import Mapping, Sequence
from typing import Any

from kitchen_suite.entities.kitchen_designs import SPLITS, KitchenDesign
from kitchen_suite.tasks.generated_kitchens.certificates import certificate_of, is_shipped


def with_contents(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Returns arguments with designs in place of the paths of their files, and certified tasks by name.

    `certified=True` stays where the certificate comes with the package, which is the same on every machine.
    """
    found = with_designs(arguments)
    split = found.get("split", SPLITS[0])
    design = found.get("design", 0)
    if found.get("certified") is True and not isinstance(design, list | tuple | range):
        made = KitchenDesign.make(design, split)
        # Without a certificate the task says what is missing.
        if made.name and not is_shipped(made):
            found["certified"] = list(certificate_of(made).certified)
    return found


def with_designs(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Returns arguments with designs in place of the paths of their files."""
    found = dict(arguments)
    if "design" in found:
        found["design"] = _design(found["design"], found.get("split", SPLITS[0]))
    return found


def _design(design: Any, split: str) -> Any:
    """Returns a design, or several, without the paths of files and designs of one's own, which JSON could not hold."""
    if isinstance(design, Sequence) and not isinstance(design, str | range):
        return [_design(each, split) for each in design]
    is_path = isinstance(design, os.PathLike) or (isinstance(design, str) and not design.isdecimal())
    is_own = isinstance(design, KitchenDesign) and not design.name
    return KitchenDesign.make(design, split).to_json() if is_path or is_own else design
