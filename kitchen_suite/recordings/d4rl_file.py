"""Recordings as HDF5 files of D4RL's layout, which many offline learners read. Needs the extra `record`."""

import importlib
from collections.abc import Iterable, Iterator
from pathlib import Path

import gymnasium
import numpy as np
from numpy.typing import NDArray

from kitchen_suite.gymnasium_env.base import SuiteEnv, suite_env
from kitchen_suite.recordings.exports import (
    ExportPlan,
    GrowingFile,
    datasets_of,
    episodes_between,
    further_observations,
    state_observations,
)
from kitchen_suite.rollouts.episode import EpisodeArrays
from kitchen_suite.rollouts.spec import EpisodeSpec
from kitchen_suite.tasks import GOALS
from kitchen_suite.tasks.kitchen.observation import OBJECT_POSITIONS, ROBOT_POSITIONS

# Of the kitchen's observation, what the 60 numbers of the Relay Policy Learning environments begin with.
POSITIONS = np.r_[ROBOT_POSITIONS, OBJECT_POSITIONS]
_ROBOT = len(np.r_[ROBOT_POSITIONS])


def relay_observations(environment: SuiteEnv, episode: EpisodeArrays) -> NDArray[np.float64]:
    """Returns observations of the kitchen `(T + 1, 60)`: 30 positions, and the goals in the same layout.

    Where no task is requested, goals are 0.
    """
    task, arrays = environment.composer_task, episode.arrays
    requested = arrays.get("observation/requested_tasks")
    observations = arrays["observation/observation"]
    goals = np.zeros((len(observations), POSITIONS.size))
    for number, name in enumerate(task.mdp.goals.tasks):
        if (key := f"observation/desired_goal/{name}") in arrays:
            elements = task.scene.elements(GOALS[name].prop, GOALS[name].joints)
            goals[:, _ROBOT + elements] = arrays[key] * (1.0 if requested is None else requested[:, [number]])
    return np.concatenate([observations[:, POSITIONS], goals], axis=1)


class D4RLPlan(ExportPlan):
    """A file `NAME.hdf5`: all control steps one after the other, `(n, ...)`.

    `observations` and `actions` before each step, `rewards`, `terminals`, `timeouts` and `next_observations` after it;
    of the kitchen with goals by task, observations are those of `relay_observations`, and `infos/observations` the
    suite's. What else is observed in numbers, such as requested tasks, is in `infos`.
    """

    title = "D4RL"
    suffix = ".hdf5"
    package = ("h5py", "record")

    def write(self, folder: Path, environment: gymnasium.Env, episodes: Iterable[EpisodeArrays], count: int) -> None:
        with GrowingFile(folder / self.path.name) as file:
            for episode in episodes:
                file.append(self.columns(environment, self.spec, episode))

    @classmethod
    def columns(cls, environment: gymnasium.Env, spec: EpisodeSpec, episode: EpisodeArrays) -> dict[str, NDArray]:
        arrays, observed = episode.arrays, state_observations(episode)
        is_relay = any(name.startswith("observation/desired_goal/") for name in arrays)
        observations = relay_observations(suite_env(environment), episode) if is_relay else observed
        ends = arrays["truncation"].copy()
        # An episode that was cut ends here as well.
        ends[-1] |= not arrays["termination"][-1]
        rows = {
            "observations": observations[:-1],
            "next_observations": observations[1:],
            "actions": arrays["action"],
            "rewards": arrays["reward"],
            "terminals": arrays["termination"],
            "timeouts": ends & ~arrays["termination"],
        }
        further = {f"infos/{key}": each[:-1] for key, each in further_observations(episode).items()}
        return {**rows, **({"infos/observations": observed[:-1]} if is_relay else {}), **further}

    @classmethod
    def read(cls, path: Path, count: int) -> Iterator[tuple[NDArray, dict[str, NDArray]]]:
        with importlib.import_module("h5py").File(path, "r") as file:
            ends = np.flatnonzero(file["terminals"][()] | file["timeouts"][()]) + 1
            for rows in episodes_between(datasets_of(file), ends, count):
                yield rows["actions"], rows
