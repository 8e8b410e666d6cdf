"""Recordings as zarr stores of Diffusion Policy's layout."""

import importlib
from collections.abc import Iterable, Iterator
from pathlib import Path

import gymnasium
import numpy as np
from numpy.typing import NDArray

from kitchen_suite.datasets import exports
from kitchen_suite.datasets.exports import ExportPlan
from kitchen_suite.episodes.episode import EpisodeArrays
from kitchen_suite.episodes.spec import EpisodeSpec

_CHUNK = 1024  # Rows of a chunk of zarr.


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
