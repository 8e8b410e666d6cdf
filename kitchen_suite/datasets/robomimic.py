"""Recordings as HDF5 files of robomimic's layout. Needs the extra `record`."""

import importlib
import json
from collections.abc import Iterable, Iterator
from pathlib import Path

import gymnasium
import numpy as np
from numpy.typing import NDArray

from kitchen_suite import files, suite
from kitchen_suite.datasets import exports
from kitchen_suite.datasets.d4rl import append, datasets_of, new_file, reserve
from kitchen_suite.datasets.exports import ExportPlan
from kitchen_suite.episodes.episode import EpisodeArrays
from kitchen_suite.episodes.spec import EpisodeSpec
from kitchen_suite.gymnasium_env.base import suite_env

_GYM_TYPE = 2  # robomimic's type of environments of Gymnasium's interface.
_ROW_BYTES = 64  # Greatest size of a name in a list of an HDF5 file.


class RobomimicPlan(ExportPlan):
    """A file `NAME.hdf5`: a group `data/demo_I` for each episode, and names of demonstrations in `mask`.

    A group has `actions`, `rewards`, `dones` (1 in the last step), `terminations`, `truncations`, `obs/KEY` and
    `next_obs/KEY`, keys of the observation with underscores for slashes, and `states`: time, qpos, qvel before a step.
    """

    title = "robomimic"
    suffix = ".hdf5"
    package = ("h5py", "record")
    holds_pictures = True

    def write(self, folder: Path, environment: gymnasium.Env, episodes: Iterable[EpisodeArrays], count: int) -> None:
        spec, total = self.spec, 0
        with new_file(folder / self.path.name) as file:
            data = file.create_group("data")
            for number, episode in enumerate(episodes):
                columns = self.columns(environment, spec, episode)
                append(file, {f"data/demo_{number}/{name}": rows for name, rows in columns.items()})
                group = data[f"demo_{number}"]
                group.attrs["num_samples"], group.attrs["seed"] = episode.steps, episode.seed
                model = suite_env(environment).composer_task.root_entity.mjcf_model.to_xml_string()
                reserve(file, len(model.encode()))
                group.attrs["model_file"] = model
                total += episode.steps
            reserve(file, _ROW_BYTES * count)
            data.attrs["total"] = total
            own = suite.task_arguments(spec.domain_name, spec.task_name)
            arguments = {"env_name": suite.find_domain(spec.domain_name).env_id, "type": _GYM_TYPE}
            data.attrs["env_args"] = json.dumps({**arguments, "env_kwargs": {**own, **spec.task_kwargs}})
            first = count // exports.VALIDATION
            for name, numbers in {"train": range(first, count), "valid": range(first)}.items():
                if numbers:
                    file[f"mask/{name}"] = [f"demo_{number}".encode() for number in numbers]

    @classmethod
    def columns(cls, environment: gymnasium.Env, spec: EpisodeSpec, episode: EpisodeArrays) -> dict[str, NDArray]:
        arrays, states = episode.arrays, exports.physics_states(environment, spec, episode)
        observed = {exports.key_of(name): rows for name, rows in arrays.items() if name.startswith("observation")}
        return {
            "actions": arrays["action"],
            "rewards": arrays["reward"],
            "dones": np.arange(1, episode.steps + 1) // episode.steps,
            "terminations": arrays["termination"],
            "truncations": arrays["truncation"],
            "states": states[:-1],
            **{f"obs/{key}": rows[:-1] for key, rows in observed.items()},
            **{f"next_obs/{key}": rows[1:] for key, rows in observed.items()},
        }

    @classmethod
    def read(cls, path: Path, count: int) -> Iterator[tuple[NDArray, dict[str, NDArray]]]:
        with importlib.import_module("h5py").File(path, "r") as file:
            data = file["data"]
            exports.check_count(len(data), count)
            for number in range(count):
                datasets = datasets_of(data[f"demo_{number}"])
                files.check_size(sum(rows.nbytes for rows in datasets.values()), files.MAX_ARRAY_BYTES)
                columns = {name: rows[()] for name, rows in datasets.items()}
                yield columns["actions"], columns
