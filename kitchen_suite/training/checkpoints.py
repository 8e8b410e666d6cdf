"""Checkpoints of a training run. Files are written atomically, and the last few are kept."""

import pickle
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from tqdm import tqdm

from kitchen_suite import files

_PATTERN = "checkpoint_*.pt"
_NUM_KEPT = 3


class CheckpointError(Exception):
    """None of the checkpoints in a folder can be read."""


def save(folder: Path, steps: int, state: Mapping[str, Any]) -> Path:
    """Writes a checkpoint, and removes all but the last few.

    Args:
      folder: of the checkpoints.
      steps: control steps learned from; part of the file name.
      state: tensors, numbers and strings, in dicts and lists.

    Returns:
      The file.
    """
    path = folder / _PATTERN.replace("*", f"{steps:012d}")
    with files.atomic_write(path) as partial:
        torch.save(dict(state), partial)
    for old in _checkpoints(folder)[:-_NUM_KEPT]:
        old.unlink()
    return path


def load_last(folder: Path) -> dict[str, Any] | None:
    """Returns the state in the newest readable checkpoint, or None if there are no checkpoints.

    A message names each newer one that cannot be read.

    Raises:
      CheckpointError: there are checkpoints, but none can be read.
    """
    paths = _checkpoints(folder)
    for path in reversed(paths):
        try:
            return torch.load(path, weights_only=True)
        except (EOFError, OSError, RuntimeError, pickle.UnpicklingError, zipfile.BadZipFile) as error:
            reason = str(error).partition("\n")[0]
            tqdm.write(f"{path} cannot be read, trying the checkpoint before it: {reason}")
    if paths:
        raise CheckpointError(f"none of the {len(paths)} checkpoints in {folder} can be read")
    return None


def _checkpoints(folder: Path) -> list[Path]:
    """Returns the checkpoints in a folder, oldest first."""
    return sorted(folder.glob(_PATTERN))
