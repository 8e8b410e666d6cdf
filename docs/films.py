"""Pictures of the scripted experts at work.

python docs/films.py strips    a film strip of each task into docs/pictures/
python docs/films.py video     all tasks side by side, docs/pictures/experts.mp4 (needs the extra `video`)

Both need the extra `experts` and a GL library.
"""

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from kitchen_suite import experts, recording, suite

PICTURES = Path(__file__).parent / "pictures"
# Pictures in a strip, and tiles in a row of the video.
FRAMES, COLUMNS = 6, 3
HEIGHT, WIDTH = 210, 280
# Frames of the video in a second, and control steps of either domain that a frame stands for.
RATE, PACE = 12.5, {"kitchen": 1, "open_cabinet": 8}
CAMERAS = {"kitchen": "overview", "open_cabinet": "overview"}
SINGLE = [(domain, task) for domain, task in suite.ALL_TASKS if task not in ("complete", "partial", "mixed", "all")]


def film(domain: str, task: str) -> Iterator[NDArray[np.uint8]]:
    """Pictures `(height, width, 3)` of an episode until its task is done, one for each frame of the video."""
    environment = suite.load(domain, task, {"random": 0})
    policy = experts.make_policy(environment, np.random.default_rng(0))
    timestep, step = environment.reset(), 0
    while not timestep.last() and not environment.task.episode_results["success"]:
        if step % PACE[domain] == 0:
            yield environment.physics.render(HEIGHT, WIDTH, camera_id=CAMERAS[domain])
        timestep, step = environment.step(policy(timestep)), step + 1
    yield environment.physics.render(HEIGHT, WIDTH, camera_id=CAMERAS[domain])


def write_strips() -> None:
    """Writes pictures from the beginning to the end of an episode, side by side, for each task."""
    for domain, task in [*SINGLE, ("kitchen", "complete"), ("kitchen", "mixed"), ("kitchen", "all")]:
        frames = list(film(domain, task))
        chosen = np.linspace(0, len(frames) - 1, FRAMES).round().astype(int)
        strip = np.hstack([frames[i] for i in chosen])
        Image.fromarray(strip).save(PICTURES / f"expert_{task}.png", optimize=True)
        print(f"{domain} {task}: {len(frames)} frames")


def write_video() -> None:
    """Films all tasks side by side; each waits at its end for the longest."""
    films = [list(film(domain, task)) for domain, task in SINGLE]
    longest = max(map(len, films))
    size = {"height": HEIGHT * (len(films) // COLUMNS), "width": WIDTH * COLUMNS}
    with recording.open_video(PICTURES / "experts.mp4", **size, frames_per_second=RATE) as add:
        for i in range(longest):
            tiles = [frames[min(i, len(frames) - 1)] for frames in films]
            rows = [np.hstack(tiles[start : start + COLUMNS]) for start in range(0, len(tiles), COLUMNS)]
            add(np.vstack(rows))


if __name__ == "__main__":
    commands = {"strips": write_strips, "video": write_video}
    if len(sys.argv) != 2 or sys.argv[1] not in commands:
        sys.exit(__doc__)
    commands[sys.argv[1]]()
