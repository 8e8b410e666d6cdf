"""The command `kitchen-replay`."""

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING

from absl.flags import DEFINE_integer, DEFINE_string, FlagValues

from kitchen_suite import checks
from kitchen_suite.commands import flags, watching
from kitchen_suite.commands.command import Command

if TYPE_CHECKING:
    from kitchen_suite.episodes.recording import Recording
    from kitchen_suite.episodes.replay import Comparison, Verdict

DESCRIPTION = """Plays recorded actions again, and checks that all numbers and scores are the same. Needs no display.

  kitchen-replay runs                                     ten episodes of a folder of kitchen-record or kitchen-rollout
  kitchen-replay runs --episodes=all                      all episodes
  kitchen-replay runs --episodes=0,5,7-9 --video=a.mp4    also films them
  kitchen-replay runs --web=runs.html                     also writes a page that shows them in 3-D
  kitchen-replay expert.npz                               a receipt of kitchen-evaluate, without its policy
  kitchen-replay expert.npz --published=expert.json       also compares its result with a published one

The first line on a receipt says what is confirmed: the protocol, each value that replaces the protocol's, beside that
one, and what cannot be checked. Versions, and the scores with their intervals, follow.

The actions are those of the recording or the receipt; seeds and settings make everything else anew. Exit status: 0 if
all numbers are equal to the bit; 3 if all scores are, but not all digits; 1 if scores differ, if the file was altered
or cannot be read, or if writing or the physics failed; 2 for a bad argument, with one line on stderr; 130 if
interrupted.
"""

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


def define(values: FlagValues) -> None:
    """Defines the flags."""
    which = "Which episodes of a recording: all, or numbers and ranges such as 0,5,7-9."
    DEFINE_string("episodes", None, which, values)
    count = "Number of episodes, spread evenly over the recording, where episodes are not given."
    DEFINE_integer("num_episodes", 10, count, 1, checks.MAX_COUNT, flag_values=values)
    flags.path(values, "published", "Result of kitchen-evaluate, its JSON, which has to be that of the receipt.")
    flags.path(values, "dataset", "Folder of the recording from which the goals of a receipt were taken.")
    flags.custom(values)
    flags.num_envs(values)
    flags.video(values)
    flags.page(values)


def run(given: FlagValues, source: str) -> int:
    """Replays a recording or a receipt, and prints what was found."""
    from kitchen_suite.episodes.recording import SPEC_FILE

    flags.import_custom(given)
    path = Path(source)
    if not path.exists():
        raise FileNotFoundError(f"there is no recording or receipt {source!r}")
    if path.match("episode_*.npz") and (path.parent / SPEC_FILE).is_file():
        raise ValueError(f"{path} is an episode of a recording: name its folder, {path.parent}")
    return _verify(given, path) if path.is_file() else _replay(given, path)


def _verify(given: FlagValues, path: Path) -> "Verdict":
    from kitchen_suite.evaluation.verify import verify

    if given.episodes or given.video or given.web:
        raise ValueError("a receipt has no observations: episodes, video and web are for recordings")
    return verify(
        path,
        published=given.published,
        dataset=given.dataset,
        num_envs=given.num_envs,
        num_threads=given.num_threads,
        verbose=True,
    )


def _replay(given: FlagValues, path: Path) -> "Verdict":
    from kitchen_suite.episodes.recording import SPEC_FILE, Recording
    from kitchen_suite.episodes.replay import Replay, Verdict, worst
    from kitchen_suite.episodes.report import print_line
    from kitchen_suite.gymnasium_env.base import suite_env

    if given.published or given.dataset:
        raise ValueError("published and dataset are compared with a receipt, not with a recording")
    if not (path / SPEC_FILE).is_file():
        raise ValueError(f"{path} holds no recording, which has a file {SPEC_FILE}")
    recording = Recording.open(path)
    flags.prepare_images(recording.spec, rendering=given.video is not None)
    played = Replay(recording, given.episodes, given.num_episodes, **watching.rendering(given))
    environment = suite_env(played.environment).environment
    count, steps = len(played.indices), recording.spec.max_episode_steps
    watching.check(given, environment)
    verdicts, unseen = [], []
    with (
        contextlib.closing(played.environment),
        watching.watching(given, environment, num_episodes=count, max_steps=steps) as watch,
    ):
        print_line(f"{path}: {count} of {len(recording.indices)} episodes\n{_versions(recording)}")
        print_line(_row({name: name for name in _COLUMNS}))
        for index, comparison in played.run(watch):
            verdicts.append(comparison.verdict)
            print_line(_row(_cells(index, comparison)))
            if comparison.verdict is Verdict.DIGITS_DIFFER:
                unseen.append(f"episode {index} differs in {', '.join(comparison.arrays)}")
    equal = verdicts.count(Verdict.EQUAL)
    print_line("\n".join(["", *unseen, f"{equal} of {count} episodes are equal"]))
    return worst(verdicts)


def _versions(recording: "Recording") -> str:
    """Returns a line for each package of which another version is here."""
    from kitchen_suite.versions import installed_versions

    here, there = installed_versions(), recording.spec.versions
    differing = [name for name in here if here[name] != there.get(name)]
    return "".join(f"recorded with {name} {there.get(name)}, here {here[name]}\n" for name in differing)


def _cells(index: int, comparison: "Comparison") -> dict[str, str]:
    def verdict(step: int | None) -> str:
        return "equal" if step is None else f"differ at {step}"

    completions = verdict(comparison.completions)
    return {
        "episode": str(index),
        "seed": str(comparison.seed),
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


COMMAND = Command(name="kitchen-replay", description=DESCRIPTION, define=define, run=run, positional="recording")
main = COMMAND.main
