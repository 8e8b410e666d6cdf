"""Recordings as npz files of OGBench's layout."""

import contextlib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kitchen_suite import files
from kitchen_suite.datasets import columns
from kitchen_suite.episodes.episode import Episode
from kitchen_suite.episodes.spec import EpisodeSpec
from kitchen_suite.gymnasium_env.base import SuiteEnv, suite_env


def write(path: Path, spec: EpisodeSpec, episodes: Iterable[Episode]) -> None:
    """Writes `NAME.npz` and, from ten episodes on, `NAME-val.npz`, which `ogbench.utils.load_dataset` reads.

    Episodes are one after the other, each with a row more than it has control steps: `observations`, `qpos` and `qvel`
    from the reset to the last step; `actions`, of which the last row repeats the one before; `terminals`, 1 in the last
    row alone. `rewards` and `completions` `(n,)` are those of the step that led to a row, 0 at the reset.
    What else is observed in numbers, such as requested tasks, is there by its name.

    Raises a ValueError for episodes with pictures or without physics states, and a FileExistsError if one of the files
    exists already.
    """
    columns.check_no_pictures(spec, "OGBench")
    validation_path = path.with_name(f"{path.stem}-val{path.suffix}")
    if validation_path.exists():
        raise FileExistsError(f"{validation_path} exists already, and is never replaced: name another dataset")
    with contextlib.closing(spec.make_environment()) as environment:
        rows = [columns_of(episode, suite_env(environment)) for episode in episodes]
    training = len(rows) - len(rows) // columns.VALIDATION
    with contextlib.ExitStack() as stack:
        # The first file gets its name last.
        for each, part in ((path, rows[:training]), (validation_path, rows[training:])):
            if part:
                partial = stack.enter_context(files.atomic_create(each))
                partial.write_bytes(files.pack_arrays(_joined(part)))


def columns_of(episode: Episode, environment: SuiteEnv) -> dict[str, NDArray]:
    """Returns the arrays that a dataset holds of an episode of such an environment, by their names there."""
    model = environment.environment.physics.model
    arrays, states = episode.arrays, columns.physics_states(episode)
    terminals = np.zeros(episode.steps + 1, np.float32)
    terminals[-1] = 1.0
    return {
        "observations": columns.state_observations(episode),
        "actions": np.concatenate([arrays["action"], arrays["action"][-1:]]),
        "terminals": terminals,
        "qpos": states[:, : model.nq],
        "qvel": states[:, model.nq : model.nq + model.nv],
        "rewards": np.concatenate([[0.0], arrays["reward"]]),
        "completions": np.concatenate([[False], arrays["termination"]]),
        **columns.extra_observations(episode),
    }


def _joined(parts: Sequence[Mapping[str, NDArray]]) -> dict[str, Any]:
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
