"""The work of `kitchen-convert`: recordings become datasets, and datasets recordings."""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import contextlib
import dataclasses
import pkgutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import ClassVar

from dm_control.rl.control import PhysicsError
from numpy.typing import NDArray
from tqdm import tqdm

from kitchen_suite import checks, files
from kitchen_suite.datasets.exports import ExportPlan, read_record, record_file
from kitchen_suite.datasets.formats import EXPORTS, FORMATS, MINARI
from kitchen_suite.datasets.human import HumanDataJob
from kitchen_suite.datasets.replay import check_pictures
from kitchen_suite.episodes.episode import EpisodeArrays, EpisodeBuffer, EpisodeStats
from kitchen_suite.episodes.recording import RecordingFolder
from kitchen_suite.episodes.spec import EpisodeSpec, reset_to_seed
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.settings import FAILURE, USAGE, ConvertSettings
from kitchen_suite.versions import installed_versions


def convert_job(settings: ConvertSettings) -> "DatasetJob | RecordingJob | HumanDataJob":
    """Returns the job of the direction that settings name, to a dataset or to a recording; a ValueError without one."""
    if (settings.output is None) == (settings.dataset is None):
        raise ValueError("name either --output=FOLDER, for a recording, or --dataset=OWNER/NAME, for a dataset")
    if settings.dataset is not None:
        return DatasetJob(settings, settings.dataset)
    assert settings.output is not None
    if settings.format is not None:
        raise ValueError(f"a recording has no format: leave out --format={settings.format}")
    source = Path(settings.source)
    if record_file(source).is_file():
        return RecordingJob(source, settings.output)
    # No human demonstrations have such names.
    if source.suffix in (".npz", ".zarr") and source.exists():
        raise ValueError(f"{source} has no record of its episodes beside it, {record_file(source).name}")
    return HumanDataJob(settings.source, settings.output, settings.data_path)


class DatasetJob:
    """Makes a dataset of a recording, as `kitchen-record` does with `--dataset`."""

    errors: ClassVar = {OSError: FAILURE, PhysicsError: FAILURE}

    def __init__(self, settings: ConvertSettings, dataset: str) -> None:
        self._source, self._folder = settings.source, RecordingFolder.open(Path(settings.source))
        spec, self._indices = self._folder.spec, self._folder.indices
        if not self._indices:
            raise ValueError(f"{self._source} holds no episodes")
        # The seeds of others are not those of `env.reset(seed=...)`, which datasets promise.
        if spec.origin is not None or spec.seeding != "gymnasium":
            maker = "kitchen-rollout" if spec.origin is None else "kitchen-convert"
            raise ValueError(f"{self._source} was made by {maker}: datasets are made of recordings of kitchen-record")
        chosen = FORMATS[checks.choice(settings.format or MINARI.name, FORMATS, "format")]
        chosen.task_kwargs({"obs_type": spec.argument("obs_type")})
        # As many as kitchen-record was asked for, unless the physics of the last ones diverged.
        self._plan = chosen.make_plan(dataset, spec, self._indices[-1] + 1, settings.data_path)
        self._environment = spec.make_environment()
        check_pictures(self._environment)

    def progress(self) -> str:
        return "before the dataset was complete: there is none"

    def run(self) -> bool:
        with contextlib.closing(self._environment):
            self._plan.complete(self._environment, self._folder, self._indices)
        print(f"{len(self._indices)} episodes of {self._source}")
        print(f"dataset {self._plan.dataset_id} in {self._plan.path}")
        return True


