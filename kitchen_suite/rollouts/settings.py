"""Settings of `kitchen-rollout` and `kitchen-play`, and those that they share with other commands."""

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

# Beginning of the names of the observation types with pictures; a GL library is chosen before these can be imported.
PICTURES_PREFIX = "pixels"


@dataclasses.dataclass(frozen=True, kw_only=True)
class TaskSettings:
    """The task of a command; each is the flag of its name."""

    domain_name: str
    task_name: str | None = None
    task_kwargs: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    control_mode: str | None = None
    variations: str | None = None
    variation_split: str | None = None

    @property
    def environment_kwargs(self) -> dict[str, Any]:
        """Arguments of the task's Gymnasium environment.

        Raises:
          ValueError: one is given twice, with different values.
        """
        variations = None if self.variations is None else parsed_variations(self.variations)
        chosen = {"control_mode": self.control_mode, "variations": variations, "variation_split": self.variation_split}
        given = {name: value for name, value in chosen.items() if value is not None}
        for name, value in given.items():
            if (other := self.task_kwargs.get(name, value)) != value:
                raise ValueError(f"{name} is {value!r}, but {other!r} in the task_kwargs")
        return {**self.task_kwargs, **given}

    @property
    def observes_pictures(self) -> bool:
        """Whether observations hold pictures, so that playing needs a GL library."""
        return str(self.task_kwargs.get("obs_type")).startswith(PICTURES_PREFIX)


def parsed_variations(text: str) -> Any:
    """Returns what varies: a list of the names that commas separate, or the contents of a JSON object.

    Raises:
      ValueError: the text begins like a JSON object and is none.
    """
    if not text.lstrip().startswith("{"):
        return text.split(",")
    try:
        return json.loads(text)
    except (RecursionError, ValueError) as error:
        raise ValueError(f"variations is not JSON: {error}") from error


@dataclasses.dataclass(frozen=True, kw_only=True)
class EpisodeSettings(TaskSettings):
    """The episodes of a task that a command plays, and the processes that play them; each is the flag of its name."""

    domain_name: str = "kitchen"
    policy: str = "random"
    seed: int = 0
    max_episode_steps: int | None = None
    workers: int | None = None
    ray_address: str | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class PageSettings:
    """The web page that a command writes; each is the flag of its name."""

    web: Path | None = None
    web_episodes: int = 10
    camera: str = "overview"


@dataclasses.dataclass(frozen=True, kw_only=True)
class FilmSettings(PageSettings):
    """The video and the web page that a command writes; each is the flag of its name."""

    video: Path | None = None
    video_fps: float = 25.0
    width: int = 640
    height: int = 480
    video_episodes: int = 1
    render_quality: str = "fast"

    @property
    def rendering(self) -> dict[str, Any]:
        """Arguments of the filmed environment; without pictures it is built without visuals, and steps faster."""
        return {"visuals": True if self.video or self.web else None, "render_quality": self.render_quality}


@dataclasses.dataclass(frozen=True, kw_only=True)
class RolloutSettings(EpisodeSettings, FilmSettings):
    """Settings of `kitchen-rollout`; each is the flag of its name."""

    list: bool = False
    num_episodes: int = 3
    output: Path | None = None
    visualize_reward: bool = False


@dataclasses.dataclass(frozen=True, kw_only=True)
class PlaySettings(FilmSettings):
    """Settings of `kitchen-play`; each is the flag of its name."""

    list: bool = False
    shipped: str | None = None
    policy_file: Path | None = None
    num_episodes: int = 10
    seed: int = 0
    max_episode_steps: int | None = None
    novideo: bool = False
    # Enough to follow a motion, and few enough to be rendered without a graphics card.
    video_fps: float = 12.5
