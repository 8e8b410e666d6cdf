"""Formats of datasets that recordings are made into, and sources of episodes to replay: folders, and such datasets.

A further format is a plan, a source, and an entry in `FORMATS`.
"""

import abc
import dataclasses
import pkgutil
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import gymnasium

from kitchen_suite import checks, files
from kitchen_suite.episodes.episode import EpisodeArrays
from kitchen_suite.episodes.recording import SPEC_FILE, RecordingFolder
from kitchen_suite.episodes.spec import EpisodeSpec
from kitchen_suite.settings import MAX_SEED

_DATASET_ID = re.compile(r"[\w-][\w.-]*/[\w-][\w.-]*", re.ASCII)  # As the Hugging Face hub accepts names.


class DatasetPlan(abc.ABC):
    """A dataset that will hold the first `count` episodes of a recording, in the folder or file `path`."""

    path: Path

    def __init__(self, dataset_id: str, spec: EpisodeSpec, count: int, root: Path | None = None) -> None:
        """Checks that the dataset can be made in a folder, by default the library's own, or has been made already.

        Raises an ImportError if the library is not installed, a ValueError if the name is malformed or taken by another
        dataset, or the recording cannot be a dataset.
        """
        if spec.seed + count - 1 > MAX_SEED:
            raise ValueError(f"seeds in a dataset may not exceed {MAX_SEED}, got {spec.seed + count - 1}")
        self.dataset_id, self.spec, self.count, self._root = dataset_id, spec, count, root

    @property
    def is_missing(self) -> bool:
        return not self.path.exists()

    @property
    @abc.abstractmethod
    def seeds(self) -> Sequence[int | None]:
        """Seeds of the episodes of a dataset that is there, in its order; raises an OSError if it cannot be read."""

    @abc.abstractmethod
    def make(self, environment: gymnasium.Env, folder: RecordingFolder, indices: Sequence[int]) -> None:
        """Makes the dataset of episodes that were recorded in an environment; after an error there is none."""

    def complete(self, environment: gymnasium.Env, folder: RecordingFolder, indices: Sequence[int]) -> None:
        """Makes the dataset, unless it is there already; raises a FileExistsError if that one has other episodes."""
        if self.is_missing:
            self.make(environment, folder, indices)
        elif [*self.seeds] != [folder.spec.seed_of(index) for index in indices]:
            raise FileExistsError(f"dataset {self.dataset_id!r} has other episodes of this recording: name another one")

    def _check_name(self, kind: str) -> None:
        if not _DATASET_ID.fullmatch(self.dataset_id):
            raise ValueError(f"{checks.shown(self.dataset_id)} is no name of {kind}, such as me/kettle")

    def _check_same(self, spec: object, count: object) -> None:
        """Raises a ValueError unless a dataset that is there holds the first `count` episodes of the recording."""
        if found := files.first_difference(spec, self.spec.as_json()):
            problem = f"holds another recording, with {found}"
        elif count != self.count:
            problem = f"is of the first {count} episodes of this recording, not of {self.count}"
        else:
            return
        raise ValueError(f"dataset {self.dataset_id!r} exists and {problem}: name another one")


class Source(abc.ABC):
    """Episodes, and the environment that they were recorded in.

    Attributes:
      spec: the specification of the episodes; None where another program recorded them.
      indices: numbers of the episodes, in order.
    """

    spec: EpisodeSpec | None
    indices: Sequence[int]

    @abc.abstractmethod
    def make_environment(self, **rendering: Any) -> gymnasium.Env:
        """Makes the environment, with arguments of its rendering such as `visuals`."""

    @abc.abstractmethod
    def load(self, index: int) -> EpisodeArrays:
        """Reads an episode, once the environment has been made."""

    def projected(self, replayed: EpisodeArrays) -> EpisodeArrays:
        """Returns a replayed episode with the arrays that the source holds of an episode."""
        return replayed


