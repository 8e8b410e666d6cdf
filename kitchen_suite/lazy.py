"""Names of modules that are imported, or made, when they are first used."""

import pkgutil
from collections.abc import Callable, Iterable, Mapping
from typing import Any


def attributes(
    module: str, public: Iterable[str], values: Mapping[str, str | Callable[[], Any]]
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Returns the functions `__getattr__` and `__dir__` of a module, which offers `public` names to tab completion.

    `values` are by name the entry point of an object or module, `package.module:object` or `package.module:`, or a
    function without arguments that returns the value.
    """

    def get(name: str) -> Any:
        if name not in values:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        value = values[name]
        try:
            return pkgutil.resolve_name(value) if isinstance(value, str) else value()
        except ModuleNotFoundError as error:  # An extra is missing; `hasattr` expects an AttributeError.
            raise AttributeError(f"module {module!r} has no {name!r} here: {error}") from error

    return get, lambda: [*public]
