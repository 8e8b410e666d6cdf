"""What `kitchen-replay` does once its flags are read."""

import contextlib
import dataclasses
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from tqdm import tqdm

from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.recordings import sources
from kitchen_suite.recordings.comparison import Comparison, compare
from kitchen_suite.recordings.replay import play_again
from kitchen_suite.rendering import video
from kitchen_suite.rendering.cameras import check_size, find_camera
from kitchen_suite.versions import installed_versions

# Widths of the table's columns; `difference` is the greatest one of any number of an observation.
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


@dataclasses.dataclass(frozen=True, kw_only=True)
class Settings:
    """What is asked for; see the flags of `replay`."""

    name: str
    episodes: str | None
    num_episodes: int
    video: Path | None
    camera: str
    width: int
    height: int


class ReplayJob:
    """Episodes of a recording to be played again."""

    def __init__(self, settings: Settings) -> None:
        """Makes everything ready, so that nothing that can be known to be wrong stops the job later.

        Raises:
          ImportError: Minari or ffmpeg is missing, and needed.
          OSError: there is no such recording, or the assets are missing.
          TypeError: an argument of the recorded environment is unknown here.
          ValueError: it cannot be replayed here, or there is no such episode or camera.
        """
        self._settings = settings
        self._recording = sources.find(settings.name)
        self._indices = choose(self._recording.indices, settings.episodes, settings.num_episodes)
        self._environment = self._recording.environment(visuals=settings.video is not None)
        self._inner = suite_env(self._environment)
        # The first reset compiles the model, and the size of its pictures with it.
        self._environment.reset()
        self._camera = find_camera(self._inner.environment, settings.camera)
        if settings.video:
            video.check_ffmpeg()
            check_size(self._inner.environment, settings.width, settings.height)
        self.finished = 0

    @property
    def count(self) -> int:
        """Number of episodes to be played again."""
        return len(self._indices)

    def run(self) -> bool:
        """Plays them; prints a table, row by row, and a verdict. Returns whether all are equal."""
        exactly = self._recording.recipe is not None
        _print("\n".join([self._heading(), "", _row({name: name for name in _COLUMNS})]))
        equal = 0
        with contextlib.closing(self._environment), self._open_video() as film:
            for index in tqdm(self._indices, unit="episode", disable=None, leave=False):
                comparison = self._compare(index, film, exactly)
                equal += comparison.is_equal(exactly=exactly)
                self.finished += 1
                _print(_row(_cells(index, comparison)))
        _print(f"\n{equal} of {self.count} episodes are equal")
        return equal == self.count

    def _compare(self, index: int, film: Callable[[], None], exactly: bool) -> Comparison:
        recorded = self._recording.episode(index)
        replayed = play_again(self._environment, recorded, film)
        return compare(self._inner, recorded, replayed, truncations=exactly)

    def _heading(self) -> str:
        """What is replayed, and what is known to be different here."""
        text = f"{self._settings.name}: {self.count} of {len(self._recording.indices)} episodes"
        if self._recording.recipe is None:
            return f"{text}; not recorded by kitchen-record, so that observations and truncations are not judged"
        here, there = installed_versions(), self._recording.recipe.versions
        differing = [name for name in here if here[name] != there.get(name)]
        return "\n".join([text, *(f"recorded with {name} {there.get(name)}, here {here[name]}" for name in differing)])

    @contextlib.contextmanager
    def _open_video(self) -> Iterator[Callable[[], None]]:
        """Gives what adds the present view to the video; it does nothing where no video is asked for."""
        settings, environment = self._settings, self._inner.environment
        if settings.video is None:
            yield lambda: None
            return
        size = {"width": settings.width, "height": settings.height}
        rate = 1.0 / environment.control_timestep()
        with video.open_video(settings.video, **size, frames_per_second=rate) as add:
            yield lambda: add(environment.physics.render(**size, camera_id=self._camera))


def choose(indices: Sequence[int], wanted: str | None, count: int) -> list[int]:
    """Chooses episodes.

    Args:
      indices: those that there are, in order.
      wanted: `all`, or numbers and ranges such as `0,5,7-9`; without it, `count` of them.
      count: how many are spread from the first to the last.

    Raises:
      ValueError: there is none, there is no such episode, or that is no list of them.
    """
    if not indices:
        raise ValueError("there are no episodes")
    if wanted is None:
        places = np.linspace(0, len(indices) - 1, min(count, len(indices))).round().astype(int)
        return [indices[place] for place in places]
    return list(indices) if wanted == "all" else _listed(indices, wanted)


def _listed(indices: Sequence[int], wanted: str) -> list[int]:
    chosen: list[int] = []
    for part in wanted.split(","):
        first, _, last = part.partition("-")
        if not first.isdecimal() or not (last or first).isdecimal():
            raise ValueError(f"episodes must be 'all', or numbers and ranges such as 0,5,7-9, got {wanted!r}")
        chosen += range(int(first), int(last or first) + 1)
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


def _print(text: str) -> None:
    """Prints above the progress bar, at once: an episode may take long, and the reader may be a pipe."""
    tqdm.write(text)
    sys.stdout.flush()
