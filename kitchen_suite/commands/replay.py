"""The command `kitchen-replay`."""

import contextlib
import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING

from absl.flags import DEFINE_integer, DEFINE_string, FlagValues

from kitchen_suite import checks
from kitchen_suite.commands import flags, watching
from kitchen_suite.commands.command import Command

if TYPE_CHECKING:
    from kitchen_suite.episodes.recording import Recording
    from kitchen_suite.episodes.replay import ReplayedEpisode, Verdict
    from kitchen_suite.episodes.spec import EpisodeSpec
    from kitchen_suite.evaluation.evaluation import Evaluation

DESCRIPTION = """Plays recorded actions again, and checks that all numbers and scores are the same. Needs no display.

  kitchen-replay runs                                     ten episodes of a folder of kitchen-record or kitchen-rollout
  kitchen-replay runs --episodes=all                      all episodes
  kitchen-replay runs --episodes=0,5,7-9 --video=a.mp4    also films them
  kitchen-replay runs --web=runs.html                     also writes a page that shows them in 3-D
  kitchen-replay expert.npz                               a receipt of kitchen-evaluate, without its policy
  kitchen-replay expert.npz --published=expert.json       also compares its result with a published one
  kitchen-replay expert.npz --video=a.mp4 --web=a.html    also films its first episodes, and shows them in 3-D

The first line on a receipt says what is confirmed: the protocol, each value that replaces the protocol's, beside that
one, and what cannot be checked. Versions, and the scores with their intervals, follow.

The actions are those of the recording or the receipt; seeds and settings make everything else anew. Exit status: 0 if
all numbers are equal to the bit; 3 if all scores are, but not all digits; 1 if scores differ, if the file was altered
or cannot be read, or if writing or the physics failed; 2 for a bad argument, with one line on stderr; 130 if
interrupted.
"""

# Exit statuses.
_STATUSES = {"equal": 0, "altered": 1, "other digits": 3}

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
    is_receipt = path.is_file()
    unused = ("episodes", "num_episodes") if is_receipt else ("published", "dataset", "num_envs", "num_threads")
    kind = "receipt, whose episodes are replayed all together" if is_receipt else "recording, but to a receipt"
    if wrong := [f"--{name}" for name in unused if given[name].present]:
        raise ValueError(f"{' and '.join(wrong)} does not apply to a {kind}")
    return _STATUSES[_verify(given, path) if is_receipt else _replay(given, path)]


def _verify(given: FlagValues, path: Path) -> "Verdict":
    from kitchen_suite.episodes.report import EpisodeBar, print_line
    from kitchen_suite.evaluation import text
    from kitchen_suite.evaluation.evaluation import Evaluation
    from kitchen_suite.evaluation.replay import check_goals, check_published

    evaluation = Evaluation.read(path)
    evaluation.require_actions("a check plays again")
    if given.published:
        check_published(evaluation, given.published)
    if given.dataset:
        check_goals(evaluation, given.dataset)
    if given.video or given.web:
        _check_watching(given, evaluation.plan.first)
    print_line(text.format_check_heading(evaluation, given.dataset, given.published))
    with EpisodeBar(sum(map(len, evaluation.results.values()))) as bar:
        check = evaluation.check(
            num_envs=given.num_envs,
            num_threads=given.num_threads,
            progress=lambda episode: bar.count(episode.replayed.success),
        )
    print_line(f"\n{text.format_check(evaluation.plan, check)}")
    if given.video or given.web:
        _watch(given, evaluation)
    return check.verdict


def _check_watching(given: FlagValues, spec: "EpisodeSpec") -> None:
    """Raises an ImportError, an OSError or a ValueError if episodes cannot be shown, before any is played."""
    from kitchen_suite.gymnasium_env.base import suite_env
    from kitchen_suite.gymnasium_env.observations import OF_OBSERVATIONS

    flags.prepare_images(spec, rendering=given.video is not None)
    with contextlib.closing(spec.without(OF_OBSERVATIONS).make_environment(**watching.rendering(given))) as environment:
        environment.reset()
        watching.check(given, suite_env(environment).environment)


