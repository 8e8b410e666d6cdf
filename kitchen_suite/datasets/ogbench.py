"""Recordings as npz files of OGBench's layout."""

import contextlib
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kitchen_suite import files
from kitchen_suite.datasets import columns
from kitchen_suite.episodes.episode import Episode
from kitchen_suite.episodes.spec import EpisodeSpec
from kitchen_suite.episodes.transitions import Transitions
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
        transitions = Transitions.of(episodes)
        rows = columns_of(transitions, suite_env(environment))
    lengths = transitions.lengths
    training = len(lengths) - len(lengths) // columns.VALIDATION
    split = int(lengths[:training].sum()) + training
    parts = {path: slice(split)}
    if training < len(lengths):
        parts[validation_path] = slice(split, None)
    with contextlib.ExitStack() as stack:
        # The first file gets its name last.
        for each, part in parts.items():
            partial = stack.enter_context(files.atomic_create(each))
            partial.write_bytes(files.pack_arrays({name: column[part] for name, column in rows.items()}))


def columns_of(transitions: Transitions, environment: SuiteEnv) -> dict[str, NDArray]:
    """Returns the arrays that a dataset holds of episodes of such an environment, by their names there."""
    model = environment.environment.physics.model
    states = columns.physics_states(transitions.arrays)
    ends = np.cumsum(transitions.lengths)
    starts = ends - transitions.lengths
    actions = transitions.actions
    return {
        "observations": columns.state_observations(transitions.arrays),
        "actions": np.insert(actions, ends, actions[ends - 1], axis=0),
        "terminals": np.insert(np.zeros(len(actions), np.float32), ends, 1.0),
        "qpos": states[:, : model.nq],
        "qvel": states[:, model.nq : model.nq + model.nv],
        "rewards": np.insert(transitions.rewards, starts, 0.0),
        "completions": np.insert(transitions.terminations, starts, False),
        **columns.extra_observations(transitions.arrays),
    }
