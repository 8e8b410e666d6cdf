"""Recordings as zarr stores of Diffusion Policy's replay buffer. Needs the extra `zarr`."""

import importlib
from collections.abc import Iterable
from pathlib import Path

import gymnasium
import numpy as np

from kitchen_suite import files
from kitchen_suite.recordings.exports import ExportPlan, further_observations, key_of, state_observations
from kitchen_suite.rollouts.episode import EpisodeArrays

# Rows of a chunk.
_CHUNK = 1024


class DiffusionPolicyPlan(ExportPlan):
    """A store `NAME.zarr`: arrays `(n, ...)` of all control steps in `data`, and `meta/episode_ends`.

    `data` has `obs`, the numbers observed before each step, `action`, `reward`, the pictures by name, and what else is
    observed in numbers.
    """

    title = "Diffusion Policy"
    suffix = ".zarr"
    package = ("zarr", "zarr")
    holds_pictures = True

    def write(self, folder: Path, environment: gymnasium.Env, episodes: Iterable[EpisodeArrays], count: int) -> None:
        zarr = importlib.import_module("zarr")
        root = zarr.open_group(str(folder / self.path.name), mode="w")
        data, ends = root.create_group("data"), list[int]()
        for episode in episodes:
            arrays = episode.arrays
            pictures = {
                key_of(name): rows[:-1]
                for name, rows in arrays.items()
                if name.startswith("observation") and rows.ndim == 4
            }
            observed = state_observations(episode)[:-1]
            further = {key: each[:-1] for key, each in further_observations(episode).items()}
            numbers = {"obs": observed} if observed.shape[1] else {}
            rows = {**numbers, "action": arrays["action"], "reward": arrays["reward"], **further, **pictures}
            files.reserve(folder / "reserved", sum(2 * each.nbytes for each in rows.values()))
            (folder / "reserved").unlink()
            for name, each in rows.items():
                if name not in data:
                    chunk = max(1, min(_CHUNK, 2**22 // max(1, each[:1].nbytes)))
                    shape = each.shape[1:]
                    data.create_dataset(name, shape=(0, *shape), chunks=(chunk, *shape), dtype=each.dtype)
                data[name].append(each)
            ends.append((ends[-1] if ends else 0) + episode.steps)
        root.create_group("meta").create_dataset("episode_ends", data=np.array(ends, np.int64))
