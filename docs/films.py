"""Pictures of the scripted experts at work, and of the trained policies.

python docs/films.py strips    a film strip of each task into docs/pictures/
python docs/films.py trained   one of each policy that comes with the package
python docs/films.py video     all tasks side by side, docs/pictures/experts.mp4 (needs the extra `video`)

All need a GL library, and all but the second the extra `experts`.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from tqdm import tqdm

from kitchen_suite import policies, suite
from kitchen_suite.rendering import video

PICTURES = Path(__file__).parent / "pictures"
# Pictures in a strip, and tiles in a row of the video.
FRAMES, COLUMNS = 6, 3
HEIGHT, WIDTH = 210, 280
# Frames of the video in a second, and control steps of either domain that a frame stands for.
RATE, PACE = 12.5, {"kitchen": 1, "open_cabinet": 8}
SINGLE = [(domain, task) for domain, task in suite.ALL_TASKS if task not in ("complete", "partial", "mixed", "all")]


class Film:
    """An episode until its task is done; pictures of it are made when they are asked for."""

    def __init__(self, domain: str, task: str, policy_name: str = "expert", **task_kwargs: Any) -> None:
        """Plays the episode, and notes the state of the physics at each frame of the video."""
        self._environment = suite.load(domain, task, {"random": 0, **task_kwargs})
        policy = policies.find(policy_name)(self._environment, np.random.default_rng(0))
        timestep, step = self._environment.reset(), 0
        self._states = [self._environment.physics.get_state()]
        while not timestep.last() and not self._environment.task.episode_results["success"]:
            timestep, step = self._environment.step(policy(timestep)), step + 1
            if step % PACE[domain] == 0:
                self._states.append(self._environment.physics.get_state())

    def __len__(self) -> int:
        return len(self._states)

    def __getitem__(self, frame: int) -> NDArray[np.uint8]:
        """A picture `(height, width, 3)`."""
        physics = self._environment.physics
        with physics.reset_context():
            physics.set_state(self._states[frame])
        return physics.render(HEIGHT, WIDTH, camera_id="overview")


def write_strips() -> None:
    """Writes pictures from the beginning to the end of an episode, side by side, for each task."""
    for domain, task in [*SINGLE, ("kitchen", "complete"), ("kitchen", "mixed"), ("kitchen", "all")]:
        write_strip(f"expert_{task}", Film(domain, task))


def write_trained_strips() -> None:
    """The same for the policies that come with the package."""
    for name, reward in (("top_drawer", "original"), ("top_drawer_grasp", "grasp")):
        write_strip(f"trained_{name}", Film("open_cabinet", "top_drawer", "trained", reward=reward))


def write_strip(name: str, film: Film) -> None:
    """Writes a strip of pictures, evenly spread over a film."""
    chosen = np.linspace(0, len(film) - 1, FRAMES).round().astype(int)
    Image.fromarray(np.hstack([film[i] for i in chosen])).save(PICTURES / f"{name}.png", optimize=True)
    print(f"{name}: {len(film)} frames")


def write_video() -> None:
    """Films all tasks side by side; each waits at its end for the longest."""
    films = [Film(domain, task) for domain, task in SINGLE]
    size = {"height": HEIGHT * (len(films) // COLUMNS), "width": WIDTH * COLUMNS}
    with video.open_video(PICTURES / "experts.mp4", **size, frames_per_second=RATE) as add:
        for i in tqdm(range(max(map(len, films)))):
            tiles = [film[min(i, len(film) - 1)] for film in films]
            rows = [np.hstack(tiles[start : start + COLUMNS]) for start in range(0, len(tiles), COLUMNS)]
            add(np.vstack(rows))


if __name__ == "__main__":
    commands = {"strips": write_strips, "trained": write_trained_strips, "video": write_video}
    if len(sys.argv) != 2 or sys.argv[1] not in commands:
        sys.exit(__doc__)
    commands[sys.argv[1]]()
