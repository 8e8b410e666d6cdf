"""Settings of `kitchen-record` and `kitchen-replay`."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any


@dataclasses.dataclass(frozen=True, kw_only=True)
class RecordSettings:
    """Settings of `kitchen-record`; each is the flag of its name."""

    output: Path
    domain_name: str = "kitchen"
    task_name: str | None = None
    task_kwargs: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    policy: str = "random"
    num_episodes: int = 100
    seed: int = 0
    max_episode_steps: int | None = None
    num_envs: int = 16
    num_threads: int | None = None
    workers: int | None = None
    ray_address: str | None = None
    dataset: str | None = None
    data_path: Path | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class ReplaySettings:
    """Settings of `kitchen-replay`; `source` is its argument, each other one is the flag of its name."""

    source: str
    episodes: str | None = None
    num_episodes: int = 10
    data_path: Path | None = None
    video: Path | None = None
    video_fps: float = 25.0
    camera: str = "overview"
    width: int = 640
    height: int = 480
