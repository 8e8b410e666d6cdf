"""Recordings as HDF5 files of robomimic's layout. Needs the extra `record`."""

import contextlib
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kitchen_suite import files, suite
from kitchen_suite.datasets import columns, hdf5
from kitchen_suite.datasets.models import model_writer
from kitchen_suite.episodes.episode import Episode
from kitchen_suite.episodes.spec import EpisodeSpec
from kitchen_suite.gymnasium_env.base import SuiteEnv, suite_env

_GYM_TYPE = 2  # robomimic's type of environments of Gymnasium's interface.


def write(path: Path, spec: EpisodeSpec, episodes: Iterable[Episode]) -> None:
    """Writes a file with a group `data/demo_I` for each episode, and names of demonstrations in `mask`.

    A group has `actions`, `rewards`, `dones` (1 in the last step), `terminations`, `truncations`, `obs/KEY` and
    `next_obs/KEY`, keys of the observation with underscores for slashes, and `states`: time, qpos, qvel before a step.
    Its attribute `model_file` is MJCF without files of the model that the states are of, without visual geoms.
    `env_args` of `data` has the arguments with which `gymnasium.make` makes the environment of the recording.

    Raises a ValueError for episodes without physics states, a FileExistsError if the file exists already, and an
    ImportError without h5py.
    """
    total, count = 0, 0
    with (
        hdf5.new_file(path) as file,
        contextlib.closing(spec.make_environment()) as environment,
        model_writer(spec) as model_of,
    ):
        inner, data = suite_env(environment), file.create_group("data")
        for number, episode in enumerate(episodes):
            hdf5.append(data, {f"demo_{number}/{name}": rows for name, rows in columns_of(episode, inner).items()})
            group = data[f"demo_{number}"]
            group.attrs["num_samples"] = episode.steps
            group.attrs["seed"] = episode.seed
            group.attrs["model_file"] = model_of(episode)
            total += episode.steps
            count += 1
        data.attrs["total"] = total
        own = suite.task_arguments(spec.domain_name, spec.task_name)
        arguments = {
            # Gymnasium imports the module before the colon, which registers the environment.
            "env_name": f"kitchen_suite:{suite.find_domain(spec.domain_name).env_id}",
            "type": _GYM_TYPE,
            "env_kwargs": {**own, **spec.task_kwargs, "max_episode_steps": spec.max_episode_steps},
        }
        data.attrs["env_args"] = files.json_text(arguments)
        first = count // columns.VALIDATION
        for name, numbers in {"train": range(first, count), "valid": range(first)}.items():
            if numbers:
                file[f"mask/{name}"] = [f"demo_{number}".encode() for number in numbers]


def columns_of(episode: Episode, environment: SuiteEnv) -> dict[str, NDArray]:
    """Returns the arrays that a dataset holds of an episode of such an environment, by their names there."""
    arrays = episode.arrays
    observed = {columns.key_of(name): rows for name, rows in arrays.items() if name.startswith("observation")}
    return {
        "actions": arrays["action"],
        "rewards": arrays["reward"],
        "dones": np.arange(1, episode.steps + 1) // episode.steps,
        "terminations": arrays["termination"],
        "truncations": arrays["truncation"],
        "states": _states(episode, environment)[:-1],
        **{f"obs/{key}": rows[:-1] for key, rows in observed.items()},
        **{f"next_obs/{key}": rows[1:] for key, rows in observed.items()},
    }


def _states(episode: Episode, environment: SuiteEnv) -> NDArray[np.float64]:
    """Returns time [s], qpos and qvel `(T + 1, 1 + nq + nv)` of an episode."""
    model = environment.environment.physics.model
    substeps = environment.composer_task.physics_steps_per_control_step
    # MuJoCo adds its timestep to the time again and again, and rounds as often.
    times = np.cumsum([0.0, *[model.opt.timestep] * (substeps * episode.steps)])[::substeps]
    return np.column_stack([times, columns.physics_states(episode.arrays)[:, : model.nq + model.nv]])
