"""The work of `kitchen-play`, and of others that play a trained policy."""

from pathlib import Path
from typing import Any

from tabulate import tabulate

from kitchen_suite import files
from kitchen_suite.policies import load_policy
from kitchen_suite.policies.trained import SHIPPED, shipped_as
from kitchen_suite.rendering import gl, video
from kitchen_suite.rollouts.report import print_line
from kitchen_suite.rollouts.rollout_job import RolloutJob
from kitchen_suite.settings import PlaySettings, RolloutSettings

_DEFAULT_POLICY = "top_drawer_grasp"
_DEFAULT_VIDEO = Path("kitchen-play.mp4")


def policy_rollout(file: Path, **settings: Any) -> RolloutSettings:
    """Returns the settings that play a trained policy in the task that it was trained for.

    Args:
      file: of the policy.
      **settings: further fields of `RolloutSettings`.
    """
    trained_for = load_policy(file).metadata
    return RolloutSettings(
        domain_name=trained_for["domain_name"],
        task_name=trained_for["task_name"],
        task_kwargs=trained_for["task_kwargs"],
        policy=f"trained(file={str(file)!r})",
        **settings,
    )


class PlayJob(RolloutJob):
    """Plays and films a trained policy; the last line that it prints is the number of successes."""

    def __init__(self, settings: PlaySettings) -> None:
        """Prepares the rollout, and chooses whether to film it."""
        if settings.shipped and settings.policy_file:
            raise ValueError("--shipped and --policy_file both name a policy: give one of them")
        if settings.video and settings.novideo:
            raise ValueError("--video and --novideo contradict each other: give one of them")
        is_default = not (settings.video or settings.novideo or settings.web)
        self._reason_against_video = _reason_against_video() if is_default else ""
        self._video = _DEFAULT_VIDEO if is_default and not self._reason_against_video else settings.video
        rollout = policy_rollout(
            settings.policy_file or shipped_as(settings.shipped or _DEFAULT_POLICY),
            num_episodes=settings.num_episodes,
            seed=settings.seed,
            max_episode_steps=settings.max_episode_steps,
            web=settings.web,
            web_episodes=settings.web_episodes,
            video=self._video,
            video_episodes=settings.video_episodes,
            video_fps=settings.video_fps,
            camera=settings.camera,
            width=settings.width,
            height=settings.height,
            render_quality=settings.render_quality,
        )
        super().__init__(rollout)

    def run(self) -> bool:
        super().run()
        if self._video:
            print_line(f"video {self._video}")
        if self._reason_against_video:
            print_line(f"no video: {self._reason_against_video}")
        print_line(f"success {self.successes}/{self.finished}")
        return True


class ListShippedJob:
    """Lists the trained policies that come with the package."""

    failures = (OSError,)
    usage_errors = ()

    def progress(self) -> str:
        return "while listing"

    def run(self) -> bool:
        """Prints a row for each policy: its task, success in the evaluation that chose it, its networks and file."""
        rows = [_row(path) for path in sorted(SHIPPED.glob("*.npz"))]
        print_line(tabulate(rows, headers="keys"))
        return True


def _row(path: Path) -> dict[str, str]:
    """Returns the cells of a policy by the names of their columns."""
    policy = load_policy(path)
    metadata = policy.metadata
    return {
        "--shipped": path.stem,
        "task": f"{metadata['domain_name']} {metadata['task_name']}",
        "success": f"{metadata['training']['success']:.0%}",
        "layers": " ".join(str(size) for size in policy.layers),
        "size": f"{path.stat().st_size / 1024:.0f} KiB",
    }


def make_job(settings: PlaySettings) -> PlayJob | ListShippedJob:
    """Returns the job that settings ask for."""
    return ListShippedJob() if settings.list else PlayJob(settings)


def _reason_against_video() -> str:
    """Returns why the default video cannot be made here; empty if it can."""
    try:
        gl.find_library()
        video.check_ffmpeg()
        files.check_writable(_DEFAULT_VIDEO.parent)
        if _DEFAULT_VIDEO.is_dir():
            raise IsADirectoryError(f"{_DEFAULT_VIDEO} is a folder")
    except (ImportError, OSError) as error:
        return str(error)
    return ""
