"""Kitchen Suite: the Franka kitchen as dm_control composer tasks.

`kitchen_suite.load` builds an environment of the suite. Importing this package registers the Gymnasium ids, such as
`KitchenSuite/Kettle-v1`. The parts are submodules, imported when first used:

- `suite`: domains and tasks; `environment`: the dm_env environment
- `gymnasium_env`, `vector_env`: Gymnasium environments, single and vectorised
- `entities`, `tasks`: robots, props and scenes, and what is to be done in them, for environments of your own
- `policies`, `experts`: policies by name; scripted experts, which need the extra `experts`
"""

from typing import TYPE_CHECKING as _TYPE_CHECKING

from kitchen_suite import lazy as _lazy
from kitchen_suite.suite import load as load

if _TYPE_CHECKING:
    from kitchen_suite import entities as entities
    from kitchen_suite import environment as environment
    from kitchen_suite import experts as experts
    from kitchen_suite import gymnasium_env as gymnasium_env
    from kitchen_suite import policies as policies
    from kitchen_suite import suite as suite
    from kitchen_suite import tasks as tasks
    from kitchen_suite import vector_env as vector_env

__version__ = "0.1.0"
__all__ = ["entities", "environment", "gymnasium_env", "load", "policies", "suite", "tasks", "vector_env"]

__getattr__, __dir__ = _lazy.attributes(
    __name__,
    [*__all__, "__version__", "experts"],
    {name: f"kitchen_suite.{name}:" for name in [*__all__, "experts"] if name != "load"},
)
