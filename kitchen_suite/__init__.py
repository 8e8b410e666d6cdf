"""Kitchen Suite: the Franka kitchen as dm_control composer tasks.

`kitchen_suite.load` builds an environment of the suite. Importing this package registers the Gymnasium ids, such as
`KitchenSuite/Kettle-v1`. The parts are submodules, imported when first used:

- `suite`: domains and tasks; `environment`: the dm_env environment
- `gymnasium_env`, `vector_env`: Gymnasium environments, single and vectorised
- `entities`, `tasks`: robots, props and scenes, and what is to be done in them, for environments of your own
- `policies`, `experts`: policies by name; scripted experts, which need the extra `experts`
"""

import pathlib as _pathlib

__version__ = "0.1.0"
__all__ = ["entities", "environment", "gymnasium_env", "load", "policies", "suite", "tasks", "vector_env"]

# An installed copy contains `entities` and `tasks`. In a checkout they stand beside this folder, in which case their
# parent folder is added to where subpackages are searched for.
_parent = _pathlib.Path(__file__).resolve().parent.parent
if (_parent / "setup.cfg").is_file():
    __path__.append(str(_parent))

from kitchen_suite import lazy as _lazy  # noqa: E402
from kitchen_suite.suite import load as load  # noqa: E402

__getattr__, __dir__ = _lazy.attributes(
    __name__,
    [*__all__, "__version__", "experts"],
    {name: f"kitchen_suite.{name}:" for name in [*__all__, "experts"] if name != "load"},
)
