"""Checkpoints of a training run: written atomically, and checked before they are read; the last few are kept."""

import dataclasses
import hashlib
import io
import warnings
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any

import torch
from msgspec import Meta
from tqdm import tqdm

from kitchen_suite import checks, files

_PATTERN = "checkpoint_*.pt"
_NUM_KEPT = 3

_DIGEST_SIZE = 32  # A checkpoint ends with the SHA-256 of all before it, of this many bytes.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Checkpoint:
    """State of the run of a seed after an evaluation.

    Attributes:
      modules: state dicts of networks, scalers and optimiser, by name.
      random: state `(k,)` of PyTorch's random generator, uint8.
      steps: control steps learned from.
      warmup_batches: batches that still train the value network alone.
      seconds: duration of the run [s].
      processor_seconds: processor time of the run, over all threads [s].
      best: success rate and mean return of the best evaluation.
      progress: greatest mean progress of an evaluation.
      successes: success rates of the last evaluations.
    """

    modules: dict[str, Any]
    random: torch.Tensor
    steps: Annotated[int, Meta(ge=0)]
    warmup_batches: Annotated[int, Meta(ge=0)]
    seconds: Annotated[float, Meta(ge=0)]
    processor_seconds: Annotated[float, Meta(ge=0)]
    best: tuple[float, float]
    progress: float
    successes: Annotated[list[float], Meta(max_length=2)]


class CheckpointError(checks.WorkFailedError):
    """None of the checkpoints in a folder can be read."""


def save(folder: Path, checkpoint: Checkpoint) -> Path:
    """Writes a checkpoint, named by its control steps, and removes all but the last few; returns the file."""
    path = folder / _PATTERN.replace("*", f"{checkpoint.steps:012d}")
    contents = io.BytesIO()
    torch.save(vars(checkpoint), contents)
    with files.atomic_write(path) as partial, partial.open("wb") as file:
        file.write(contents.getbuffer())
        file.write(hashlib.sha256(contents.getbuffer()).digest())
    for old in sorted(folder.glob(_PATTERN))[:-_NUM_KEPT]:
        old.unlink()
    return path


def load_last(folder: Path, check: Callable[[Checkpoint], None] = lambda checkpoint: None) -> Checkpoint | None:
    """Returns the newest readable checkpoint in a folder that passes `check`, or None if there are no checkpoints.

    A message names each newer one that cannot be read, or for which `check` raises a ValueError; if none can be read,
    it raises a CheckpointError.
    """
    paths = sorted(folder.glob(_PATTERN))
    for path in reversed(paths):
        try:
            with files.reading(path, "a checkpoint"), warnings.catch_warnings():
                # PyTorch warns of what is then refused.
                warnings.simplefilter("ignore")
                contents = torch.load(_checked(path.read_bytes()), weights_only=True)
                checkpoint = files.parse(contents, Checkpoint, "a checkpoint")
                check(checkpoint)
                return checkpoint
        except OSError as error:
            if path == paths[0]:
                problem = f"none of the {len(paths)} checkpoints in {folder} can be read"
                raise CheckpointError(f"{problem}: {error}") from error
            tqdm.write(f"{error}; trying the checkpoint before it")
    return None


def _checked(contents: bytes) -> io.BytesIO:
    """Returns the zip file in a checkpoint; raises a ValueError unless the digest matches, before it is read."""
    state = contents[:-_DIGEST_SIZE]
    digest = contents[-_DIGEST_SIZE:]
    if hashlib.sha256(state).digest() != digest:
        raise ValueError("it does not end with its SHA-256: it is damaged, or of an earlier version")
    with zipfile.ZipFile(io.BytesIO(state)) as archive:
        if sum(member.file_size for member in archive.infolist()) > len(state):
            raise ValueError("PyTorch writes members without compression, but one is larger than the file")
    return io.BytesIO(state)


def check_modules(states: Mapping[str, Any], modules: Mapping[str, Any]) -> None:
    """Raises a ValueError unless keys, shapes and types are those of modules; damaged state dicts raise any error."""
    if states.keys() != modules.keys():
        raise ValueError(f"the modules must be {[*modules]}, got {[*states]}")
    for name, module in modules.items():
        if _form(states[name]) != _form(_template(module, states[name])):
            raise ValueError(f"the state of {name!r} is that of another network or optimiser, or of an earlier version")


def _template(module: Any, state: Mapping[str, Any]) -> dict[str, Any]:
    """Returns a state dict of a module, that of an Adam optimiser with the moments that `state` has."""
    template = module.state_dict()
    if isinstance(module, torch.optim.Optimizer):
        # Only parameters that have had a gradient have moments.
        parameters = [parameter for group in module.param_groups for parameter in group["params"]]
        moments = [{"step": torch.tensor(0.0), "exp_avg": each, "exp_avg_sq": each} for each in parameters]
        template["state"] = {i: moments[i] for i in state["state"]}
    return template


def _form(state: Any) -> Any:
    """Returns the keys, shapes and types in a state dict."""
    if isinstance(state, Mapping):
        return {key: _form(value) for key, value in state.items()}
    if isinstance(state, list | tuple):
        return [_form(value) for value in state]
    if isinstance(state, torch.Tensor):
        return state.shape, state.dtype
    return float if isinstance(state, int) else type(state)
