"""The command `kitchen-compare`."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from absl.flags import DEFINE_enum, DEFINE_list, FlagValues

from kitchen_suite import checks
from kitchen_suite.commands import flags, watching
from kitchen_suite.commands.command import GATE, SUCCESS, Command

if TYPE_CHECKING:
    from kitchen_suite.evaluation.compare import PairedComparison
    from kitchen_suite.evaluation.methods import MethodComparison

DESCRIPTION = """Compares policies that were evaluated on the same episodes, pair by pair. Needs no display.

  kitchen-evaluate --policy=expert --receipt=expert.npz
  kitchen-evaluate --policy=trained --receipt=trained.npz
  kitchen-compare expert.npz trained.npz                       is the first policy better?
  kitchen-compare expert.npz trained.npz --video=both.mp4      also films episodes in which one alone succeeds
  kitchen-compare expert.npz trained.npz --json=both.json      also writes the results as JSON
  kitchen-compare a.npz b.npz c.npz --format=latex             all pairs of several policies, as a LaTeX table
  kitchen-compare usual.npz varied.npz --across=variations     what does it cost one policy that starts vary?
  kitchen-compare --a=ppo1.npz,ppo2.npz --b=bc1.npz,bc2.npz    is the first method better, for other training seeds?
  kitchen-compare released.npz new.npz --fail_if=worse         exit status 4 where the second is worse, for CI

