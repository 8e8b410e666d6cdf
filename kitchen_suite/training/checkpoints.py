"""Checkpoints of a training run, each file whole or absent; the last few are kept."""

import pickle
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from tqdm import tqdm

from kitchen_suite import files

_PATTERN = "checkpoint_*.pt"
_KEPT = 3


class CheckpointError(Exception):
    """There are checkpoints, but none of them can be read."""


def save(folder: Path, steps: int, state: Mapping[str, Any]) -> Path:
    """Writes a checkpoint, and removes all but the last few.

    Args:
      folder: where to.
      steps: control steps learned from, which make up the name.
      state: tensors, numbers and strings, in dicts and lists.

    Returns:
      The file.
    """
    path = folder / _PATTERN.replace("*", f"{steps:012d}")
    with files.whole_file(path) as partial:
        torch.save(dict(state), partial)
    for old in _present(folder)[:-_KEPT]:
        old.unlink()
    return path


def load_last(folder: Path) -> dict[str, Any] | None:
    """Reads the newest checkpoint that is whole; says which ones are not. `None` if there are none.

    Raises:
      CheckpointError: there are some, but none is whole.
    """
    present = _present(folder)
    for path in reversed(present):
        try:
            return torch.load(path, weights_only=True)
        except (EOFError, OSError, RuntimeError, pickle.UnpicklingError, zipfile.BadZipFile) as error:
            reason = str(error).partition("\n")[0]
            tqdm.write(f"{path} cannot be read, so an older checkpoint is looked for: {reason}")
    if present:
        raise CheckpointError(f"none of the {len(present)} checkpoints in {folder} can be read")
    return None


def _present(folder: Path) -> list[Path]:
    return sorted(folder.glob(_PATTERN))
