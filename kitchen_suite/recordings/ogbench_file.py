"""Recordings as npz files of OGBench's layout."""

import itertools
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.recordings.exports import ExportPlan, further_observations, physics_states, state_observations
from kitchen_suite.rollouts.episode import EpisodeArrays

# One episode in ten is for validation; of fewer there is no file for it.
_VALIDATION = 10


class OGBenchPlan(ExportPlan):
    """Files `NAME.npz` and `NAME-val.npz`, which `ogbench.utils.load_dataset` reads.

    Episodes are one after the other, each with a row more than it has control steps: `observations`, `qpos` and `qvel`
    from the reset to the last step; `actions`, of which the last row repeats the one before; `terminals`, 1 in the last
    row alone. `rewards` and `completions` `(n,)` are those of the step that led to a row, 0 at the reset.
    What else is observed in numbers, such as requested tasks, is there by its name.
    """

    title = "OGBench"
    suffix = ".npz"

    @property
    def further(self) -> tuple[Path, ...]:
        return (self.folder / f"{self.name}-val.npz",)

    def write(self, folder: Path, environment: gymnasium.Env, episodes: Iterable[EpisodeArrays], count: int) -> None:
        validation = count // _VALIDATION
        remaining = iter(episodes)
        parts = {self.name: count - validation, f"{self.name}-val": validation}
        for name, number in parts.items():
            rows = [self._rows(environment, episode) for episode in itertools.islice(remaining, number)]
            if rows:
                columns: dict[str, Any] = {key: np.concatenate([each[key] for each in rows]) for key in rows[0]}
                np.savez_compressed(folder / f"{name}.npz", **columns)

    def _rows(self, environment: gymnasium.Env, episode: EpisodeArrays) -> dict[str, NDArray]:
        arrays, states = episode.arrays, physics_states(environment, self.spec, episode)
        size = suite_env(environment).environment.physics.model.nq
        terminals = np.zeros(episode.steps + 1, np.float32)
        terminals[-1] = 1.0
        return {
            "observations": state_observations(episode),
            "actions": np.concatenate([arrays["action"], arrays["action"][-1:]]),
            "terminals": terminals,
            "qpos": states[:, 1 : 1 + size],
            "qvel": states[:, 1 + size :],
            "rewards": np.concatenate([[0.0], arrays["reward"]]),
            "completions": np.concatenate([[False], arrays["termination"]]),
            **further_observations(episode),
        }
