"""Recordings in files of the layouts of other programs: D4RL, robomimic, OGBench, Diffusion Policy and BeT.

HDF5 files need the extra `record`, zarr stores the extra `zarr`; those of PyTorch are written without it.
"""

import importlib
import io
import itertools
import json
import pickle
import struct
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from kitchen_suite import files, suite
from kitchen_suite.gymnasium_env.base import SuiteEnv, suite_env
from kitchen_suite.names import DEFAULT_TASKS
from kitchen_suite.recordings import exports
from kitchen_suite.recordings.exports import ExportPlan
from kitchen_suite.rollouts.episode import EpisodeArrays
from kitchen_suite.rollouts.spec import EpisodeSpec
from kitchen_suite.tasks import GOALS
from kitchen_suite.tasks.kitchen.observation import OBJECT_POSITIONS, ROBOT_POSITIONS

# The 30 positions of an observation, the robot's and then the objects'; Relay Policy Learning's 60 numbers begin so.
POSITIONS = np.r_[ROBOT_POSITIONS, OBJECT_POSITIONS]

_ROBOT = len(np.r_[ROBOT_POSITIONS])

# In an HDF5 file, greatest sizes of an array of one control step beside its contents, and of a name in a list [bytes].
_OVERHEAD, _ROW_BYTES = 4096, 64

_VALIDATION = 10  # Of the layouts that have episodes for validation, one in ten is.
_GYM_TYPE = 2  # robomimic's type of environments of Gymnasium's interface.
_CHUNK = 1024  # Rows of a chunk of zarr.

# BeT's files of arrays, by name without suffix; its file of PyTorch's with the goals, and the tensor's numbers in it.
_ARRAYS = ("observations_seq", "actions_seq", "existence_mask")
_GOALS_FILE, _NUMBERS = "onehot_goals.pth", "archive/data/0"


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
    """Returns observations of the kitchen `(T + 1, 60)`: 30 positions, and their goals, 0 where none is requested."""
    task, arrays = environment.composer_task, episode.arrays
    requested = arrays.get("observation/requested_tasks")
    observations = arrays["observation/observation"]
    goals = np.zeros((len(observations), POSITIONS.size))
    for number, name in enumerate(task.mdp.goals.tasks):
        if (key := f"observation/desired_goal/{name}") in arrays:
            elements = task.scene.elements(GOALS[name].prop, GOALS[name].joints)
            goals[:, _ROBOT + elements] = arrays[key] * (1.0 if requested is None else requested[:, [number]])
    return np.concatenate([observations[:, POSITIONS], goals], axis=1)


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
            first = count // _VALIDATION
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


class OGBenchPlan(ExportPlan):
    """Files `NAME.npz` and `NAME-val.npz`, which `ogbench.utils.load_dataset` reads; the latter from ten episodes on.

    Episodes are one after the other, each with a row more than it has control steps: `observations`, `qpos` and `qvel`
    from the reset to the last step; `actions`, of which the last row repeats the one before; `terminals`, 1 in the last
    row alone. `rewards` and `completions` `(n,)` are those of the step that led to a row, 0 at the reset.
    What else is observed in numbers, such as requested tasks, is there by its name.
    """

    title = "OGBench"
    suffix = ".npz"

    @property
    def further(self) -> tuple[Path, ...]:
        return (_validation_file(self.path),)

    def write(self, folder: Path, environment: gymnasium.Env, episodes: Iterable[EpisodeArrays], count: int) -> None:
        validation = count // _VALIDATION
        remaining = iter(episodes)
        parts = {self.path: count - validation, _validation_file(self.path): validation}
        for path, number in parts.items():
            taken = itertools.islice(remaining, number)
            if rows := [self.columns(environment, self.spec, episode) for episode in taken]:
                columns: dict[str, Any] = _joined(rows)
                np.savez_compressed(folder / path.name, **columns)

    @classmethod
    def columns(cls, environment: gymnasium.Env, spec: EpisodeSpec, episode: EpisodeArrays) -> dict[str, NDArray]:
        arrays, states = episode.arrays, exports.physics_states(environment, spec, episode)
        size = suite_env(environment).environment.physics.model.nq
        terminals = np.zeros(episode.steps + 1, np.float32)
        terminals[-1] = 1.0
        return {
            "observations": exports.state_observations(episode),
            "actions": np.concatenate([arrays["action"], arrays["action"][-1:]]),
            "terminals": terminals,
            "qpos": states[:, 1 : 1 + size],
            "qvel": states[:, 1 + size :],
            "rewards": np.concatenate([[0.0], arrays["reward"]]),
            "completions": np.concatenate([[False], arrays["termination"]]),
            **exports.further_observations(episode),
        }

    @classmethod
    def read(cls, path: Path, count: int) -> Iterator[tuple[NDArray, dict[str, NDArray]]]:
        present = [each for each in (path, _validation_file(path)) if each.exists()]
        columns = _joined([files.unpack_arrays(each, count * files.MAX_ARRAY_BYTES) for each in present])
        for rows in exports.episodes_between(columns, np.flatnonzero(columns["terminals"]) + 1, count):
            yield rows["actions"][:-1], rows


