"""Recordings as npz files of OGBench's layout."""

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from kitchen_suite import files
from kitchen_suite.datasets import exports
from kitchen_suite.datasets.exports import ExportPlan
from kitchen_suite.episodes.episode import EpisodeArrays
from kitchen_suite.episodes.spec import EpisodeSpec
from kitchen_suite.gymnasium_env.base import suite_env


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
        validation = count // exports.VALIDATION
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
