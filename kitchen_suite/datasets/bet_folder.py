"""Recordings as folders of the layout of Behavior Transformers. Needs no PyTorch."""

import io
import pickle
import struct
import zipfile
from collections.abc import Iterable, Iterator
from pathlib import Path

import gymnasium
import numpy as np
from numpy.typing import NDArray

from kitchen_suite.datasets import exports
from kitchen_suite.datasets.d4rl import relay_observations
from kitchen_suite.datasets.exports import ExportPlan
from kitchen_suite.episodes.episode import EpisodeArrays
from kitchen_suite.episodes.spec import EpisodeSpec
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.names import DEFAULT_TASKS

# BeT's files of arrays, by name without suffix; its file of PyTorch's with the goals, and the tensor's numbers in it.
_ARRAYS = ("observations_seq", "actions_seq", "existence_mask")
_GOALS_FILE, _NUMBERS = "onehot_goals.pth", "archive/data/0"


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
