"""Kitchen Suite: the Franka kitchen as dm_control composer tasks.

`kitchen_suite.load` builds an environment of the suite. Importing this package registers the Gymnasium ids, such as
`KitchenSuite/Kettle-v1`.

Episodes are played by functions, of environments that an `EnvironmentSpec` describes:

- `play`: episodes of a policy; `record`: to a folder, which `convert` makes data sets of
- `Recording`: such a folder, its episodes, and the arrays of all their control steps
- `evaluate`: a policy under a published protocol; the `Evaluation` can be written, read, checked and compared
- `replay`: a recording, or the receipt of an evaluation, again
- `compare`: two policies on the same episodes; `compare_methods`: two methods, by policies of several training seeds

The parts are submodules, imported when first used:

- `suite`: domains and tasks; `environment`: the dm_env environment
- `gymnasium_env`, `vector_env`: Gymnasium environments, single and vectorised
- `entities`, `tasks`: robots, props and scenes, and what is to be done in them, for custom environments
- `grasping`: a hand that lifts an object, holds it and lets it go
- `policies`, `experts`: policies by name; scripted experts, which need the extra `experts`
"""

from typing import TYPE_CHECKING as _TYPE_CHECKING

from kitchen_suite import lazy as _lazy
from kitchen_suite._version import __version__ as __version__
from kitchen_suite.suite import load as load

if _TYPE_CHECKING:
    from kitchen_suite import entities as entities
    from kitchen_suite import environment as environment
    from kitchen_suite import experts as experts
    from kitchen_suite import grasping as grasping
    from kitchen_suite import gymnasium_env as gymnasium_env
    from kitchen_suite import policies as policies
    from kitchen_suite import suite as suite
    from kitchen_suite import tasks as tasks
    from kitchen_suite import vector_env as vector_env
    from kitchen_suite.datasets.convert import convert as convert
    from kitchen_suite.episodes.play import play as play
    from kitchen_suite.episodes.record import record as record
    from kitchen_suite.episodes.recording import Recording as Recording
    from kitchen_suite.episodes.spec import EnvironmentSpec as EnvironmentSpec
    from kitchen_suite.evaluation.compare import compare as compare
    from kitchen_suite.evaluation.evaluate import evaluate as evaluate
    from kitchen_suite.evaluation.evaluation import Evaluation as Evaluation
    from kitchen_suite.evaluation.methods import compare_methods as compare_methods
    from kitchen_suite.evaluation.replay import replay as replay

_MODULES = ["entities", "environment", "grasping", "gymnasium_env", "policies", "suite", "tasks", "vector_env"]
_MEMBERS = {
    "EnvironmentSpec": "kitchen_suite.episodes.spec:EnvironmentSpec",
    "Evaluation": "kitchen_suite.evaluation.evaluation:Evaluation",
    "Recording": "kitchen_suite.episodes.recording:Recording",
    "compare": "kitchen_suite.evaluation.compare:compare",
    "compare_methods": "kitchen_suite.evaluation.methods:compare_methods",
    "convert": "kitchen_suite.datasets.convert:convert",
    "evaluate": "kitchen_suite.evaluation.evaluate:evaluate",
    "play": "kitchen_suite.episodes.play:play",
    "record": "kitchen_suite.episodes.record:record",
    "replay": "kitchen_suite.evaluation.replay:replay",
}

__all__ = [
    "EnvironmentSpec",
    "Evaluation",
    "Recording",
    "compare",
    "compare_methods",
    "convert",
    "entities",
    "environment",
    "evaluate",
    "grasping",
    "gymnasium_env",
    "load",
    "play",
    "policies",
    "record",
    "replay",
    "suite",
    "tasks",
    "vector_env",
]

__getattr__, __dir__ = _lazy.attributes(
    __name__,
    [*__all__, "__version__", "experts"],
    {**{name: f"kitchen_suite.{name}:" for name in [*_MODULES, "experts"]}, **_MEMBERS},
)