class FolderSource(Source):
    """A folder of `kitchen-record` or `kitchen-rollout`."""

    def __init__(self, folder: Path) -> None:
        self._folder = recording = RecordingFolder.open(folder)
        if recording.spec.origin is not None:
            raise ValueError(f"{folder} was made by kitchen-convert, and holds no states from which to replay")
        self.spec, self.indices = recording.spec, recording.indices

    def make_environment(self, **rendering: Any) -> gymnasium.Env:
        return self._folder.spec.make_environment(**rendering)

    def load(self, index: int) -> EpisodeArrays:
        return self._folder.load(index)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Format:
    """A format of datasets: its value of `--format`, the program that defines it, and the name of a dataset.

    Attributes:
      plan: entry point of its `DatasetPlan`.
      source: entry point of a function that opens the dataset of a name or in a folder, given that and the folder of
        all datasets (None: the program's own) as paths; it returns None where there is no such dataset. None for a
        format that is not read.
      obs_types: observation types of the suite that it holds, the first where none is named; empty for all.
    """

    name: str
    title: str
    example: str
    plan: str
    source: str | None = None
    obs_types: tuple[str, ...] = ()

    def task_kwargs(self, given: Mapping[str, Any]) -> Mapping[str, Any]:
        """Returns arguments of a task with an observation type of the format; a ValueError if they have another one."""
        if not self.obs_types:
            return given
        obs_type = given.get("obs_type", self.obs_types[0])
        return {**given, "obs_type": checks.choice(obs_type, self.obs_types, f"{self.title}'s obs_type")}

    def make_plan(self, dataset_id: str, spec: EpisodeSpec, count: int, root: Path | None) -> DatasetPlan:
        """Plans a dataset; arguments and errors as in `DatasetPlan`."""
        return pkgutil.resolve_name(self.plan)(dataset_id, spec, count, root)

    def find(self, name: str, root: Path | None) -> Source | None:
        """Opens a dataset, None if there is none; arguments as in `find_source`."""
        return pkgutil.resolve_name(self.source)(name, root) if self.source else None


MINARI = Format(
    name="minari",
    title="Minari",
    example="me/kitchen-v0",
    plan="kitchen_suite.datasets.minari:MinariPlan",
    source="kitchen_suite.datasets.minari:find",
)
LEROBOT = Format(
    name="lerobot",
    title="LeRobot",
    example="me/kitchen",
    plan="kitchen_suite.datasets.lerobot:LeRobotPlan",
    source="kitchen_suite.datasets.lerobot:find",
    obs_types=("environment_state_agent_pos", "pixels_agent_pos", "pixels_environment_state_agent_pos"),
)

# Files of other programs, below the folder `--data_path`; kitchen-convert makes recordings of them again.
EXPORTS = tuple(
    Format(name=name, title=title, example="me/kitchen", plan=f"kitchen_suite.datasets.{plan}")
    for name, title, plan in (
        ("robomimic", "robomimic", "robomimic:RobomimicPlan"),
        ("ogbench", "OGBench", "ogbench:OGBenchPlan"),
        ("d4rl", "D4RL", "d4rl:D4RLPlan"),
        ("diffusion_policy", "Diffusion Policy", "diffusion_policy_store:DiffusionPolicyPlan"),
        ("bet", "BeT", "bet_folder:BeTPlan"),
    )
)

# By the value of `--format`; the first is the default.
FORMATS: Mapping[str, Format] = MappingProxyType({each.name: each for each in (MINARI, LEROBOT, *EXPORTS)})


def find_source(name: str, root: Path | None = None) -> Source:
    """Returns the recording in a folder, or the dataset in a folder or of a name below `root`, or its program's folder.

    Raises:
      ImportError: it may be a dataset, but the library of its format is not installed.
      OSError: there is none, or it cannot be read.
      ValueError: the folder holds something else.
    """
    folder = Path(name)
    if (folder / SPEC_FILE).is_file():
        return FolderSource(folder)
    for each in FORMATS.values():
        if source := each.find(name, root):
            return source
    titles = " or ".join(each.title for each in FORMATS.values() if each.source)
    if folder.exists():
        hint = f": name its folder, {folder.parent}" if (folder.parent / SPEC_FILE).is_file() else ""
        raise ValueError(f"{name} holds neither {SPEC_FILE} nor a {titles} dataset{hint}")
    problem = f"there is no folder {name}, and no {titles} dataset of that name on this machine"
    raise FileNotFoundError(f"{problem}; `minari download` gets datasets of Minari, whose names end in -v0")