def _validation_file(path: Path) -> Path:
    return path.with_name(f"{path.stem}-val{path.suffix}")


def _joined(parts: Sequence[Mapping[str, NDArray]]) -> dict[str, NDArray]:
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


class DiffusionPolicyPlan(ExportPlan):
    """A store `NAME.zarr`: arrays `(n, ...)` of all control steps in `data`, and `meta/episode_ends`.

    `data` has `obs`, the numbers observed before each step, `action`, `reward`, pictures and further numbers by name.
    """

    title = "Diffusion Policy"
    suffix = ".zarr"
    package = ("zarr", "zarr")
    holds_pictures = True

    def write(self, folder: Path, environment: gymnasium.Env, episodes: Iterable[EpisodeArrays], count: int) -> None:
        root = importlib.import_module("zarr").open_group(str(folder / self.path.name), mode="w")
        data, ends = root.create_group("data"), list[int]()
        for episode in episodes:
            rows = self.columns(environment, self.spec, episode)
            exports.check_room(folder, sum(2 * each.nbytes for each in rows.values()))
            for name, each in rows.items():
                if name not in data:
                    chunk = max(1, min(_CHUNK, 2**22 // max(1, each[:1].nbytes)))
                    shape = each.shape[1:]
                    data.create_dataset(name, shape=(0, *shape), chunks=(chunk, *shape), dtype=each.dtype)
                data[name].append(each)
            ends.append((ends[-1] if ends else 0) + episode.steps)
        root.create_group("meta").create_dataset("episode_ends", data=np.array(ends, np.int64))

    @classmethod
    def columns(cls, environment: gymnasium.Env, spec: EpisodeSpec, episode: EpisodeArrays) -> dict[str, NDArray]:
        arrays, observed = episode.arrays, exports.state_observations(episode)[:-1]
        names = (name for name in arrays if name.startswith("observation"))
        pictures = {exports.key_of(name): arrays[name][:-1] for name in names if arrays[name].ndim == 4}
        further = {key: each[:-1] for key, each in exports.further_observations(episode).items()}
        numbers = {"obs": observed} if observed.shape[1] else {}
        return {**numbers, "action": arrays["action"], "reward": arrays["reward"], **further, **pictures}

    @classmethod
    def read(cls, path: Path, count: int) -> Iterator[tuple[NDArray, dict[str, NDArray]]]:
        root = importlib.import_module("zarr").open_group(str(path), mode="r")
        for rows in exports.episodes_between(dict(root["data"].arrays()), root["meta/episode_ends"][:], count):
            yield rows["action"], rows


class BeTPlan(ExportPlan):
    """A folder `NAME` with arrays by time `T` and episode `N`, which end in zeros where an episode is shorter.

    `observations_seq.npy` `(T, N, 60)`, see `relay_observations`; `actions_seq.npy` `(T, N, 9)`; `existence_mask.npy`
    `(T, N)`, 1 for the steps of an episode; `onehot_goals.pth` `(T, N, 7)`, the task that is completed next, by
    `DEFAULT_TASKS`, and all zero after the last one. VQ-BeT, BESO and their descendants read them as well.
    """

    title = "BeT"

    def __init__(self, dataset_id: str, spec: EpisodeSpec, count: int, root: Path | None = None) -> None:
        super().__init__(dataset_id, spec, count, root)
        # No other domain has such observations.
        observed = spec.env_class.find_obs_type(spec.argument("obs_type"))
        if observed != "goal" or spec.argument("goal_format") != "dict":
            raise ValueError("a dataset for BeT is of the domain kitchen, observed with goals by task")

    def write(self, folder: Path, environment: gymnasium.Env, episodes: Iterable[EpisodeArrays], count: int) -> None:
        parts = [self.columns(environment, self.spec, episode) for episode in episodes]
        columns = {name: _side_by_side([part[name] for part in parts]) for name in parts[0]}
        exports.check_room(folder, sum(rows.nbytes for rows in columns.values()))
        target = folder / self.path.name
        target.mkdir()
        for name in _ARRAYS:
            np.save(target / f"{name}.npy", columns[name])
        (target / _GOALS_FILE).write_bytes(as_torch_file(columns["onehot_goals"]))

    @classmethod
    def columns(cls, environment: gymnasium.Env, spec: EpisodeSpec, episode: EpisodeArrays) -> dict[str, NDArray]:
        inner = suite_env(environment)
        return {
            "observations_seq": relay_observations(inner, episode)[:-1],
            "actions_seq": episode.arrays["action"],
            "existence_mask": np.ones(episode.steps, np.float32),
            "onehot_goals": _next_tasks(inner.composer_task.mdp.goals.tasks, episode),
        }

    @classmethod
    def read(cls, path: Path, count: int) -> Iterator[tuple[NDArray, dict[str, NDArray]]]:
        arrays = {name: np.load(path / f"{name}.npy", mmap_mode="r") for name in _ARRAYS}
        mask = arrays["existence_mask"]
        exports.check_count(mask.shape[1], count)
        with zipfile.ZipFile(path / _GOALS_FILE) as archive:
            goals = np.frombuffer(archive.read(_NUMBERS), "<f4")
        arrays["onehot_goals"] = goals.reshape(*mask.shape, len(DEFAULT_TASKS))
        for number in range(count):
            steps = np.count_nonzero(mask[:, number])
            columns = {name: np.array(rows[:steps, number]) for name, rows in arrays.items()}
            yield columns["actions_seq"], columns


def _next_tasks(tasks: tuple[str, ...], episode: EpisodeArrays) -> NDArray[np.float32]:
    """Returns for each control step `(T, 7)` which of BeT's tasks, those of FrankaKitchen-v1, is completed next."""
    completed = episode.arrays["info/completion_steps"][-1]
    goals, start = np.zeros((episode.steps, len(DEFAULT_TASKS)), np.float32), 0
    for number in np.argsort(completed, kind="stable"):
        if completed[number] >= 0 and tasks[number] in DEFAULT_TASKS:
            goals[start : completed[number], DEFAULT_TASKS.index(tasks[number])] = 1.0
            start = completed[number]
    return goals


def _side_by_side(parts: list[NDArray]) -> NDArray:
    """Returns arrays `(T_i, ...)` as one `(T, N, ...)`, with zeros where one is shorter."""
    joined = np.zeros((max(map(len, parts)), len(parts), *parts[0].shape[1:]), parts[0].dtype)
    for number, part in enumerate(parts):
        joined[: len(part), number] = part
    return joined


def as_torch_file(array: NDArray[np.float32]) -> bytes:
    """Returns a file that `torch.load` reads as a tensor: a zip archive with a pickle and the numbers."""
    array = np.ascontiguousarray(array, np.float32)
    strides = [stride // array.itemsize for stride in array.strides]
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("archive/data.pkl", _tensor_pickle(array.size, array.shape, strides))
        archive.writestr("archive/byteorder", "little")
        archive.writestr(_NUMBERS, array.astype("<f4").tobytes())
        archive.writestr("archive/version", "3\n")
    return buffer.getvalue()


def _tensor_pickle(size: int, shape: tuple[int, ...], strides: list[int]) -> bytes:
    """Returns the pickle of a tensor of float32 that refers to the numbers in `data/0`."""

    def integers(values: Iterable[int]) -> bytes:
        return b"(" + b"".join(b"J" + struct.pack("<i", value) for value in values) + b"t"

    def text(value: str) -> bytes:
        return b"X" + struct.pack("<I", len(value)) + value.encode()

    storage = b"(" + text("storage") + b"ctorch\nFloatStorage\n" + text("0") + text("cpu")
    storage += b"J" + struct.pack("<i", size) + b"tQ"
    arguments = b"(" + storage + b"K\x00" + integers(shape) + integers(strides) + b"\x89"
    arguments += b"ccollections\nOrderedDict\n)R" + b"t"
    return b"\x80\x02ctorch._utils\n_rebuild_tensor_v2\n" + arguments + b"R" + pickle.STOP
