"""Kitchen Suite: the Franka kitchen as dm_control composer tasks.

`kitchen_suite.load` builds an environment of the suite. Importing this package registers the Gymnasium ids, such as
`KitchenSuite/Kettle-v1`. The parts are submodules, imported when first used:

- `suite`: domains and tasks; `environment`: the dm_env environment
- `gymnasium_env`, `vector_env`: Gymnasium environments, single and vectorised
- `entities`, `tasks`: robots, props and scenes, and what is to be done in them, for environments of your own
- `policies`, `experts`: policies by name; scripted experts, which need the extra `experts`
"""

import importlib as _importlib
import pathlib as _pathlib
from typing import TYPE_CHECKING as _TYPE_CHECKING
from typing import Any as _Any

if _TYPE_CHECKING:
    from kitchen_suite.suite import load as load

__version__ = "0.1.0"
__all__ = ["entities", "environment", "gymnasium_env", "load", "policies", "suite", "tasks", "vector_env"]

# An installed copy contains `entities` and `tasks`. In a checkout they stand beside this folder, in which case their
# parent folder is added to where subpackages are searched for.
_parent = _pathlib.Path(__file__).resolve().parent.parent
if (_parent / "setup.cfg").is_file():
    __path__.append(str(_parent))


def __getattr__(name: str) -> _Any:
    """Imports a submodule when it is first used."""
    if name == "load":
        return _importlib.import_module("kitchen_suite.suite").load
    if name in __dir__():
        try:
            return _importlib.import_module(f"kitchen_suite.{name}")
        except ModuleNotFoundError as error:  # An extra is missing; `hasattr` expects an AttributeError.
            raise AttributeError(f"module 'kitchen_suite' has no {name!r} here: {error}") from error
    raise AttributeError(f"module 'kitchen_suite' has no attribute {name!r}")


def __dir__() -> list[str]:
    return [*__all__, "__version__", "experts"]


# Registers the ids. It imports Gymnasium, but neither dm_control nor MuJoCo.
_importlib.import_module("kitchen_suite.gymnasium_env")
