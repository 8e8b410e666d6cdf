"""The command `kitchen-play`."""

from pathlib import Path

from absl.flags import DEFINE_boolean, DEFINE_string, FlagValues

from kitchen_suite.commands import flags
from kitchen_suite.commands.command import Command
from kitchen_suite.commands.rollout import play_and_print

DESCRIPTION = """Plays a trained policy, and films it.

  kitchen-play                                               opens the drawer; the video is kitchen-play.mp4
  kitchen-play --shipped=top_drawer                          with the policy trained on the original reward
  kitchen-play --list                                        lists the policies that come with the package
  kitchen-play --policy_file=runs/drawer/policy.npz          with a policy written by kitchen-train
  kitchen-play --num_episodes=100 --novideo                  counts successes alone; needs no GL library
  kitchen-play --web=drawer.html                             a page to look at in 3-D; needs no GL library

The last line says how many episodes succeeded. Exit status: 0; 1 if writing or the physics failed; 2 for a bad
argument or policy file, with one line on stderr; 130 if interrupted.
"""

_DEFAULT_POLICY = "top_drawer_grasp"
_DEFAULT_VIDEO = Path("kitchen-play.mp4")

# Enough to follow a motion, and few enough to be rendered without a graphics card.
_VIDEO_FPS = 12.5


def define(values: FlagValues) -> None:
    """Defines the flags."""
    DEFINE_boolean("list", False, "List the trained policies that come with the package, and exit.", values)
    DEFINE_string("shipped", None, "Name of a trained policy that comes with the package.", values)
    flags.path(values, "policy_file", "File of a trained policy, written by kitchen-train.")
    flags.custom(values)
    flags.num_episodes(values, 10)
    flags.seed(values)
    flags.max_episode_steps(values)
    DEFINE_boolean("novideo", False, "Write no video.", values)
    flags.video(values, fps=_VIDEO_FPS, unset=f"{_DEFAULT_VIDEO}, where it can be made, without a web page")
    flags.page(values)


def run(given: FlagValues) -> None:
    """Plays and films the policy."""
    from kitchen_suite import suite
    from kitchen_suite.episodes.report import print_line
    from kitchen_suite.episodes.spec import EnvironmentSpec
    from kitchen_suite.policies import PolicyRef, load_policy
    from kitchen_suite.policies.files import shipped_as

    if given.list:
        print(_shipped_policies())
        return
    if given.shipped and given.policy_file:
        raise ValueError("shipped and policy_file both name a policy: give one of them")
    if given.video and given.novideo:
        raise ValueError("video and novideo contradict each other: give one of them")
    flags.import_custom(given)
    reason = ""
    if not (given.video or given.novideo or given.web):
        reason = _reason_against_video()
        given["video"].value = None if reason else _DEFAULT_VIDEO
    file = given.policy_file or shipped_as(given.shipped or _DEFAULT_POLICY)
    trained_for = load_policy(file).metadata
    task = (trained_for["domain_name"], trained_for["task_name"], trained_for["task_kwargs"])
    suite.check_named(trained_for["domain_name"], trained_for["task_kwargs"])
    policy = PolicyRef.parse(f"trained(file={str(file)!r})")
    spec = EnvironmentSpec.make(*task, given.max_episode_steps)
    play_and_print(given, spec.episodes(policy, seed=given.seed, seeding="dm_control").with_observables(policy), policy)
    if given.video:
        print_line(f"video {given.video}")
    if reason:
        print_line(f"no video: {reason}")


def _reason_against_video() -> str:
    """Returns why the default video cannot be made here; empty if it can."""
    from kitchen_suite import files
    from kitchen_suite.episodes.video import check_ffmpeg
    from kitchen_suite.rendering import gl

    try:
        gl.find_library()
        check_ffmpeg()
        files.check_writable(_DEFAULT_VIDEO.parent)
        if _DEFAULT_VIDEO.is_dir():
            raise IsADirectoryError(f"{_DEFAULT_VIDEO} is a folder")
    except (ImportError, OSError) as error:
        return str(error)
    return ""


def _shipped_policies() -> str:
    """Returns a table of the policies that come with the package."""
    from tabulate import tabulate

    from kitchen_suite.policies.files import SHIPPED

    return tabulate([_row(path) for path in sorted(SHIPPED.glob("*.npz"))], headers="keys")


def _row(path: Path) -> dict[str, str]:
    """Returns task, physics, success in the evaluation that chose it, networks and file size of a policy, by column."""
    from kitchen_suite.physics_names import EXACT
    from kitchen_suite.policies import load_policy

    policy = load_policy(path)
    metadata = policy.metadata
    evaluated = metadata["task_kwargs"].get("physics", EXACT)
    return {
        "--shipped": path.stem,
        "task": f"{metadata['domain_name']} {metadata['task_name']}",
        "trained in": (metadata.get("training_kwargs") or {}).get("physics", evaluated),
        "success": f"{metadata['training']['success']:.0%} in {evaluated}",
        "layers": " ".join(str(size) for size in policy.layers),
        "size": f"{path.stat().st_size / 1024:.0f} KiB",
    }


COMMAND = Command(name="kitchen-play", description=DESCRIPTION, define=define, run=run)
main = COMMAND.main
