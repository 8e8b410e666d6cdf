"""Arguments of kitchens with objects without files: designs that are read, and layouts as JSON."""

from collections.abc import Mapping
from typing import Any

from kitchen_suite.entities.object_layouts import ObjectLayout
from kitchen_suite.tasks.generated_kitchens.file_contents import with_designs


def with_contents(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Returns arguments with designs in place of the paths of their files, and a layout as its JSON object."""
    found = with_designs(arguments)
    if isinstance(found.get("objects"), ObjectLayout):
        found["objects"] = found["objects"].to_json()
    return found
