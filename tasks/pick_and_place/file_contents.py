"""Arguments of kitchens with objects without files: designs that are read, and layouts as JSON."""

from collections.abc import Mapping
from typing import Any

from kitchen_suite.entities.kitchen_designs import SPLITS, KitchenDesign
from kitchen_suite.entities.object_layouts import ObjectLayout
from kitchen_suite.entities.pick_and_place import DEFAULT_DESIGN
from kitchen_suite.tasks.generated_kitchens.file_contents import with_designs
from kitchen_suite.tasks.pick_and_place.certificates import certified_tasks, is_shipped


def with_contents(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Returns arguments with designs in place of the paths of their files, a layout as JSON, and certified tasks.

    `certified=True` stays where the certificate comes with the package, which is the same on every machine.
    """
    found = with_designs(arguments)
    if isinstance(found.get("objects"), ObjectLayout):
        found["objects"] = found["objects"].to_json()
    design = found.get("design", DEFAULT_DESIGN)
    if found.get("certified") is True and not isinstance(design, list | tuple | range):
        made = KitchenDesign.make(design, found.get("split", SPLITS[0]))
        # Without a certificate the task says what is missing.
        if made.name and not is_shipped(made):
            found["certified"] = list(certified_tasks(made, ObjectLayout.make(found.get("objects"), made)))
    return found
