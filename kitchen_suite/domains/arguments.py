"""The table of the arguments of a domain's environments, by name.

Checks of unknown arguments, defaults, the distribution of arguments among scene and task, and the tables of
docs/guide/arguments.md read it. An argument that a user's scene, task or environment adds is in it.
"""

import functools
from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from kitchen_suite import signatures

if TYPE_CHECKING:
    from kitchen_suite.entities import Scene
    from kitchen_suite.tasks import SuiteTask

Owner = Literal["environment", "scene", "task", "control"]


class Argument(NamedTuple):
    """An argument of an environment.

    Attributes:
      owner: which part it belongs to: the environment, the scene's builder, the task, or the task's control mode.
      default: the default; None for an argument without one, and for one of control modes, which may differ in it.
      takers: functions that take it, from the outermost one to the owner's, whose docstrings describe it.
    """

    owner: Owner
    default: Any
    takers: tuple[Callable[..., Any], ...]


@functools.cache
def table(
    scene: "Callable[..., Scene]", task: "type[SuiteTask]", *environments: Callable[..., Any]
) -> Mapping[str, Argument]:
    """Returns the arguments of environments by name.

    An argument of the environment's that the scene or the task takes as well is passed on, so it belongs to that one,
    with the environment's default.

    Args:
      scene: function that builds the scene.
      task: class of the task.
      *environments: method, or classes, that build the environment.
    """
    found: dict[str, Argument] = {}
    for owner, taker, by_position in _takers(scene, task, environments):
        for name, default in signatures.signature(taker, by_position).defaults.items():
            outer = found.get(name)
            if outer is None:
                found[name] = Argument(owner, None if owner == "control" else default, (taker,))
            elif outer.owner in (owner, "environment"):
                found[name] = Argument(owner, outer.default, (*outer.takers, taker))
    return MappingProxyType(found)


def _takers(
    scene: "Callable[..., Scene]", task: "type[SuiteTask]", environments: tuple[Callable[..., Any], ...]
) -> Iterator[tuple[Owner, Callable[..., Any], int]]:
    """Yields owners and functions, with the number of arguments of each that are passed by their position."""
    for environment in environments:
        for function in signatures.constructors(environment) if isinstance(environment, type) else (environment,):
            yield "environment", function, 1
    yield "scene", scene, 0
    for constructor in signatures.constructors(task):
        # The task itself and its scene.
        yield "task", constructor, 2
        if not signatures.signature(constructor).takes_more:
            return
    from kitchen_suite.tasks.pictures import Pictures

    yield "task", Pictures, 0
    for mode in task.control_modes.values():
        yield "control", mode, 0
