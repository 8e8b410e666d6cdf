"""Film strips and a video of the scripted experts and the trained policies.

python docs/films.py strips    a film strip of each task into docs/pictures/
python docs/films.py further   a film strip of each of the kitchen's tasks beyond the reference's
python docs/films.py trained   a film strip of each policy that comes with the package
python docs/films.py video     all tasks side by side: docs/pictures/experts.mp4 (needs the extra `video`)

All need a GL library; `strips`, `further` and `video` need the extra `experts`.
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
from kitchen_suite.tasks import DEFAULT_TASKS, GOALS

PICTURES = Path(__file__).parent / "pictures"
FRAMES = 6  # In a strip.
COLUMNS = 3  # Tiles in a row of the video.
HEIGHT, WIDTH = 210, 280
FRAMES_PER_SECOND = 12.5
SINGLE_TASKS = [
    *(("kitchen", task.replace(" ", "_")) for task in DEFAULT_TASKS),
    *(("open_cabinet", task) for task in suite.TASKS_BY_DOMAIN["open_cabinet"]),
]
FURTHER_TASKS = [("kitchen", task.replace(" ", "_")) for task in GOALS if task not in DEFAULT_TASKS]
SETS = [("kitchen", "complete"), ("kitchen", "mixed"), ("kitchen", "all")]


class Film:
    """The frames of an episode until the success of its task; each is rendered when it is accessed."""

    def __init__(self, domain: str, task: str, policy_name: str = "expert", **task_kwargs: Any) -> None:
        """Plays the episode, and stores the physics state of each frame."""
        self._environment = suite.load(domain, task, {"random": 0, **task_kwargs})
        policy = policies.find(policy_name)(self._environment, np.random.default_rng(0))
        timestep, step = self._environment.reset(), 0
        self._states = [self._environment.physics.get_state()]
        steps_per_frame = round(1 / (FRAMES_PER_SECOND * self._environment.control_timestep()))
        while not timestep.last() and not self._environment.task.episode_metrics["success"]:
            timestep, step = self._environment.step(policy(timestep)), step + 1
            if step % steps_per_frame == 0:
                self._states.append(self._environment.physics.get_state())

    def __len__(self) -> int:
        return len(self._states)

    def __getitem__(self, frame: int) -> NDArray[np.uint8]:
        """Renders a frame `(height, width, 3)`."""
        physics = self._environment.physics
        with physics.reset_context():
            physics.set_state(self._states[frame])
        return physics.render(HEIGHT, WIDTH, camera_id="overview")


def write_strips() -> None:
    """Writes a film strip of the expert for each task."""
    for domain, task in [*SINGLE_TASKS, *SETS]:
        write_strip(f"expert_{task}", Film(domain, task))


def write_further_strips() -> None:
    """Writes a film strip of the expert for each of the kitchen's tasks beyond the reference's."""
    for domain, task in FURTHER_TASKS:
        write_strip(f"expert_{task}", Film(domain, task))


def write_trained_strips() -> None:
    """Writes a film strip of each policy that comes with the package."""
    for name, reward in (("top_drawer", "original"), ("top_drawer_grasp", "grasp")):
        write_strip(f"trained_{name}", Film("open_cabinet", "top_drawer", "trained", reward=reward))


def write_strip(name: str, film: Film) -> None:
    """Writes frames evenly spread over a film, side by side."""
    chosen = np.linspace(0, len(film) - 1, FRAMES).round().astype(int)
    Image.fromarray(np.hstack([film[i] for i in chosen])).save(PICTURES / f"{name}.png", optimize=True)
    print(f"{name}: {len(film)} frames")


def write_video() -> None:
    """Films all tasks side by side; each shows its last frame until the longest has ended."""
    films = [Film(domain, task) for domain, task in SINGLE_TASKS]
    size = {"height": HEIGHT * (len(films) // COLUMNS), "width": WIDTH * COLUMNS}
    with video.open_video(PICTURES / "experts.mp4", **size, frames_per_second=FRAMES_PER_SECOND) as add_frame:
        for i in tqdm(range(max(map(len, films)))):
            tiles = [film[min(i, len(film) - 1)] for film in films]
            rows = [np.hstack(tiles[start : start + COLUMNS]) for start in range(0, len(tiles), COLUMNS)]
            add_frame(np.vstack(rows))


if __name__ == "__main__":
    commands = {
        "strips": write_strips,
        "further": write_further_strips,
        "trained": write_trained_strips,
        "video": write_video,
    }
    if len(sys.argv) != 2 or sys.argv[1] not in commands:
        sys.exit(__doc__)
    commands[sys.argv[1]]()
