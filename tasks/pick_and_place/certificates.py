"""Certificates of the tasks with objects: which of them the expert has completed in which kitchen.

Files are as those of generated kitchens, see `generated_kitchens.certificates`, with certificates of another kind.
"""

import hashlib
import json
from pathlib import Path

import msgspec

from kitchen_suite import files
from kitchen_suite.entities.kitchen_designs import KitchenDesign
from kitchen_suite.entities.object_layouts import ObjectLayout
from kitchen_suite.tasks.generated_kitchens import certificates

_SHIPPED = Path(__file__).parent / "certificates"

# How a certificate is made, for messages; `certificates` is this module.
_REMEDY = (
    "kitchen_suite.evaluation.certification.write_certificates(certificates.default_path('{split}'), [{number}], "
    "'{split}', kind=kitchen_suite.evaluation.object_certification.OBJECTS)"
)


class ObjectCertificate(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The tasks with objects that the expert completed in a kitchen, of those that it tried.

    Attributes:
      design: its number in the split.
      digest: of its design, see `certificates.design_digest`.
      layout: of its objects, see `layout_digest`.
      physics: one of `physics_names.PHYSICS`, in which the expert played.
      steps: control steps in which the expert completed each task in the slower of two episodes; None where it did not
        complete it in both.
    """

    design: int
    digest: str
    layout: str
    physics: str
    steps: dict[str, int | None]

    @property
    def certified(self) -> tuple[str, ...]:
        """The tasks that the expert completed."""
        return tuple(task for task, steps in self.steps.items() if steps is not None)


def layout_digest(layout: ObjectLayout) -> str:
    """Returns the first 16 hexadecimal digits of the SHA-256 of a layout's JSON."""
    return hashlib.sha256(json.dumps(layout.to_json(), sort_keys=True).encode()).hexdigest()[:16]


def default_path(split: str) -> Path | None:
    """Returns the file of a split in the user's cache folder; None if there is no such folder."""
    folder = files.cache_folder()
    return None if folder is None else folder / f"object_certificates_{split}.jsonl"


def is_shipped(design: KitchenDesign) -> bool:
    """Returns whether the package has a certificate of the number of a design of a split."""
    return certificates.is_in(design, ObjectCertificate, _SHIPPED)


def certified_tasks(design: KitchenDesign, layout: ObjectLayout) -> tuple[str, ...]:
    """Returns the tasks that the expert completed in a kitchen with a layout of its objects.

    Raises a ValueError if there is no certificate of the kitchen and this layout, and an OSError for a damaged file.
    """
    found = certificates.find(design, ObjectCertificate, _SHIPPED, default_path, _REMEDY)
    if found.layout != layout_digest(layout):
        raise ValueError(
            f"the certificate of kitchen {design.name} is of other objects: leave out objects or certified"
        )
    return found.certified
