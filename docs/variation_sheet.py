"""The sheet of kitchens under variations; rendering needs a GL library."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from kitchen_suite.domains.base import build_environment
from kitchen_suite.entities import build_kitchen_scene
from kitchen_suite.environment import Environment
from kitchen_suite.tasks import KitchenTask
from kitchen_suite.tasks.kitchen import variations

SHEET = Path(__file__).parent / "pictures" / "variations_kitchen.jpg"
HEIGHT, WIDTH = 180, 240
COLUMNS = 6
# Split and camera of each row.
ROWS = (("seen", "overview"), ("seen", "workspace"), ("held_out", "overview"), ("held_out", "workspace"))
# Groups that the sheet shows.
GROUPS = (variations.APPEARANCE, variations.CAMERA)

_LABEL_WIDTH = 110
_SEED = 0


def write_sheet() -> None:
    """Renders a different kitchen for each place of the sheet."""
    environment = kitchen()
    rows = []
    for row, (split, camera) in enumerate(ROWS):
        pictures = [picture(environment, split, camera, _SEED + row * COLUMNS + i) for i in range(COLUMNS)]
        rows.append(np.hstack([_label(f"{split.replace('_', ' ')},\n{camera}"), *pictures]))
    Image.fromarray(np.vstack(rows)).save(SHEET, quality=88, optimize=True)


def kitchen() -> Environment:
    """Returns the kitchen with the textures to choose from."""
    scene = build_kitchen_scene()
    scene.prepare_appearance()
    task = KitchenTask(scene)
    return build_environment(task, time_limit=None, random=0, render_quality="high", environment_kwargs=None)


def picture(environment: Environment, split: str, camera: str, seed: int) -> NDArray[np.uint8]:
    """Returns a picture `(HEIGHT, WIDTH, 3)` of the start of an episode, with values drawn from a split."""
    environment.reset()
    physics, random_state = environment.physics, np.random.RandomState(seed)
    parameters = {parameter.name: parameter for parameter in environment.task.scene.arena.parameters}
    fields = {field for parameter in parameters.values() for field in parameter.quantity.model_fields}
    built = {field: getattr(physics.model.ptr, field).copy() for field in fields}
    for varied in (varied for group in GROUPS for varied in group):
        value = np.asarray(varied.distribution(split)(random_state=random_state))
        parameters[varied.name].set(physics, value)
    physics.forward()
    pixels = physics.render(HEIGHT, WIDTH, camera_id=camera)
    for field, values in built.items():
        getattr(physics.model.ptr, field)[:] = values
    return pixels


def _label(text: str) -> NDArray[np.uint8]:
    image = Image.new("RGB", (_LABEL_WIDTH, HEIGHT), "white")
    ImageDraw.Draw(image).multiline_text((8, HEIGHT // 2 - 16), text, fill="black", font_size=15)
    return np.array(image)
