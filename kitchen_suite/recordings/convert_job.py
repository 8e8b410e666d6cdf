"""The work of `kitchen-convert`."""

import collections
import dataclasses
from typing import Any

import tabulate
from tqdm import tqdm

from kitchen_suite.entities import build_kitchen_scene
from kitchen_suite.recordings import human_data
from kitchen_suite.recordings.conversion import convert
from kitchen_suite.recordings.minari_dataset import minari_root
from kitchen_suite.recordings.settings import ConvertSettings
from kitchen_suite.rollouts.episode import EpisodeStats
from kitchen_suite.rollouts.folder import RecordingFolder
from kitchen_suite.rollouts.spec import RecordingSpec
from kitchen_suite.tasks import KitchenTask

# Any number of the seven tasks is asked; episodes go on after their last completion.
_TASK = "all"
_TASK_KWARGS: dict[str, Any] = {"tasks_per_episode": [1, 7], "terminate_on_tasks_completed": False}

# Stands for the policy in the recording.
_POLICY = "human"


class ConvertJob:
    """Converts demonstrations to a recording."""

    failures = (OSError,)
    usage_errors = (ValueError,)

    def __init__(self, settings: ConvertSettings) -> None:
        """Opens the data, and starts the recording.

        Raises:
          ImportError: an extra is missing.
          OSError: the data cannot be read, or the folder cannot be written to.
          ValueError: the data have another layout, or the folder holds another recording.
        """
        self._settings = settings
        base = RecordingSpec.make(
            domain_name="kitchen",
            task_name=_TASK,
            task_kwargs=_TASK_KWARGS,
            policy="zero",
            seed=0,
            seeding="gymnasium",
            max_episode_steps=None,
        )
        # The MDP needs no physics.
        self._task = KitchenTask(build_kitchen_scene(visuals=False), **_TASK_KWARGS)
        with minari_root(settings.data_path):
            self._data = human_data.open_data(settings.source, self._task.scene)
        if not len(self._data):
            raise ValueError(f"{settings.source} holds no episodes of two or more observations")
        origin = {"format": self._data.format, "source": settings.source}
        spec = dataclasses.replace(base, policy=_POLICY, origin=origin)
        self._folder = RecordingFolder.claim(settings.output, spec)
        self._finished = 0

    def progress(self) -> str:
        return f"after {self._finished} of {len(self._data)} episodes; the same command completes the recording"

    def run(self) -> bool:
        """Converts the episodes; prints how many there are, and which tasks they complete."""
        tasks: collections.Counter[str] = collections.Counter()
        numbers: collections.Counter[int] = collections.Counter()
        goals: set[str] = set()
        steps = 0
        with minari_root(self._settings.data_path):
            for index, shown in enumerate(tqdm(self._data.read(), total=len(self._data), disable=None, leave=False)):
                episode, metrics, completed = convert(self._task, index, shown)
                self._folder.save(episode, EpisodeStats.of(episode, metrics))
                tasks.update(completed)
                numbers[len(completed)] += 1
                goals |= {*shown.goals}
                steps += episode.steps
                self._finished += 1
        print(f"{self._finished} episodes of {self._settings.source} ({self._data.format}), {steps} control steps")
        print(f"goals of the data: {', '.join(sorted(goals)) or 'none of the suite'}\n")
        by_task = [(task, tasks[task]) for task in self._task.task_names]
        print(tabulate.tabulate(by_task, ("task", "episodes that complete it"), tablefmt="simple"), "\n")
        print(tabulate.tabulate(sorted(numbers.items()), ("tasks completed", "episodes"), tablefmt="simple"), "\n")
        if not self._data.has_velocities:
            print("velocities were not recorded: policies that are trained on these episodes act on positions alone")
        print(f"recording in {self._settings.output}")
        return True
