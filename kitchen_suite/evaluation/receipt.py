"""Receipts: files from which anyone can play the episodes of an evaluation again, without the policy.

A receipt is an npz file, whose zip comment is the SHA-256, in hexadecimal, of all bytes before it. Its array `metadata`
is a string of JSON, see `Receipt`. The arrays of each condition, such as `complete/actions`, are those of `traces`.
"""

import dataclasses
import hashlib
import io
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from kitchen_suite import checks, files
from kitchen_suite.evaluation.scores import EpisodeResult
from kitchen_suite.evaluation.traces import ARRAYS, Trace, stacked, unstacked
from kitchen_suite.versions import machine

FORMAT = 2

# Bounds of what is written, so that it can be read again. A control step of the kitchen takes 38 bytes.
MAX_EPISODES = 50_000
MAX_STEPS = 10_000_000  # Control steps of all episodes.
ENTRY_SIZE = 1_250  # Greatest length of an episode in the metadata, beside its goals [characters].
MAX_METADATA = 2**26  # Greatest length of the metadata [characters], each of four bytes in the array.
_MAX_BYTES = 2**30  # Greatest size of the file, and of its arrays together [bytes].

_MAX_TEXT = 1_000  # Greatest length of a text in the metadata [characters].
_SEAL = 2 * hashlib.sha256().digest_size  # Length of the digest at the end of the file [bytes].


@dataclasses.dataclass(frozen=True, kw_only=True)
class Receipt:
    """The contents of a receipt's file.

    Attributes:
      evaluation: see `Evaluation.as_json`.
      replaced: see `EvaluationPlan.replaced`.
      results: of all episodes, by condition.
      traces: of all episodes, by condition.
      machine: kind of processor that played them, see `versions.machine`.
    """

    evaluation: dict[str, Any]
    replaced: list[str]
    results: Mapping[str, Sequence[EpisodeResult]]
    traces: Mapping[str, Sequence[Trace]]
    machine: str = dataclasses.field(default_factory=machine)

    def write(self, path: Path) -> None:
        record = {
            "format": FORMAT,
            "evaluation": self.evaluation,
            "replaced": self.replaced,
            "machine": self.machine,
            "episodes": {name: [result.as_json() for result in each] for name, each in self.results.items()},
        }
        arrays = {f"{name}/{part}": rows for name, each in self.traces.items() for part, rows in stacked(each).items()}
        with files.atomic_write(path) as partial:
            partial.write_bytes(sealed(files.pack_arrays({**arrays, "metadata": np.array(files.json_text(record))})))

    @classmethod
    def read(cls, path: Path) -> "Receipt":
        """Returns the receipt in a file; raises an OSError unless it is one of this format, unchanged."""
        with files.reading(path, "a receipt of kitchen-evaluate"):
            files.check_size(path.stat().st_size, _MAX_BYTES)
            contents = path.read_bytes()
            if _seal(contents[:-_SEAL]) != contents[-_SEAL:]:
                raise ValueError("its SHA-256 does not match: it was changed, or is another file")
            arrays = files.unpack_arrays(io.BytesIO(contents), _MAX_BYTES)
            metadata = files.as_metadata(arrays.pop("metadata"), MAX_METADATA)
            if metadata.get("format") != FORMAT:
                raise ValueError(f"format {metadata.get('format')!r} is unknown: this version reads {FORMAT}")
            check_texts(metadata)
            parts = {"machine": metadata["machine"], "results": metadata["episodes"], "traces": {}}
            receipt = files.parse({**metadata, **parts}, cls, "not its metadata")
            traces = {}
            for name, results in receipt.results.items():
                own = {part: arrays.pop(f"{name}/{part}") for part in ARRAYS}
                traces[name] = unstacked(own, len(results))
            if arrays:
                raise ValueError(f"it has unknown arrays {checks.shown(sorted(arrays))}")
            return dataclasses.replace(receipt, traces=traces)


def check_texts(value: Any) -> None:
    """Raises a ValueError unless all texts in decoded JSON can be printed, in a line of bounded length."""
    if isinstance(value, Mapping):
        value = [*value, *value.values()]
    if isinstance(value, list):
        for part in value:
            check_texts(part)
    elif isinstance(value, str) and not (value.isprintable() and len(value) <= _MAX_TEXT):
        raise ValueError(f"it has a text that cannot be shown: {checks.shown(value)}")


def sealed(archive: bytes) -> bytes:
    """Returns a zip archive with the SHA-256 of all before it as its comment."""
    buffer = io.BytesIO(archive)
    with zipfile.ZipFile(buffer, "a") as zipped:
        zipped.comment = bytes(_SEAL)
    contents = buffer.getvalue()[:-_SEAL]
    return contents + _seal(contents)


def _seal(contents: bytes) -> bytes:
    return hashlib.sha256(contents).hexdigest().encode()
