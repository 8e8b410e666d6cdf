"""Episodes of Gymnasium environments as arrays by name, however their observations and infos are nested.

The names, for an episode of `T` control steps:
  `observation`, or `observation/<key>`, also with more keys: `(T + 1, ...)`, from the reset to the last step.
  `info/<key>`: `(T + 1, ...)`, likewise.
  `action`: `(T, n)` float32, as it was applied.
  `reward`: `(T,)` float64; `termination`, `truncation`: `(T,)` bool.
"""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.gymnasium_env.base import SuiteEnv
from kitchen_suite.rollouts.episode import Result
from kitchen_suite.tasks import KitchenTask

STEP_ARRAYS = ("action", "reward", "termination", "truncation")


@dataclasses.dataclass(frozen=True, kw_only=True)
class EpisodeArrays:
    """What happened in an episode.

    Attributes:
      index: its number in the recording.
      seed: what the environment was reset with; None where nobody knows.
      arrays: by the names above.
      seconds: its share of the time that the recording took [s].
    """

    index: int
    seed: int | None
    arrays: Mapping[str, NDArray]
    seconds: float = 0.0

    @property
    def steps(self) -> int:
        """Number of control steps."""
        return len(self.arrays["reward"])


def flatten(tree: Any, name: str) -> dict[str, Any]:
    """Leaves of nested dicts, by their path, which begins with `name`."""
    if not isinstance(tree, Mapping):
        return {name: tree}
    return {path: leaf for key, part in tree.items() for path, leaf in flatten(part, f"{name}/{key}").items()}


def nested(arrays: Mapping[str, NDArray], name: str) -> Any:
    """What `flatten` was given."""
    if name in arrays:
        return arrays[name]
    tree: dict[str, Any] = {}
    for path in arrays:
        if path.startswith(f"{name}/"):
            *keys, last = path.split("/")[1:]
            branch = tree
            for key in keys:
                branch = branch.setdefault(key, {})
            branch[last] = arrays[path]
    return tree


def results(environment: SuiteEnv, arrays: Mapping[str, NDArray]) -> dict[str, Result]:
    """What the environment's task reports of an episode, read from its infos."""
    task = environment.environment.task
    success = bool(arrays["info/is_success"][-1])
    if not isinstance(task, KitchenTask):
        return {
            "success": success,
            "success_at_any_time": bool(arrays["info/success_at_any_time"][-1]),
            "drawer_opening": float(arrays["info/drawer_opening"][-1]),
        }
    return {"success": success, "tasks_completed": task.mdp.goals.by_completion(arrays["info/completion_steps"][-1])}


def suite_view(environment: SuiteEnv) -> Callable[[Mapping[str, NDArray]], dict[str, NDArray]]:
    """Makes a function from an observation by the names above to that of the suite's own environment, in fresh arrays.

    Policies see the latter, so that they act the same in a recording as elsewhere.
    """
    task, spec = environment.environment.task, environment.environment.observation_spec()
    keys = [*task.task_observables]
    # The Gymnasium environment does not let the suite's own one show goals.
    goals = [key for key in keys if "_goal/" in key]
    sizes = [task.goals[key.partition("/")[2]].size if key in goals else spec[key].shape[0] for key in keys]
    ends = np.cumsum(sizes)[:-1]

    def view(row: Mapping[str, NDArray]) -> dict[str, NDArray]:
        if "observation" in row:
            parts = [row["observation"]]
        elif "observation/achieved_goal" in row:
            parts = [row[f"observation/{key}"] for key in ("observation", "achieved_goal", "desired_goal")]
        else:
            parts = [row[f"observation/{key}"] for key in ("observation", *goals)]
        return dict(zip(keys, np.split(np.concatenate(parts), ends), strict=True))

    return view
