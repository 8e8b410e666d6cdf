"""Certificates of the tasks with objects: which of them the expert has completed in which kitchen.

They are as those of generated kitchens, see `generated_kitchens.certificates`, and are kept beside them.
"""

from collections.abc import Collection

from kitchen_suite.entities.pick_and_place import PickAndPlaceKitchen


def certified_tasks(scene: PickAndPlaceKitchen) -> Collection[str]:
    """Returns the tasks that the expert completed in a kitchen."""
    raise NotImplementedError
