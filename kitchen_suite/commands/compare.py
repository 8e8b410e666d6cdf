"""The command `kitchen-compare`."""

from pathlib import Path
from typing import TYPE_CHECKING

from absl.flags import DEFINE_list, FlagValues

from kitchen_suite.commands import flags, watching
from kitchen_suite.commands.command import Command

if TYPE_CHECKING:
    from kitchen_suite.evaluation.compare import PairedComparison

DESCRIPTION = """Compares policies that were evaluated on the same episodes, pair by pair. Needs no display.

  kitchen-evaluate --policy=expert --receipt=expert.npz
  kitchen-evaluate --policy=trained --receipt=trained.npz
  kitchen-compare expert.npz trained.npz                       is the first policy better?
  kitchen-compare expert.npz trained.npz --video=both.mp4      also films episodes in which one alone succeeds
  kitchen-compare expert.npz trained.npz --json=both.json      also writes the results as JSON
  kitchen-compare a.npz b.npz c.npz --format=latex             all pairs of several policies, as a LaTeX table
  kitchen-compare usual.npz varied.npz --across=variations     what does it cost one policy that starts vary?

Each is a receipt of kitchen-evaluate, its JSON with --episodes, or a folder of kitchen-record. A difference is the
first policy's score less the second's; intervals are of 95 %. Protocol, seeds, environments, physics and versions must
be the same, but for the arguments that --across names. docs/guide/comparison.md explains the results. Exit status: 0; 1
if a file cannot be read or written, or was altered; 2 for a bad argument, or episodes that cannot be paired, with one
line on stderr that names what differs; 130 if interrupted.
"""

_EPISODES = 3  # In a video, by default.
_WIDTH = 1280  # Of both episodes together, by default [pixels].


def define(values: FlagValues) -> None:
    """Defines the flags."""
    flags.file(values, "json", "File to write the results to as JSON; it may be replaced.")
    flags.table_format(values)
    across = "Arguments of the environments, comma separated, by which the evaluations differ, and which are compared."
    DEFINE_list("across", [], across, flag_values=values)
    flags.video(values, width=_WIDTH, num_episodes=_EPISODES)
    flags.page(values)


def run(given: FlagValues, *sources: str) -> None:
    """Compares the policies; prints the tables, and writes the files that are wanted."""
    from kitchen_suite import files
    from kitchen_suite.episodes.report import print_line
    from kitchen_suite.evaluation.compare import all_as_json, compare_all
    from kitchen_suite.evaluation.text import format_comparison, format_comparisons

    wanted = {"json": given.json, "video": given.video, "web": given.web}
    paths = [*map(Path, sources)]
    folders = [path for path in paths if path.is_dir()]
    files.check_destinations({name: path for name, path in wanted.items() if path}, paths, folders)
    is_watched = bool(given.video or given.web)
    if is_watched and len(sources) > 2:
        raise ValueError(f"a video or a page shows two policies, not {len(sources)}")
    comparisons = compare_all(sources, across=given.across)
    if is_watched:
        _check_watching(given, comparisons[0])
    if len(sources) == 2:
        print_line(format_comparison(comparisons[0], given.format))
    else:
        print_line(format_comparisons(comparisons, given.format))
    if given.json:
        record = comparisons[0].as_json() if len(sources) == 2 else all_as_json(comparisons)
        with files.atomic_write(given.json) as partial:
            files.write_json(partial, record, indent=1)
    if is_watched:
        _watch(given, comparisons[0])


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
    positional_counts=range(2, 101),
)
main = COMMAND.main
