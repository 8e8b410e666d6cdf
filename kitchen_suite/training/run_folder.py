"""The folder of a training run: its description, by which a resumed run is recognised as the same."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from kitchen_suite import files

RUN_FILE = "training.json"


def create_run(folder: Path, description: Mapping[str, Any]) -> None:
    """Creates the folder of a new run, and writes the run's description to it.

    Args:
      folder: created if it does not exist.
      description: task, hyperparameters and seed, as JSON can hold them.

    Raises:
      OSError: the folder cannot be created or written to, or holds another run.
    """
    path = folder / RUN_FILE
    folder.mkdir(parents=True, exist_ok=True)
    files.check_writable(folder)
    if path.exists() or any(folder.glob("seed_*")):
        raise FileExistsError(f"{folder} holds a training run already: name another folder, or use --resume")
    with files.atomic_write(path) as partial:
        partial.write_text(json.dumps(description, indent=2) + "\n", encoding="utf-8")


def open_run(folder: Path, description: Mapping[str, Any]) -> None:
    """Prepares the folder of an interrupted run for resuming: checks its description, removes incomplete files.

    Raises:
      OSError: the folder cannot be written to, or holds no run.
      ValueError: it holds a run with another description.
    """
    path = folder / RUN_FILE
    if not path.exists():
        raise FileNotFoundError(f"{folder} holds no training run to resume")
    files.check_writable(folder)
    for subfolder in (folder, *folder.glob("seed_*")):
        files.remove_stale_partials(subfolder)
    present = _entries(json.loads(path.read_text(encoding="utf-8")))
    expected = _entries(json.loads(json.dumps(description)))
    for name in {**expected, **present}:
        if present.get(name) != expected.get(name):
            found, given = json.dumps(present.get(name)), json.dumps(expected.get(name))
            raise ValueError(f"{folder} holds a run with {name} {found}, not {given}")


def _entries(description: Mapping[str, Any]) -> dict[str, Any]:
    """Returns a description with the arguments of the task and the hyperparameters beside the other entries."""
    entries: dict[str, Any] = {}
    for name, value in description.items():
        entries |= value if isinstance(value, dict) else {name: value}
    return entries
