"""Recordings as HDF5 files of D4RL's layout, which many offline learners read. Needs the extra `record`."""

import contextlib
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.datasets import columns, hdf5
from kitchen_suite.episodes.episode import Episode
from kitchen_suite.episodes.spec import EpisodeSpec
from kitchen_suite.episodes.transitions import Transitions
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.tasks import GOALS
from kitchen_suite.tasks.kitchen.observation import FRANKA_SLICES
from kitchen_suite.tasks.task import SuiteTask

# The 30 positions of an observation, the robot's and then the objects'; Relay Policy Learning's 60 numbers begin so.
POSITIONS = FRANKA_SLICES.positions


def write(path: Path, spec: EpisodeSpec, episodes: Iterable[Episode]) -> None:
    """Writes a file with all control steps one after the other, `(n, ...)`.

    `observations` and `actions` before each step, `rewards`, `terminals`, `timeouts` and `next_observations` after it;
    of the kitchen with goals by task, observations are those of `relay_observations`, and `infos/observations` the
    suite's. What else is observed in numbers, such as requested tasks, is in `infos`.

    Raises a ValueError for episodes with pictures, a FileExistsError if the file exists already, and an ImportError
    without h5py.
    """
    columns.check_no_pictures(spec, "D4RL")
    with hdf5.new_file(path) as file, contextlib.closing(spec.make_environment()) as environment:
        task = suite_env(environment).composer_task
        for episode in episodes:
            hdf5.append(file, columns_of(Transitions.of([episode]), task))


def columns_of(transitions: Transitions, task: SuiteTask) -> dict[str, NDArray]:
    """Returns the arrays that a dataset holds of control steps in a task, by their names there."""
    arrays, rows = transitions.arrays, transitions.rows
    observed = columns.state_observations(arrays)
    is_relay = any(name.startswith("observation/desired_goal/") for name in arrays)
    observations = relay_observations(arrays, task) if is_relay else observed
    found = {
        "observations": observations[rows],
        "next_observations": observations[rows + 1],
        "actions": transitions.actions,
        "rewards": transitions.rewards,
        "terminals": transitions.terminations,
        # An episode that was cut ends here as well.
        "timeouts": (transitions.truncations | transitions.ends) & ~transitions.terminations,
    }
    extra = {f"infos/{key}": each[rows] for key, each in columns.extra_observations(arrays).items()}
    return {**found, **({"infos/observations": observed[rows]} if is_relay else {}), **extra}


def relay_observations(arrays: Mapping[str, NDArray], task: SuiteTask) -> NDArray[np.float64]:
    """Returns observations of the kitchen `(n, 60)`: 30 positions, and their goals, 0 where none is requested.

    With another arm than the Franka they are more.

    Args:
      arrays: by the names of an episode.
      task: of the environment.
    """
    requested = arrays.get("observation/requested_tasks")
    observations = arrays["observation/observation"]
    parts = task.mdp.sensors.slices
    goals = np.zeros((len(observations), parts.positions.size))
    for number, name in enumerate(task.mdp.goals.tasks):
        if (key := f"observation/desired_goal/{name}") in arrays:
            elements = task.scene.elements(GOALS[name].prop, GOALS[name].joints)
            wanted = 1.0 if requested is None else requested[:, [number]]
            goals[:, parts.robot_positions.stop + elements] = arrays[key] * wanted
    return np.concatenate([observations[:, parts.positions], goals], axis=1)
