"""Certificates of generated kitchens: what was found when they were built and the expert played in them.

A file has a line of JSON for each kitchen. The package has those of the first kitchens of both splits, and
`kitchen_suite.evaluation.certification` makes others; those in the user's cache folder are found as well.
"""

import functools
import hashlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Protocol, TypeVar

import msgspec

from kitchen_suite import checks, files
from kitchen_suite.entities.kitchen_designs import SPLITS, KitchenDesign

_SHIPPED = Path(__file__).parent / "certificates"

# How a certificate is made, for messages.
_REMEDY = (
    "kitchen_suite.evaluation.certification.write_certificates(certificates.default_path('{split}'), [{number}], "
    "'{split}')"
)

# Bounds of what is read [bytes]: a certificate has some 2 KiB, and a file those of thousands of kitchens.
_MAX_BYTES = 64 * 2**20
_MAX_LINE = 2**16


class Certificate(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Measurements of a kitchen, and the tasks that the expert completed in it.

    Attributes:
      design: its number in the split.
      digest: of its design, see `design_digest`.
      physics: one of `physics_names.PHYSICS`, in which the expert played.
      depth_mm: greatest depth of colliding parts of different fixtures in each other at the start.
      reached: by handle, such as `drawers_1/drawer_2`, whether the arm reaches it: by a planned motion, or when the
        expert opened the part or turned it on.
      steps: control steps in which the expert completed each task from the start; None where it did not.
    """

    design: int
    digest: str
    physics: str
    depth_mm: float
    reached: dict[str, bool]
    steps: dict[str, int | None]

    @property
    def certified(self) -> tuple[str, ...]:
        """The tasks that the expert completed."""
        return tuple(task for task, steps in self.steps.items() if steps is not None)


def design_digest(design: KitchenDesign) -> str:
    """Returns the first 16 hexadecimal digits of the SHA-256 of a design's JSON."""
    return hashlib.sha256(json.dumps(design.to_json(), sort_keys=True).encode()).hexdigest()[:16]


class KitchenCertificate(Protocol):
    """A certificate of a kitchen, as files have them: structs of msgspec whose first field is the design.

    Attributes:
      design: its number in the split.
      digest: of its design, see `design_digest`.
    """

    @property
    def design(self) -> int: ...

    @property
    def digest(self) -> str: ...


C = TypeVar("C", bound=KitchenCertificate)


def read(path: Path, kind: type[C] = Certificate) -> dict[int, C]:  # type: ignore[assignment]
    """Returns the certificates of a kind in a file, by design; a last one that was cut off is left out.

    Raises an OSError if there is anything else in the file.
    """
    with files.reading(path, "a file of certificates"):
        files.check_size(path.stat().st_size, _MAX_BYTES)
        *lines, rest = path.read_bytes().split(b"\n")
        if not rest.startswith(b'{"design":'[: len(rest)]):
            raise ValueError("the last line is not a certificate")
        if any(len(line) > _MAX_LINE for line in lines):
            raise ValueError(f"it has a line of more than {_MAX_LINE} bytes")
        certificates = [files.parse(files.parse_json(line), kind, "not a certificate") for line in lines]
    return {certificate.design: certificate for certificate in certificates}


def is_shipped(design: KitchenDesign) -> bool:
    """Returns whether the package has a certificate of the number of a design of a split."""
    return is_in(design, Certificate, _SHIPPED)


def is_in(design: KitchenDesign, kind: type[C], folder: Path) -> bool:
    """Returns whether a folder has a certificate of a kind of the number of a design of a split."""
    split, _, number = design.name.partition("/")
    path = folder / f"{split}.jsonl"
    return path.exists() and int(number) in _read(path, path.stat().st_mtime_ns, kind)


def default_path(split: str) -> Path | None:
    """Returns the file of a split in the user's cache folder; None if there is no such folder."""
    folder = files.cache_folder()
    return None if folder is None else folder / f"certificates_{split}.jsonl"


@functools.lru_cache(maxsize=8)
def _read(path: Path, changed: int, kind: type[C] = Certificate) -> Mapping[int, C]:  # type: ignore[assignment]
    """Returns what a file holds that was changed at a time [ns]."""
    return read(path, kind)


def certificate_of(design: KitchenDesign) -> Certificate:
    """Returns the certificate of a design, that of the package or of the user's cache folder.

    Raises a ValueError if there is none, or it is of another design, and an OSError for a file that is damaged.
    """
    return find(design, Certificate, _SHIPPED, default_path, _REMEDY)


def find(design: KitchenDesign, kind: type[C], shipped: Path, cached: Callable[[str], Path | None], remedy: str) -> C:
    """Returns the certificate of a kind of a design, that of the package or of the user's cache folder.

    Args:
      design: with a number of a split.
      kind: of the certificate.
      shipped: folder in which the package has those of the kind.
      cached: returns the file of a split in the user's cache folder; None if there is no such folder.
      remedy: call that makes one, with places for `split` and `number`.

    Raises a ValueError if there is none, or it is of another design, and an OSError for a file that is damaged.
    """
    split, _, number = design.name.partition("/")
    if not number:
        raise ValueError("only kitchens of a split have certificates: certified needs a number as design")
    checks.choice(split, SPLITS, "split")
    for path in (shipped / f"{split}.jsonl", cached(split)):
        if path is not None and path.exists():
            found = _read(path, path.stat().st_mtime_ns, kind).get(int(number))
            if found is not None:
                check_design(found, design, path)
                return found
    raise ValueError(f"kitchen {design.name} has no certificate: {remedy.format(split=split, number=number)} makes one")


def check_design(certificate: KitchenCertificate, design: KitchenDesign, path: Path) -> None:
    """Raises a ValueError unless the certificate that a file has for a design is of this design."""
    if certificate.digest != design_digest(design):
        raise ValueError(
            f"{path} has a certificate of another design as kitchen {design.name}: remove its line, or the file, and "
            f"certify it again"
        )
