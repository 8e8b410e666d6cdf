"""The work of `kitchen-replay`."""

import contextlib
import re
from collections.abc import Callable, Sequence

import numpy as np
from dm_control.rl.control import PhysicsError
from tqdm import tqdm

from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.recordings import sources
from kitchen_suite.recordings.minari_dataset import minari_root
from kitchen_suite.recordings.replay import Comparison, compare, replay
from kitchen_suite.rollouts.episode import EpisodeBuffer
from kitchen_suite.rollouts.film import Views
from kitchen_suite.rollouts.report import print_line
from kitchen_suite.settings import ReplaySettings
from kitchen_suite.versions import installed_versions

# Widths of the table's columns; `difference` is the maximum over all numbers of the observations.
_COLUMNS = {
    "episode": 7,
    "seed": 6,
    "steps": 5,
    "return": 8,
    "replayed": 8,
    "difference": 10,
    "rewards": 13,
    "end": 13,
    "completions": 0,
}


class ReplayJob:
    """Replays episodes of a recording, and compares them."""

    failures = (PhysicsError, OSError, ValueError)
    usage_errors = ()

    def __init__(self, settings: ReplaySettings) -> None:
        """Prepares the replay, so that bad settings are refused before the first episode.

        Raises:
          ImportError: an extra is missing.
          OSError: there is no such recording, or the assets are missing.
          TypeError: an argument of the recorded environment is unknown here.
          ValueError: the recording cannot be replayed here, or there is no such episode or camera.
        """
        self._settings = settings
        with minari_root(settings.data_path):
            self._source = sources.find(settings.source, settings.data_path)
        self._indices = choose(self._source.indices, settings.episodes, settings.num_episodes)
        self._environment = self._source.make_environment(**settings.rendering)
        try:
            # The first reset compiles the model, and the size of its pictures with it.
            self._environment.reset()
        except RuntimeError as error:
            raise OSError(f"the recording holds pictures: {error}") from error
        self._inner = suite_env(self._environment).environment
        limit = self._environment.spec.max_episode_steps if self._environment.spec else None
        self._views = Views(settings, self._inner, num_episodes=len(self._indices), max_steps=limit)
        self._finished = 0

    def progress(self) -> str:
        return f"after {self._finished} of {len(self._indices)} episodes"

    def run(self) -> bool:
        """Replays the episodes; prints a table row by row, and a verdict. Returns whether all are equal."""
        exactly = self._source.spec is not None
        print_line(f"{self._heading()}\n")
        equal = 0
        with (
            contextlib.closing(self._environment),
            minari_root(self._settings.data_path),
            self._views.open() as watch,
        ):
            print_line(_row({name: name for name in _COLUMNS}))
            for index in tqdm(self._indices, unit="episode", disable=None, leave=False):
                comparison = self._compare(index, watch, exactly)
                equal += comparison.is_equal(exactly=exactly)
                self._finished += 1
                print_line(_row(_cells(index, comparison)))
        print_line(f"\n{equal} of {len(self._indices)} episodes are equal")
        return equal == len(self._indices)

    def _compare(self, index: int, watch: Callable[[EpisodeBuffer], None], exactly: bool) -> Comparison:
        spec = self._source.spec
        recorded = self._source.load(index)
        replayed = replay(self._environment, recorded, spec.seeding if spec else "gymnasium", watch)
        return compare(self._inner.task, recorded, self._source.projected(replayed), truncations=exactly)

    def _heading(self) -> str:
        """Returns the name of the recording, and the known differences to the environment here."""
        text = f"{self._settings.source}: {len(self._indices)} of {len(self._source.indices)} episodes"
        if self._source.spec is None:
            return f"{text}; recorded by another program, so that observations and truncations are not compared"
        here, there = installed_versions(), self._source.spec.versions
        differing = [name for name in here if here[name] != there.get(name)]
        return "\n".join([text, *(f"recorded with {name} {there.get(name)}, here {here[name]}" for name in differing)])


def choose(indices: Sequence[int], wanted: str | None, count: int) -> list[int]:
    """Returns the episodes to replay.

    Args:
      indices: of all episodes, in order.
      wanted: `all`, or numbers and ranges such as `0,5,7-9`; `count` of them when omitted.
      count: number of episodes, spread evenly from the first to the last.

    Raises:
      ValueError: there is none, there is no such episode, or `wanted` is malformed.
    """
    if not indices:
        raise ValueError("there are no episodes")
    if wanted is None:
        chosen = np.linspace(0, len(indices) - 1, min(count, len(indices))).round().astype(int)
        return [indices[i] for i in chosen]
    return list(indices) if wanted == "all" else _listed(indices, wanted)


def _listed(indices: Sequence[int], wanted: str) -> list[int]:
    """Returns the episodes of a list of numbers and ranges."""
    chosen: list[int] = []
    for part in wanted.split(","):
        if not (match := re.fullmatch(r"(\d+)(?:-(\d+))?", part)):
            raise ValueError(f"episodes must be 'all', or numbers and ranges such as 0,5,7-9, got {wanted!r}")
        first, last = int(match[1]), int(match[2] or match[1])
        if first > last:
            raise ValueError(f"the range {part} of episodes is empty")
        for end in (first, last):
            if end not in indices:
                raise ValueError(f"there is no episode {end}: there are {len(indices)}, from {indices[0]}")
        chosen += range(first, last + 1)
    if missing := sorted({*chosen} - {*indices}):
        raise ValueError(f"there is no episode {missing[0]}: there are {len(indices)}, from {indices[0]}")
    return chosen


def _cells(index: int, comparison: Comparison) -> dict[str, str]:
    def verdict(step: int | None) -> str:
        return "equal" if step is None else f"differ at {step}"

    completions = verdict(comparison.completions)
    return {
        "episode": str(index),
        "seed": "none" if comparison.seed is None else str(comparison.seed),
        "steps": str(comparison.steps),
        "return": f"{comparison.recorded_return:.5g}",
        "replayed": f"{comparison.replayed_return:.5g}",
        "difference": f"{comparison.observation_difference:.3g}",
        "rewards": verdict(comparison.rewards),
        "end": verdict(comparison.ends),
        "completions": ": ".join(filter(None, [completions, ", ".join(comparison.tasks)])),
    }


def _row(cells: dict[str, str]) -> str:
    return "  ".join(f"{cells[name]:>{width}}" for name, width in _COLUMNS.items())
