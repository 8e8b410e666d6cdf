"""The work of `kitchen-play`, and of others that play a trained policy."""

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tabulate import tabulate

from kitchen_suite import files
from kitchen_suite.names import EXACT
from kitchen_suite.policies import load_policy
from kitchen_suite.policies.trained import SHIPPED, shipped_as
from kitchen_suite.rendering import gl, video
from kitchen_suite.rollouts.report import print_line
from kitchen_suite.rollouts.rollout_job import ListJob, RolloutJob
from kitchen_suite.settings import PlaySettings, RolloutSettings

_DEFAULT_POLICY = "top_drawer_grasp"
_DEFAULT_VIDEO = Path("kitchen-play.mp4")


def policy_rollout(file: Path, **settings: Any) -> RolloutSettings:
    """Returns settings, some of them given, that play a trained policy in the task that it was trained for."""
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
        if settings.shipped and settings.policy_file:
            raise ValueError("--shipped and --policy_file both name a policy: give one of them")
        if settings.video and settings.novideo:
            raise ValueError("--video and --novideo contradict each other: give one of them")
        is_default = not (settings.video or settings.novideo or settings.web)
        self._reason_against_video = _reason_against_video() if is_default else ""
        self._video = _DEFAULT_VIDEO if is_default and not self._reason_against_video else settings.video
        file = settings.policy_file or shipped_as(settings.shipped or _DEFAULT_POLICY)
        of_rollout = {field.name for field in dataclasses.fields(RolloutSettings)}
        shared = {name: value for name, value in vars(settings).items() if name in of_rollout}
        super().__init__(policy_rollout(file, **{**shared, "video": self._video}))

    def run(self) -> bool:
        super().run()
        if self._video:
            print_line(f"video {self._video}")
        if self._reason_against_video:
            print_line(f"no video: {self._reason_against_video}")
        print_line(f"success {self._report.successes}/{self.finished}")
        return True


def _shipped_policies() -> Iterator[str]:
    yield tabulate([_row(path) for path in sorted(SHIPPED.glob("*.npz"))], headers="keys")


def _row(path: Path) -> dict[str, str]:
    """Returns task, physics, success in the evaluation that chose it, networks and file size of a policy, by column."""
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


def make_job(settings: PlaySettings) -> PlayJob | ListJob:
    """Returns the job that settings ask for."""
    return ListJob(_shipped_policies()) if settings.list else PlayJob(settings)


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