class RecordingJob:
    """Makes the recording again of which a dataset in files of another program was made.

    The actions of each episode are played from its seed; all arrays of the dataset must be, to the bit, those played.
    """

    errors: ClassVar = {ValueError: USAGE, OSError: FAILURE, PhysicsError: FAILURE}

    def __init__(self, source: Path, output: Path) -> None:
        self._source, self._output, path = source, output, record_file(source)
        self._record = record = read_record(path)
        plans = {each.title: each.plan for each in EXPORTS}
        title = checks.choice(record.format, plans, f"the format in {path}")
        self._layout: type[ExportPlan] = pkgutil.resolve_name(plans[title])
        self._layout.check_installed()
        spec = EpisodeSpec.from_json(record.recording)
        # Of the program that plays the episodes now.
        self._spec = dataclasses.replace(spec, versions=installed_versions())
        if not record.seeds or spec.origin is not None or sorted({*record.seeds}) != record.seeds:
            raise ValueError(f"{path} has no seeds of episodes, in ascending order")
        if record.seeds[0] < spec.seed:
            raise ValueError(f"{path} has seeds before the first one, {spec.seed}")
        self._environment = spec.make_environment()
        check_pictures(self._environment)
        self._finished = 0

    def progress(self) -> str:
        count = len(self._record.seeds)
        return f"after {self._finished} of {count} episodes; the same command completes the recording"

    def run(self) -> bool:
        """Plays the episodes, compares and writes them; none is written before the first one has been compared."""
        task, indices = suite_env(self._environment).composer_task, []
        stored = tqdm(self._stored(), total=len(self._record.seeds), disable=None, leave=False)
        with contextlib.closing(self._environment):
            for seed, actions, columns in stored:
                episode = self._play(seed, actions, columns)
                folder = RecordingFolder.claim(self._output, self._spec)
                if episode.index not in folder.indices:
                    folder.save(episode, EpisodeStats.of(episode, task.records.metrics(episode.last_info)))
                indices.append(episode.index)
                self._finished += 1
        print(f"{self._finished} episodes of {self._source} ({self._layout.title}), which play again to the bit")
        print(f"digest of all arrays  {folder.digest(indices)}")
        print(f"recording in {self._output}")
        return True

    def _stored(self) -> Iterator[tuple[int, NDArray, Mapping[str, NDArray]]]:
        """Yields seed, actions and all arrays of each episode; raises an OSError if they cannot be read."""
        seeds = self._record.seeds
        with files.reading(self._source, f"the dataset that {record_file(self._source).name} describes"):
            for seed, stored in zip(seeds, self._layout.read(self._source, len(seeds)), strict=True):
                yield seed, *stored

    def _play(self, seed: int, actions: NDArray, columns: Mapping[str, NDArray]) -> EpisodeArrays:
        """Plays an episode; raises an OSError if it is not the one of the dataset."""
        environment, where = self._environment, f"the episode of seed {seed} in {self._source}"
        space, limit = environment.action_space, self._spec.max_episode_steps
        if actions.dtype != space.dtype or actions.shape[1:] != space.shape:
            found = f"{actions.dtype} of shape {actions.shape[1:]}"
            raise OSError(f"{where} has actions of {found}, its environment of {space.dtype} of shape {space.shape}")
        if not 0 < len(actions) <= limit:
            raise OSError(f"{where} has {len(actions)} actions, not 1 to {limit}")
        if not all(map(space.contains, actions)):
            raise OSError(f"{where} has actions beyond the bounds of its environment")
        buffer = EpisodeBuffer(*reset_to_seed(environment, seed, self._spec.seeding))
        for action in actions:
            if buffer.has_ended:
                raise OSError(f"{where} goes on after its end: it was changed, or made elsewhere")
            buffer.step(environment, action)
        episode = buffer.episode(environment, seed - self._spec.seed, seed)
        if differing := _differing(columns, self._layout.columns(environment, self._spec, episode)):
            causes = "it was changed, made elsewhere, or did not begin as a reset with its seed alone does"
            raise OSError(f"{where} plays otherwise here, with another {differing}: {causes}")
        return episode


def _differing(one: Mapping[str, NDArray], other: Mapping[str, NDArray]) -> str:
    """Returns the name of an array that is missing in one of two mappings, or not the same to the bit; or nothing."""

    def content(arrays: Mapping[str, NDArray], name: str) -> tuple | None:
        found = arrays.get(name)
        return None if found is None else (found.shape, found.dtype, found.tobytes())

    return next((name for name in {**other, **one} if content(one, name) != content(other, name)), "")