Each is a receipt of kitchen-evaluate, its JSON with --episodes, or a folder of kitchen-record. A difference is the
first policy's score less the second's; intervals are of 95 %. Protocol, seeds, environments, physics and versions must
be the same, but for the arguments that --across names. docs/guide/comparison.md explains the results. Exit status: 0; 1
if a file cannot be read or written, or was altered; 2 for a bad argument, or episodes that cannot be paired, with one
line on stderr that names what differs; 4 where --fail_if says so; 130 if interrupted.
"""

_EPISODES = 3  # In a video, by default.
_GATES = ("worse", "not_better")
_WIDTH = 1280  # Of both episodes together, by default [pixels].


def define(values: FlagValues) -> None:
    """Defines the flags."""
    for name, which in (("a", "first"), ("b", "second")):
        text = f"Evaluations of the {which} method, comma separated, one of each training seed; with the other's."
        DEFINE_list(name, [], text, flag_values=values)
    across = "Arguments of the environments, comma separated, by which the evaluations differ, and which are compared."
    DEFINE_list("across", [], across, flag_values=values)
    gate = (
        "End with exit status 4 where the second is worse than the first, or is not better: where p is below 0.05, "
        "and the interval excludes 0."
    )
    DEFINE_enum("fail_if", None, _GATES, gate, flag_values=values)
    flags.file(values, "json", "File to write the results to as JSON; it may be replaced.")
    flags.table_format(values)
    flags.video(values, width=_WIDTH, num_episodes=_EPISODES)
    flags.page(values)


def run(given: FlagValues, *sources: str) -> int:
    """Compares policies or methods; prints the tables, and writes the files that are wanted."""
    from kitchen_suite import files

    _check_flags(given, sources)
    wanted = {"json": given.json, "video": given.video, "web": given.web}
    paths = [*map(Path, (*sources, *given.a, *given.b))]
    folders = [path for path in paths if path.is_dir()]
    files.check_destinations({name: path for name, path in wanted.items() if path}, paths, folders)
    compared = _compare_policies(given, sources) if sources else _compare_methods(given)
    return SUCCESS if given.fail_if is None else _gate(given, compared)


def _check_flags(given: FlagValues, sources: Sequence[str]) -> None:
    """Raises a ValueError if flags do not apply to what is compared."""
    is_watched = bool(given.video or given.web)
    if given.a or given.b:
        if not (given.a and given.b):
            raise ValueError("--a and --b go together: the evaluations of two methods")
        others = {"a policy": sources, "--across": given.across, "--video or --web": is_watched}
        for name, value in others.items():
            if value:
                raise ValueError(f"--a and --b compare methods: {name} does not apply")
    elif len(sources) < 2:
        problem = f"at least 2 are needed, got {checks.shown([*sources])}"
        raise ValueError(f"evaluations or recordings: {problem}; or --a and --b, for two methods")
    if len(sources) > 2:
        if is_watched:
            raise ValueError(f"a video or a page shows two policies, not {len(sources)}")
        if given.fail_if is not None:
            raise ValueError(f"--fail_if is about the second of two policies, not of {len(sources)}")


def _compare_policies(given: FlagValues, sources: Sequence[str]) -> "PairedComparison":
    from kitchen_suite.episodes.report import print_line
    from kitchen_suite.evaluation.compare import all_as_json, compare_all
    from kitchen_suite.evaluation.text import format_comparison, format_comparisons

    comparisons = compare_all(sources, across=given.across)
    first, *others = comparisons
    is_watched = bool(given.video or given.web)
    if is_watched:
        _check_watching(given, first)
    print_line(format_comparisons(comparisons, given.format) if others else format_comparison(first, given.format))
    _write(given, all_as_json(comparisons) if others else first.as_json())
    if is_watched:
        _watch(given, first)
    return first


def _compare_methods(given: FlagValues) -> "MethodComparison":
    from kitchen_suite.episodes.report import print_line
    from kitchen_suite.evaluation.methods import compare_methods
    from kitchen_suite.evaluation.text import format_methods

    comparison = compare_methods(given.a, given.b)
    print_line(format_methods(comparison, given.format))
    _write(given, comparison.as_json())
    return comparison


def _write(given: FlagValues, record: Mapping[str, Any]) -> None:
    from kitchen_suite import files

    if given.json:
        with files.atomic_write(given.json) as partial:
            files.write_json(partial, record, indent=1)


def _gate(given: FlagValues, compared: "PairedComparison | MethodComparison") -> int:
    """Prints whether the second fails; returns the exit status."""
    from kitchen_suite.episodes.report import paragraph, print_line

    found = {"a": "is worse than", "b": "is better than", None: "is shown to be neither better nor worse than"}
    has_failed = compared.better == "a" if given.fail_if == "worse" else compared.better != "b"
    outcome = f"{compared.second.name} {found[compared.better]} {compared.first.name}"
    verdict = f"--fail_if={given.fail_if} {'failed' if has_failed else 'passed'}: {outcome}"
    print_line(f"\n{paragraph(verdict, given.format)}")
    return GATE if has_failed else SUCCESS


def _check_watching(given: FlagValues, comparison: "PairedComparison") -> None:
    """Raises an ImportError, an OSError or a ValueError if the episodes cannot be shown."""
    from kitchen_suite.episodes.video import check_ffmpeg
    from kitchen_suite.evaluation.side_by_side import check_replays

    check_replays(comparison)
    watching.check_page(given)
    if given.video:
        check_ffmpeg()
        flags.prepare_images(comparison.first.first, rendering=True)


def _watch(given: FlagValues, comparison: "PairedComparison") -> None:
    """Writes the video and the page of the episodes in which one policy alone succeeds."""
    from kitchen_suite.episodes.report import counted, print_line
    from kitchen_suite.evaluation.side_by_side import Picture, add_to_page, film

    if not comparison.differing:
        print_line("\nin every episode both policies succeed or both fail: there is nothing to show")
        return
    if given.video:
        picture = Picture(
            camera=given.camera,
            width=given.width,
            height=given.height,
            frames_per_second=given.video_fps,
            render_quality=given.render_quality,
        )
        print_line(f"\nfilming {counted(min(given.video_episodes, len(comparison.differing)))} side by side")
        count = film(comparison, given.video, picture, given.video_episodes)
        print_line(f"video {given.video}: {counted(count)} of {len(comparison.differing)} that differ")
    if given.web:
        from kitchen_suite.viewer.episode_page import EpisodePage

        page = EpisodePage(given.web, camera=given.camera, report=print_line)
        with page.open_side_by_side((comparison.first.name, comparison.second.name)) as add:
            add_to_page(comparison, add, given.web_episodes)


COMMAND = Command(
    name="kitchen-compare",
    description=DESCRIPTION,
    define=define,
    run=run,
    positional="evaluations or recordings",
    positional_counts=range(101),
)
main = COMMAND.main
