"""The arguments that functions and classes take by name. Each signature is inspected once."""

import functools
import inspect
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

_BY_NAME = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)


class Signature(NamedTuple):
    """The arguments that a function or a class takes by name.

    Attributes:
      defaults: default of each argument by its name, in order; None where it has none.
      takes_more: whether arguments of any other name are taken as well.
    """

    defaults: Mapping[str, Any]
    takes_more: bool


@functools.cache
def signature(function: Callable[..., Any], by_position: int = 0) -> Signature:
    """Returns the signature of a function or a class without its first `by_position` arguments."""
    parameters = [*inspect.signature(function).parameters.values()]
    defaults = {
        parameter.name: None if parameter.default is inspect.Parameter.empty else parameter.default
        for parameter in parameters[by_position:]
        if parameter.kind in _BY_NAME
    }
    takes_more = any(parameter.kind == inspect.Parameter.VAR_KEYWORD for parameter in parameters)
    return Signature(MappingProxyType(defaults), takes_more)


def names(*functions: Callable[..., Any]) -> list[str]:
    """Returns the names of the arguments of several functions or classes, each once, in order."""
    return [*dict.fromkeys(name for function in functions for name in signature(function).defaults)]


def constructors(cls: type) -> list[Callable[..., Any]]:
    """Returns the constructors of a class and of its bases, the most specific one first."""
    return [vars(base)["__init__"] for base in cls.__mro__ if "__init__" in vars(base)]
