"""Certificates of generated kitchens: what was found when they were built and the expert played in them.

A file has a line of JSON for each kitchen. The package has those of the first kitchens of both splits, and
`kitchen-certify` writes others, by default to the user's cache folder.
"""

import functools
import hashlib
import json
from collections.abc import Mapping
from pathlib import Path

import msgspec

from kitchen_suite import checks, files
from kitchen_suite.entities.designs import SPLITS, KitchenDesign

_SHIPPED = Path(__file__).parent / "certificates"


class Certificate(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Measurements of a kitchen, and the tasks that the expert completed in it.

    Attributes:
      design: its number in the split.
      digest: of its design, see `design_digest`.
      physics: one of `names.PHYSICS`, in which the expert played.
      depth_mm: greatest depth of colliding parts of different fixtures in each other at the start.
      reached: handles that the arm reaches, by name such as `drawers_1/drawer_2`; others it does not.
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


def read(path: Path) -> dict[int, Certificate]:
    """Returns the certificates in a file, by design; an incomplete last line is left out.

    Raises a ValueError if there is a line that is no certificate.
    """
    text = path.read_bytes()
    complete = text[: text.rfind(b"\n") + 1].splitlines()
    with files.reading(path, "a file of certificates"):
        certificates = [msgspec.json.decode(line, type=Certificate) for line in complete]
    return {certificate.design: certificate for certificate in certificates}


def default_path(split: str) -> Path | None:
    """Returns the file of a split in the user's cache folder; None if there is no such folder."""
    folder = files.cache_folder()
    return None if folder is None else folder / f"certificates_{split}.jsonl"


@functools.cache
def _known(split: str) -> Mapping[int, Certificate]:
    """Certificates of a split: those of the package, and those in the user's cache folder."""
    known: dict[int, Certificate] = {}
    for path in (default_path(split), _SHIPPED / f"{split}.jsonl"):
        if path is not None and path.exists():
            known |= read(path)
    return known


def certificate_of(design: KitchenDesign) -> Certificate:
    """Returns the certificate of a design; raises a ValueError if there is none, or it is of another design."""
    split, _, number = design.name.partition("/")
    if not number:
        raise ValueError("only kitchens of a split have certificates: certified needs a number as design")
    checks.choice(split, SPLITS, "split")
    found = _known(split).get(int(number))
    if found is None:
        command = f"kitchen-certify --split={split} --designs={number}:{int(number) + 1}"
        raise ValueError(f"kitchen {design.name} has no certificate: {command} makes one")
    check_design(found, design)
    return found


def check_design(certificate: Certificate, design: KitchenDesign) -> None:
    """Raises a ValueError unless a certificate is of a design."""
    if certificate.digest != design_digest(design):
        raise ValueError(
            f"the certificate of kitchen {design.name} is of another design: certify it again, to a new file"
        )
