"""The folder of a training run: its description, by which a resumed run is recognised as the same."""

import contextlib
import dataclasses
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from kitchen_suite import files

RUN_FILE = "training.json"


@dataclasses.dataclass(frozen=True, kw_only=True)
class RunDescription:
    """The task, hyperparameters and seed of a run. A run is resumed only with an equal description.

    Attributes:
      domain_name: a key of `suite.DOMAINS`.
      task_name: one of the domain's tasks.
      task_kwargs: further arguments of the Gymnasium environment, which JSON can hold.
      training_kwargs: further arguments of the environments trained in, among them `max_episode_steps`.
      hyperparameters: all of them, by name.
      seed: of the first learner.
      algorithm: one of `settings.ALGORITHMS`.
    """

    domain_name: str
    task_name: str
    task_kwargs: dict[str, Any]
    training_kwargs: dict[str, Any]
    hyperparameters: dict[str, Any]
    seed: int
    algorithm: str = "ppo"

    def as_json(self) -> dict[str, Any]:
        """Returns the description as JSON represents it."""
        return json.loads(json.dumps(vars(self)))


def create_run(folder: Path, description: RunDescription) -> None:
    """Creates the folder of a new run, and writes the run's description to it.

    Of several processes that create a run in one folder at the same time, one succeeds.

    Args:
      folder: created if it does not exist.
      description: of the run.

    Raises:
      OSError: the folder cannot be created or written to, or holds another run.
    """
    folder.mkdir(parents=True, exist_ok=True)
    files.check_writable(folder)
    with _new_run(folder), files.atomic_create(folder / RUN_FILE) as partial:
        if any(folder.glob("seed_*")):
            raise FileExistsError
        partial.write_text(json.dumps(description.as_json(), indent=2) + "\n", encoding="utf-8")


def open_run(folder: Path, description: RunDescription) -> None:
    """Prepares the folder of an interrupted run for resuming: checks its description, removes incomplete files.

    Raises:
      OSError: the folder cannot be written to, or holds no run.
      ValueError: it holds a run with another description.
    """
    path = folder / RUN_FILE
    if not path.exists():
        raise FileNotFoundError(f"{folder} holds no training run to resume")
    files.check_writable(folder)
    found = files.parse(files.load_json(path, "the description of a training run"), RunDescription, str(path))
    present, expected = _entries(found), _entries(description)
    for name in {**expected, **present}:
        if present.get(name) != expected.get(name):
            one, other = json.dumps(present.get(name)), json.dumps(expected.get(name))
            raise ValueError(f"{folder} holds a run with {name} {one}, not {other}")
    for subfolder in (folder, *folder.glob("seed_*")):
        files.remove_stale_partials(subfolder)


@contextlib.contextmanager
def _new_run(folder: Path) -> Iterator[None]:
    """Names the folder and a remedy where a run exists already."""
    try:
        yield
    except FileExistsError as error:
        raise FileExistsError(f"{folder} holds a training run already: name another folder, or use --resume") from error


def _entries(description: RunDescription) -> dict[str, Any]:
    """Returns a description with the arguments of the task and the hyperparameters beside the other entries."""
    entries = description.as_json()
    return {**entries.pop("task_kwargs"), **entries.pop("hyperparameters"), **entries}
