"""MuJoCo's model and data, with elements that are found by more names than the compiled ones."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Self

import mujoco

# By kind, such as `joint`, the compiled names of elements by further ones.
Names = Mapping[str, Mapping[str, str]]


def _finder(base: type, accessor: str, kind: str) -> Callable[..., Any]:
    """Returns a method like `joint` of the model or data, which also takes further names."""
    find = getattr(base, accessor)

    def method(self: Any, *args: Any, **kwargs: Any) -> Any:
        names = self.further_names.get(kind, {})
        args = tuple(names.get(each, each) if isinstance(each, str) else each for each in args)
        return find(self, *args, **{key: names.get(each, each) for key, each in kwargs.items()})

    method.__name__ = accessor
    method.__doc__ = f"As `{base.__name__}.{accessor}`, also by the further names."
    return method


class NamedModel(mujoco.MjModel):
    """A model whose joints, actuators, bodies and sites are also found by further names; its copies lack these.

    Attributes:
      further_names: these names.
    """

    further_names: Names = MappingProxyType({})

    @classmethod
    def copy_of(cls, model: mujoco.MjModel, names: Names) -> Self:
        """Returns a copy of a model with further names."""
        self = cls.__new__(cls)
        # The only way to fill an instance of a subclass: MuJoCo's functions that make models return MjModel itself.
        self.__setstate__(model.__getstate__())
        self.further_names = names
        return self

    joint = _finder(mujoco.MjModel, "joint", "joint")
    jnt = _finder(mujoco.MjModel, "jnt", "joint")
    actuator = _finder(mujoco.MjModel, "actuator", "actuator")
    body = _finder(mujoco.MjModel, "body", "body")
    site = _finder(mujoco.MjModel, "site", "site")


class NamedData(mujoco.MjData):
    """Data whose joints, actuators, bodies and sites are also found by further names; its copies lack these.

    Attributes:
      further_names: these names.
    """

    further_names: Names = MappingProxyType({})

    def __init__(self, model: NamedModel) -> None:
        super().__init__(model)
        self.further_names = model.further_names

    joint = _finder(mujoco.MjData, "joint", "joint")
    jnt = _finder(mujoco.MjData, "jnt", "joint")
    actuator = _finder(mujoco.MjData, "actuator", "actuator")
    body = _finder(mujoco.MjData, "body", "body")
    site = _finder(mujoco.MjData, "site", "site")