def _watch(given: FlagValues, evaluation: "Evaluation") -> None:
    """Films the first episodes of a receipt's first condition, or adds them to a web page."""
    from kitchen_suite.evaluation.rollout import watch_episodes
    from kitchen_suite.gymnasium_env.base import suite_env
    from kitchen_suite.gymnasium_env.observations import OF_OBSERVATIONS

    name, spec = next(iter(evaluation.plan.specs.items()))
    plan = dataclasses.replace(evaluation.plan, specs={name: spec})
    shown = max(given.video_episodes if given.video else 0, given.web_episodes if given.web else 0)
    rendering = watching.rendering(given)
    with contextlib.closing(spec.without(OF_OBSERVATIONS).make_environment(**rendering)) as environment:
        environment.reset()
        inner = suite_env(environment).environment
        count = min(shown, plan.num_episodes)
        with watching.watching(given, inner, num_episodes=count, max_steps=spec.max_episode_steps) as watch:
            watch_episodes(
                plan, evaluation.results, evaluation.traces, shown, watch, render_quality=given.render_quality
            )


def _replay(given: FlagValues, path: Path) -> "Verdict":
    from kitchen_suite.episodes.recording import SPEC_FILE, Recording
    from kitchen_suite.episodes.replay import Replay
    from kitchen_suite.episodes.report import print_line
    from kitchen_suite.evaluation.replay import check_recording
    from kitchen_suite.gymnasium_env.base import suite_env

    if not (path / SPEC_FILE).is_file():
        raise ValueError(f"{path} holds no recording, which has a file {SPEC_FILE}")
    recording = Recording.open(path)
    flags.prepare_images(recording.spec, rendering=given.video is not None)
    played = Replay(recording, given.episodes, given.num_episodes, **watching.rendering(given))
    environment = suite_env(played.environment).environment
    count, steps = len(played.indices), recording.spec.max_episode_steps
    watching.check(given, environment)
    with (
        contextlib.closing(played.environment),
        watching.watching(given, environment, num_episodes=count, max_steps=steps) as watch,
    ):
        print_line(f"{path}: {count} of {len(recording.indices)} episodes\n{_versions(recording)}")
        print_line(_row({name: name for name in _COLUMNS}))
        check = check_recording(played, watch, progress=lambda episode: print_line(_row(_cells(episode))))
    unseen = [
        f"episode {episode.episode} differs in {', '.join(episode.arrays)}"
        for episode in check.episodes
        if episode.verdict == "other digits"
    ]
    equal = count - len(check.differing)
    print_line("\n".join(["", *unseen, f"{equal} of {count} episodes are equal"]))
    return check.verdict


def _versions(recording: "Recording") -> str:
    """Returns a line for each package of which another version is here."""
    here, there = recording.spec.current_versions, recording.spec.versions
    differing = [name for name in here if here[name] != there.get(name)]
    return "".join(f"recorded with {name} {there.get(name)}, here {here[name]}\n" for name in differing)


def _cells(episode: "ReplayedEpisode") -> dict[str, str]:
    def verdict(step: int | None) -> str:
        return "equal" if step is None else f"differ at {step}"

    completions = verdict(episode.completions)
    return {
        "episode": str(episode.episode),
        "seed": str(episode.seed),
        "steps": str(episode.steps),
        "return": f"{episode.recorded_return:.5g}",
        "replayed": f"{episode.replayed_return:.5g}",
        "difference": f"{episode.observation_difference:.3g}",
        "rewards": verdict(episode.rewards),
        "end": verdict(episode.ends),
        "completions": ": ".join(filter(None, [completions, ", ".join(episode.tasks)])),
    }


def _row(cells: dict[str, str]) -> str:
    return "  ".join(f"{cells[name]:>{width}}" for name, width in _COLUMNS.items())


COMMAND = Command(name="kitchen-replay", description=DESCRIPTION, define=define, run=run, positional="recording")
main = COMMAND.main
