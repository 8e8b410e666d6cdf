"""Arrays of episodes that the datasets of several programs have; arguments are arrays by the names of an episode."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.episodes.episode import PHYSICS_STATE
from kitchen_suite.episodes.spec import EpisodeSpec
from kitchen_suite.gymnasium_env.observations import has_pictures

VALIDATION = 10  # One episode in ten is for validation, in the layouts that have such.


def check_no_pictures(spec: EpisodeSpec, title: str) -> None:
    """Raises a ValueError for episodes with pictures, which the datasets of a program do not hold."""
    if has_pictures(spec.env_class.find_obs_type(spec.argument("obs_type"))):
        raise ValueError(f"a dataset for {title} holds no pictures: record other observations")


def state_observations(arrays: Mapping[str, NDArray]) -> NDArray:
    """Returns the observed numbers `(n, m)`, without goals and pictures."""
    if "observation/observation" in arrays:
        return arrays["observation/observation"]
    observed = [rows for name, rows in arrays.items() if name.startswith("observation")]
    parts = [rows for rows in observed if rows.ndim == 2]
    return np.concatenate(parts, axis=1) if parts else np.empty((len(observed[0]), 0))


def extra_observations(arrays: Mapping[str, NDArray]) -> dict[str, NDArray]:
    """Returns what else is observed in numbers, such as the tasks that are requested, by name; not goals of tasks."""
    names = [name for name, rows in arrays.items() if name.startswith("observation/") and rows.ndim == 2]
    left_out = ("observation/observation", "observation/achieved_goal/", "observation/desired_goal/")
    has_state = "observation/observation" in arrays
    return {key_of(name): arrays[name] for name in names if has_state and not name.startswith(left_out)}


def key_of(name: str) -> str:
    """Returns the name of an array of observations as a key without slashes and blanks."""
    return name.removeprefix("observation/").replace("/", "_").replace(" ", "_")


def physics_states(arrays: Mapping[str, NDArray]) -> NDArray[np.float64]:
    """Returns qpos, qvel and act `(n, nq + nv + na)`; a ValueError if they were not recorded."""
    if PHYSICS_STATE not in arrays:
        raise ValueError(
            f"the recording lacks the array {PHYSICS_STATE}, as those of earlier versions do: kitchen-record records "
            "the same episodes with it, in another folder"
        )
    return arrays[PHYSICS_STATE]
