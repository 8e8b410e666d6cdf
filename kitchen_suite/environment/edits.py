"""Edits that a user makes of an environment's MJCF or compiled model, found by comparison."""

import operator
from typing import Any

import mujoco
import numpy as np
from dm_control import mjcf
from mujoco.batch import MODEL_FIELDS

# What MuJoCo derives from other fields: for its decision which objects sleep, and the boxes around parts of meshes.
_DERIVED = ("dof_length", "bvh_aabb")

# Fields that a simulation may have for itself, but for the addresses of names and what is derived.
_FIELDS = tuple(sorted(name for name in MODEL_FIELDS if not name.startswith("name") and name not in _DERIVED))
_OPTION = "opt."


class MjcfSnapshot:
    """The values of all attributes in a tree of MJCF elements, with which the present ones are compared.

    MJCF elements do not tell whether they have changed, and writing the tree as XML takes a hundred times as long.
    """

    def __init__(self, root: mjcf.RootElement) -> None:
        """Stores the values in a model and everything that is attached to it."""
        self._elements = _descendants(root)
        self._attributes = [each for element in self._elements for each in element._attributes.values()]  # noqa: SLF001
        # The root has a fixed set of children.
        self._children = [element._children for element in self._elements if element.tag != "mujoco"]  # noqa: SLF001
        self._values = self._present_values()
        self._arrays = [value for value in self._values if isinstance(value, np.ndarray)]
        self._contents = self._present_contents()

    def is_outdated(self) -> bool:
        """Whether an attribute has been set, or an element added or removed, since the snapshot."""
        try:
            # Values that are the same object are equal; arrays that are not have no truth value.
            return self._present_values() != self._values or self._present_contents() != self._contents
        except ValueError:
            return True

    def _present_values(self) -> list[Any]:
        return [*map(operator.attrgetter("_value"), self._attributes)]

    def _present_contents(self) -> tuple[list[bytes], list[int]]:
        """Returns what can change while all values stay the same objects."""
        return [array.tobytes() for array in self._arrays], [*map(len, self._children)]


def _descendants(element: mjcf.Element) -> list[mjcf.Element]:
    return [element, *(each for child in element.all_children() for each in _descendants(child))]


def _field(model: mujoco.MjModel, name: str) -> Any:
    """Returns a field of a model: a view of its memory, or the number that an option is."""
    if name.startswith(_OPTION):
        return getattr(model.opt, name.removeprefix(_OPTION))
    return getattr(model, name)


def read_field(model: mujoco.MjModel, name: str) -> Any:
    """Returns a copy of a field of a model, such as `geom_friction` or `opt.gravity`."""
    return np.array(_field(model, name))


def write_field(model: mujoco.MjModel, name: str, value: Any) -> None:
    """Sets a field that `read_field` read."""
    if not name.startswith(_OPTION):
        getattr(model, name)[:] = value
    elif np.ndim(value):
        getattr(model.opt, name.removeprefix(_OPTION))[:] = value
    else:
        setattr(model.opt, name.removeprefix(_OPTION), np.asarray(value).item())


class ModelSnapshot:
    """The fields of a compiled model, with which the present ones are compared."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Stores the fields of a model."""
        self._model = model
        fields = {name: _field(model, name) for name in _FIELDS}
        # They stay valid, and to ask for them takes most of the time of a comparison.
        self._views = {name: value for name, value in fields.items() if isinstance(value, np.ndarray)}
        self._numbers = [name for name in fields if name not in self._views]
        self.update()

    def changed(self) -> list[str]:
        """Returns the names of the fields that have changed since the snapshot."""
        return [name for name, value in self._present_values().items() if value != self._values[name]]

    def update(self) -> None:
        """Takes the present fields as the snapshot."""
        self._values = self._present_values()

    def _present_values(self) -> dict[str, bytes | float]:
        values: dict[str, bytes | float] = {name: view.tobytes() for name, view in self._views.items()}
        for name in self._numbers:
            values[name] = _field(self._model, name)
        return values
