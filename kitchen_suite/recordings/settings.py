"""Settings of `kitchen-record` and `kitchen-replay`."""

import dataclasses
from pathlib import Path

from kitchen_suite.rollouts.settings import EpisodeSettings, FilmSettings


@dataclasses.dataclass(frozen=True, kw_only=True)
class RecordSettings(EpisodeSettings):
    """Settings of `kitchen-record`; each is the flag of its name."""

    output: Path
    num_episodes: int = 100
    num_envs: int = 16
    num_threads: int | None = None
    dataset: str | None = None
    data_path: Path | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class ReplaySettings(FilmSettings):
    """Settings of `kitchen-replay`; `source` is its argument, each other one is the flag of its name."""

    source: str
    episodes: str | None = None
    num_episodes: int = 10
    data_path: Path | None = None
