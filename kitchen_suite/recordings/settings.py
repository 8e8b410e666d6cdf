"""Settings of `kitchen-record`, `kitchen-replay` and `kitchen-convert`."""

import dataclasses
from pathlib import Path

from kitchen_suite import checks, suite
from kitchen_suite.rollouts.settings import EpisodeSettings, FilmSettings

# Names of datasets by format.
_EXAMPLES = {"minari": "me/kitchen-v0", "lerobot": "me/kitchen"}
# Observation types of the suite that hold what LeRobot reads; the first where none is named.
OBS_TYPES = ("environment_state_agent_pos", "pixels_agent_pos")


@dataclasses.dataclass(frozen=True, kw_only=True)
class RecordSettings(EpisodeSettings):
    """Settings of `kitchen-record`; each is the flag of its name.

    A preset gives those that have their default: task, `task_kwargs` and policy.
    """

    output: Path
    preset: str | None = None
    num_episodes: int = 100
    num_envs: int = 16
    num_threads: int | None = None
    format: str | None = None
    dataset: str | None = None
    data_path: Path | None = None

    @property
    def with_preset(self) -> "RecordSettings":
        """The settings with those of the preset, if there is one.

        Raises:
          ValueError: there is no such preset, or it fixes a setting that is given.
        """
        if self.preset is None:
            return self
        presets = suite.find_domain(self.domain_name).resolve("recording") or {}
        chosen = presets[checks.choice(self.preset, presets, "preset")]
        defaults = {field.name: field.default for field in dataclasses.fields(self)} | {"task_kwargs": {}}
        if given := sorted(name for name in chosen if getattr(self, name) not in (defaults[name], chosen[name])):
            raise ValueError(f"preset {self.preset!r} fixes {', '.join(given)}: leave it out, or the preset")
        return dataclasses.replace(self, **chosen)

    @property
    def with_format(self) -> "RecordSettings":
        """The settings with the observation type of the dataset's format, where none is given.

        Raises:
          ValueError: there is a format and no dataset, or the format does not hold the observation type.
        """
        if self.format is not None and self.dataset is None:
            raise ValueError(f"format {self.format!r} needs the name of a dataset: --dataset={_EXAMPLES[self.format]}")
        if self.format != "lerobot":
            return self
        obs_type = checks.choice(self.task_kwargs.get("obs_type", OBS_TYPES[0]), OBS_TYPES, "LeRobot's obs_type")
        return dataclasses.replace(self, task_kwargs={**self.task_kwargs, "obs_type": obs_type})


@dataclasses.dataclass(frozen=True, kw_only=True)
class ReplaySettings(FilmSettings):
    """Settings of `kitchen-replay`; `source` is its argument, each other one is the flag of its name."""

    source: str
    episodes: str | None = None
    num_episodes: int = 10
    data_path: Path | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class ConvertSettings:
    """Settings of `kitchen-convert`; `source` is its argument, each other one is the flag of its name."""

    source: str
    output: Path
    data_path: Path | None = None
