"""Recordings as HDF5 files of D4RL's layout, which many offline learners read. Needs the extra `record`."""

import importlib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from kitchen_suite.datasets import exports
from kitchen_suite.datasets.exports import ExportPlan
from kitchen_suite.episodes.episode import EpisodeArrays
from kitchen_suite.episodes.spec import EpisodeSpec
from kitchen_suite.gymnasium_env.base import SuiteEnv, suite_env
from kitchen_suite.tasks import GOALS
from kitchen_suite.tasks.kitchen.observation import FRANKA_SLICES

_OVERHEAD = 4096  # In an HDF5 file, greatest size of an array of one control step beside its contents [bytes].

# The 30 positions of an observation, the robot's and then the objects'; Relay Policy Learning's 60 numbers begin so.
POSITIONS = FRANKA_SLICES.positions


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
        with new_file(folder / self.path.name) as file:
            for episode in episodes:
                append(file, self.columns(environment, self.spec, episode))

    @classmethod
    def columns(cls, environment: gymnasium.Env, spec: EpisodeSpec, episode: EpisodeArrays) -> dict[str, NDArray]:
        arrays, observed = episode.arrays, exports.state_observations(episode)
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
        further = {f"infos/{key}": each[:-1] for key, each in exports.further_observations(episode).items()}
        return {**rows, **({"infos/observations": observed[:-1]} if is_relay else {}), **further}

    @classmethod
    def read(cls, path: Path, count: int) -> Iterator[tuple[NDArray, dict[str, NDArray]]]:
        with importlib.import_module("h5py").File(path, "r") as file:
            ends = np.flatnonzero(file["terminals"][()] | file["timeouts"][()]) + 1
            for rows in exports.episodes_between(datasets_of(file), ends, count):
                yield rows["actions"], rows


def relay_observations(environment: SuiteEnv, episode: EpisodeArrays) -> NDArray[np.float64]:
    """Returns observations of the kitchen `(T + 1, 60)`: 30 positions, and their goals, 0 where none is requested.

    With another arm than the Franka they are more.
    """
    task, arrays = environment.composer_task, episode.arrays
    requested = arrays.get("observation/requested_tasks")
    observations = arrays["observation/observation"]
    parts = task.mdp.sensors.slices
    goals = np.zeros((len(observations), parts.positions.size))
    for number, name in enumerate(task.mdp.goals.tasks):
        if (key := f"observation/desired_goal/{name}") in arrays:
            elements = task.scene.elements(GOALS[name].prop, GOALS[name].joints)
            wanted = 1.0 if requested is None else requested[:, [number]]
            goals[:, parts.robot_positions.stop + elements] = arrays[key] * wanted
    return np.concatenate([observations[:, parts.positions], goals], axis=1)


def new_file(path: Path) -> Any:
    """Opens a new HDF5 file, in which an error of a full disk leaves nothing if rows are added by `append`."""
    exports.check_room(path.parent, _OVERHEAD)
    return importlib.import_module("h5py").File(path, "w")


def reserve(file: Any, size: int) -> None:
    """Raises an OSError unless the disk has room for `size` bytes more: HDF5 fails late, and with other errors."""
    file.flush()
    exports.check_room(Path(file.filename).parent, _OVERHEAD + size)


def append(file: Any, arrays: Mapping[str, NDArray]) -> None:
    """Adds rows to the datasets of an HDF5 file, which are made where they are missing."""
    reserve(file, sum(_OVERHEAD + 2 * rows.nbytes for rows in arrays.values()))
    for name, rows in arrays.items():
        if name not in file:
            shape = rows.shape[1:]
            chunks = (max(1, min(1024, 2**18 // max(1, rows[:1].nbytes))), *shape)
            options = {"maxshape": (None, *shape), "chunks": chunks, "compression": "gzip"}
            file.create_dataset(name, (0, *shape), rows.dtype, **options)
        dataset = file[name]
        dataset.resize(len(dataset) + len(rows), axis=0)
        dataset[len(dataset) - len(rows) :] = rows


def datasets_of(group: Any) -> dict[str, Any]:
    """Returns the datasets in a group of an HDF5 file, and in groups there, by their paths."""
    found: dict[str, Any] = {}
    group.visititems(lambda name, item: found.update({name: item} if hasattr(item, "dtype") else {}))
    return found
