"""Goals of episodes that are taken from those of a recording, as some protocols have them."""

import contextlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kitchen_suite import checks
from kitchen_suite.entities.arms import FRANKA
from kitchen_suite.episodes.episode import unflatten
from kitchen_suite.episodes.recording import Recording
from kitchen_suite.episodes.spec import EnvironmentSpec
from kitchen_suite.evaluation import criteria
from kitchen_suite.evaluation.protocols import Goals
from kitchen_suite.gymnasium_env.base import suite_env


def draw_resets(
    goals: Mapping[str, Goals], seeds: Sequence[int], dataset: Path, domain_name: str
) -> dict[str, list[dict[str, Any]]]:
    """Returns the options of the resets of each condition's episodes, whose goals are taken from a recording.

    Args:
      goals: what the episodes of each condition ask for.
      seeds: of the episodes of each condition.
      dataset: folder of the recording.
      domain_name: of the episodes, which is that of the recording.

    Raises:
      OSError: there is no recording.
      ValueError: it is of another domain or robot, or has no episode with a goal.
    """
    recorded = _Recorded(dataset, domain_name)
    return {name: [recorded.options(take, seed) for seed in seeds] for name, take in goals.items()}


def check_franka(spec: EnvironmentSpec, what: str) -> None:
    """Raises a ValueError if the robot is another one: the states of `criteria` are those of the kitchen's own."""
    if (robot := spec.task_kwargs.get("robot", FRANKA)) != FRANKA:
        raise ValueError(f"{what} must be of the kitchen with robot {FRANKA!r}, not {checks.shown(robot)}")


class _Recorded:
    """The episodes of a recording."""

    def __init__(self, folder: Path, domain_name: str) -> None:
        """Opens the recording; raises an OSError if there is none, a ValueError if it is of another domain."""
        self._path, self._folder = folder, Recording.open(folder)
        spec = self._folder.spec
        if spec.domain_name != domain_name:
            raise ValueError(f"{folder} holds episodes of {spec.domain_name}, not of {domain_name}")
        if not self._folder.indices:
            raise ValueError(f"{folder} holds no episodes")
        check_franka(spec, f"the goals of {folder}")
        with contextlib.closing(spec.make_environment()) as environment:
            self._environment = environment
            self._observations = suite_env(environment).observations

    def options(self, take: Goals, seed: int) -> dict[str, Any]:
        """Returns the options of the reset of a seed, of an episode that is drawn, by a function of it."""
        # The 2 tells the random stream of an episode's goals from those of its environment and its policy.
        generator = np.random.default_rng((seed, 2))
        for index in generator.permutation(self._folder.indices).tolist():
            states, completed = self._episode(index)
            if (options := take(states, completed, generator)) is not None:
                return options
        raise ValueError(f"{self._path} holds no episode with a goal: nothing is completed, or nothing moves")

    def _episode(self, index: int) -> tuple[NDArray[np.float64], list[str]]:
        """Returns the states `(T + 1, 30)` of an episode, and the tasks that it completed, in order."""
        observation = unflatten(self._folder.load_fitting(index, self._environment).arrays, "observation")
        try:
            states = self._observations.recover_flat(observation)
        except (IndexError, KeyError, TypeError):
            states = None
        completed = self._folder.load_summary(index).metrics.get("tasks_completed")
        if states is None or not isinstance(completed, dict):
            raise ValueError(f"{self._path} holds no observations of the state, or no completed tasks")
        return states[:, criteria.STATE], sorted(completed, key=completed.__getitem__)
