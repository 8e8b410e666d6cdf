"""Records episodes to a folder, or completes a recording that was interrupted."""

import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from kitchen_suite import checks
from kitchen_suite.episodes.cluster import Cluster
from kitchen_suite.episodes.episode import check_file_size
from kitchen_suite.episodes.play import play_numbered
from kitchen_suite.episodes.recording import SPEC_FILE, Recording
from kitchen_suite.episodes.report import EpisodeBar
from kitchen_suite.episodes.spec import EnvironmentSpec
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.policies import TIMESTEP, PolicyRef


class DivergedEpisodesError(checks.WorkFailedError):
    """The physics diverged in some episodes, which are missing from the recording."""


def record(
    folder: str | Path,
    spec: EnvironmentSpec,
    policy: str | Path | PolicyRef | Callable[..., Any],
    *,
    num_episodes: int,
    seed: int = 0,
    takes: str = TIMESTEP,
    num_envs: int = 16,
    num_threads: int | None = None,
    cluster: Cluster | None = None,
) -> Recording:
    """Plays the episodes of a recording that are not yet in its folder, and writes each as it ends.

    Each file is written whole or not at all: an interrupt loses the episodes in progress alone, on a cluster the parts
    in progress, and the same call completes the recording. Where stderr is a terminal, a progress bar is shown.

    Args:
      folder: of the recording, which is made where there is none.
      spec: of the environments.
      policy: as in `play`.
      num_episodes: in the complete recording; episode `i` has the seed `seed + i`.
      seed: of the first episode.
      takes: as in `play`.
      num_envs: as in `play`.
      num_threads: as in `play`.
      cluster: as in `play`.

    Returns the recording.

    Raises:
      DivergedEpisodesError: at the end, if the physics diverged in some episodes.
      OSError: the folder cannot be written to, or holds something else.
      PolicyError: the policy cannot be built, raises an exception, or returns a bad action.
      ValueError: an argument is not valid, or the folder holds a recording of another specification.
    """
    checks.integer(num_envs, "num_envs", minimum=1, maximum=checks.MAX_ENVS)
    reference = PolicyRef.of(policy, takes)
    if reference.function is not None and (Path(folder) / SPEC_FILE).exists():
        # Nothing says that it is the same policy.
        raise FileExistsError(f"{folder} holds a recording, which an object does not continue: name another folder")
    recording = claim(folder, spec, reference, num_episodes=num_episodes, seed=seed)
    complete(recording, reference, num_episodes, num_envs=num_envs, num_threads=num_threads, cluster=cluster)
    return recording


def claim(folder: str | Path, spec: EnvironmentSpec, policy: PolicyRef, *, num_episodes: int, seed: int) -> Recording:
    """Starts a recording, or continues an interrupted one, without playing any episode; arguments are as in `record`.

    Raises an OSError, a PolicyError or a ValueError as `record`, before anything is written.
    """
    checks.integer(num_episodes, "num_episodes", minimum=1)
    episodes = spec.episodes(policy, seed=seed)
    with contextlib.closing(episodes.make_environment()) as environment:
        check_file_size(environment.observation_space, episodes.max_episode_steps)
        episodes.check_policy(policy, environment)
        kinds = _kinds(suite_env(environment).composer_task.episode_metrics)
    recording = Recording.claim(Path(folder), episodes)
    for index in recording.present(num_episodes):
        metrics = recording.load_summary(index).metrics
        if _kinds(metrics) != kinds:
            raise OSError(f"episode {index} in {folder} has metrics {metrics}, which are not those of its task")
    return recording


def complete(
    recording: Recording,
    policy: PolicyRef,
    num_episodes: int,
    *,
    num_envs: int = 16,
    num_threads: int | None = None,
    cluster: Cluster | None = None,
) -> None:
    """Plays the missing episodes of a recording of `claim`; arguments and exceptions are as in `record`."""
    episodes = recording.spec
    present = recording.present(num_episodes)
    successes = sum(bool(recording.load_summary(index).metrics["success"]) for index in present)
    missing = recording.missing(num_episodes)
    played = play_numbered(episodes, policy, missing, num_envs=num_envs, num_threads=num_threads, cluster=cluster)
    diverged: list[int] = []
    with (
        recording.withdrawn_without_episodes(),
        EpisodeBar(num_episodes, num_episodes - len(missing), successes) as bar,
        contextlib.closing(played),
    ):
        for episode in played:
            if episode.diverged:
                diverged.append(episodes.seed_of(episode.index))
                continue
            # Another process that completes the recording has written the same episode.
            with contextlib.suppress(FileExistsError):
                recording.append(episode)
            bar.count(bool(episode.metrics["success"]))
    if diverged:
        seeds = sorted(diverged)
        raise DivergedEpisodesError(f"the physics diverged in {len(seeds)} episodes, left out: seeds {seeds}")


def _kinds(metrics: Any) -> dict[str, type]:
    return {name: type(value) for name, value in metrics.items()}
