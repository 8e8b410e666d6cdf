"""The sheets of scenes under variations; rendering needs a GL library."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from kitchen_suite import suite
from kitchen_suite.environment import Environment
from kitchen_suite.tasks.variations.distributions import SPLITS

PICTURES = Path(__file__).parent / "pictures"
HEIGHT, WIDTH = 180, 240
# Groups that pictures show.
GROUPS = ("start", "layout", "appearance", "camera")

_LABEL_WIDTH = 110
_SEED = 0


@dataclasses.dataclass(frozen=True, kw_only=True)
class Sheet:
    """A picture with one row for each split and camera.

    Attributes:
      domain: of the scenes.
      task: of the episodes.
      cameras: of the rows of each split.
      columns: scenes in a row.
    """

    domain: str
    task: str
    cameras: Sequence[str]
    columns: int


SHEETS = (
    Sheet(domain="kitchen", task="complete", cameras=("overview", "workspace"), columns=6),
    Sheet(domain="open_cabinet", task="top_drawer", cameras=("overview",), columns=4),
)


def write_sheets() -> None:
    """Renders another scene for each place of each sheet."""
    for sheet in SHEETS:
        rows = [row for split in SPLITS for row in _rows(sheet, split)]
        path = PICTURES / f"variations_{sheet.domain}.jpg"
        Image.fromarray(np.vstack(rows)).save(path, quality=88, optimize=True)


def _rows(sheet: Sheet, split: str) -> list[NDArray[np.uint8]]:
    environment = suite.load(
        sheet.domain, sheet.task, {"random": _SEED, "variations": GROUPS, "variation_split": split}
    )
    return [
        np.hstack([_label(f"{split.replace('_', ' ')},\n{camera}"), *_pictures(environment, camera, sheet.columns)])
        for camera in sheet.cameras
    ]


def _pictures(environment: Environment, camera: str, count: int) -> list[NDArray[np.uint8]]:
    """Returns pictures `(HEIGHT, WIDTH, 3)` of the starts of the next episodes."""
    pictures = []
    for _ in range(count):
        environment.reset()
        pictures.append(environment.physics.render(HEIGHT, WIDTH, camera_id=camera))
    return pictures


def _label(text: str) -> NDArray[np.uint8]:
    image = Image.new("RGB", (_LABEL_WIDTH, HEIGHT), "white")
    ImageDraw.Draw(image).multiline_text((8, HEIGHT // 2 - 16), text, fill="black", font_size=15)
    return np.array(image)
