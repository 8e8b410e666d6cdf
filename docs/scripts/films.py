"""Pictures and films of the scripted experts and the trained policies.

python docs/scripts/films.py strips    six frames of each task, and of sets of tasks, into docs/pictures/
python docs/scripts/films.py further   six frames of each of the kitchen's tasks beyond the reference's
python docs/scripts/films.py trained   six frames of each policy that comes with the package
python docs/scripts/films.py readme    the moving picture of README: docs/pictures/film.webp
python docs/scripts/films.py mug       the mug of docs/guide/your_task.md in a hand: docs/pictures/mug.webp
python docs/scripts/films.py video     all tasks side by side: docs/pictures/experts.mp4 (needs the extra `video`)

All need a GL library; all but `trained` need the extra `experts`.
"""

import runpy
from typing import Any, NamedTuple

import numpy as np
from dm_control.mujoco.engine import MovableCamera
from experiment import PICTURES, run_named, timesteps
from numpy.typing import NDArray
from pictures import SMOOTHING, reduced
from PIL import Image, ImageDraw
from tqdm import tqdm

from kitchen_suite import policies, suite
from kitchen_suite.episodes import video
from kitchen_suite.grasping import CONTROL_MODE, Grasp
from kitchen_suite.tasks import DEFAULT_TASKS, GOALS

FRAMES = 6  # In a picture of a task.
COLUMNS = 3  # Frames in a row of such a picture, and tiles in a row of the video.
HEIGHT, WIDTH = 240, 320  # Of a frame [pixels].
FRAMES_PER_SECOND = 12.5
AFTER_SUCCESS = 1.0  # Time that a film goes on after success [s].

# Size of the moving picture of README, its frames per second, how much faster than the simulation it is, quality of its
# compression, and how long the last frame of an episode is shown [ms].
FILM_HEIGHT, FILM_WIDTH = 480, 640
FILM_FRAMES_PER_SECOND = 25
FILM_SPEED = 4
FILM_QUALITY = 55
HOLD = 1500

SINGLE_TASKS = [
    *(("kitchen", task.replace(" ", "_")) for task in DEFAULT_TASKS),
    *(("open_cabinet", task) for task in suite.TASKS_BY_DOMAIN["open_cabinet"]),
]
FURTHER_TASKS = [("kitchen", task.replace(" ", "_")) for task in GOALS if task not in DEFAULT_TASKS]
SETS = [("kitchen", "complete"), ("kitchen", "mixed"), ("kitchen", "all")]

# The episode of the moving picture of README: in a kitchen that has a microwave beside the drawer.
FILM_EPISODE = {
    "domain": "pick_and_place",
    "task": "open_and_put_in",
    "design": 20,
    "split": "test",
    "certified": ["open_and_put_in can drawers_1/drawer_1"],
}

Frame = NDArray[np.uint8]


class View(NamedTuple):
    """A camera that looks at a point [m] from a distance [m], with azimuth and elevation [degrees]."""

    lookat: tuple[float, float, float]
    distance: float
    azimuth: float
    elevation: float


# Views from which one sees the parts of a task; all other tasks are seen from `overview`. The first whose key is in the
# task's name is taken.
VIEWS = {
    "drawer": View((0.42, 0.0, 0.42), 1.75, 128.0, -18.0),
    "burner": View((-0.15, 0.55, 1.98), 1.75, 62.0, -28.0),
    "light_switch": View((-0.2, 0.55, 2.1), 1.75, 62.0, -22.0),
    "hinge_cabinet": View((-0.4, 0.6, 2.3), 2.0, 62.0, -16.0),
    "slide_cabinet": View((0.1, 0.6, 2.3), 2.0, 62.0, -16.0),
    "microwave": View((-0.5, 0.4, 1.85), 1.9, 72.0, -30.0),
    "kettle": View((-0.2, 0.45, 1.8), 1.75, 50.0, -32.0),
    "open_and_put_in": View((0.05, 0.28, 1.75), 1.6, 54.0, -36.0),
}

# From which one sees the mug of docs/guide/your_task.md.
MUG_VIEW = View((-0.5, 0.05, 1.8), 1.4, 160.0, -20.0)


class Film:
    """The frames of an episode until shortly after success; each is rendered when it is accessed."""

    def __init__(
        self,
        domain: str,
        task: str,
        policy_name: str = "expert",
        *,
        frames_per_second: float = FRAMES_PER_SECOND,
        **task_kwargs: Any,
    ) -> None:
        """Plays the episode, and stores the physics state of each frame.

        Args:
          domain: of the suite.
          task: of the domain.
          policy_name: of the policy that acts.
          frames_per_second: of simulated time.
          **task_kwargs: further keywords of the environment.
        """
        # An episode of the kitchen would end with the step that completes the last task, before that can be seen.
        kwargs = {"terminate_on_tasks_completed": False} if domain == "kitchen" else {}
        self._environment = suite.load(domain, task, {"random": 0, **kwargs, **task_kwargs})
        self.view = next((view for key, view in VIEWS.items() if key in task), None)
        policy = policies.find(policy_name)(self._environment, np.random.default_rng(0))
        self._states: list[NDArray[np.float64]] = []
        #: Sentence of the task.
        self.instruction = ""
        control_timestep = self._environment.control_timestep()
        steps_per_frame = round(1 / (frames_per_second * control_timestep))
        left = round(AFTER_SUCCESS / control_timestep)
        for step, _ in enumerate(timesteps(self._environment, policy)):
            if step % steps_per_frame == 0:
                self._states.append(self._environment.physics.get_state())
                self.instruction = self._environment.task.instruction
            left -= bool(self._environment.task.episode_metrics["success"])
            if not left:
                break

    def __len__(self) -> int:
        return len(self._states)

    def __getitem__(self, frame: int) -> Frame:
        """Renders a frame `(HEIGHT, WIDTH, 3)`."""
        return self.render(frame, HEIGHT, WIDTH, self.view)

    def render(self, frame: int, height: int, width: int, view: View | None = None) -> Frame:
        """Renders a frame `(height, width, 3)`; without a view, from the camera `overview`."""
        physics = self._environment.physics
        with physics.reset_context():
            physics.set_state(self._states[frame])
        size = SMOOTHING * height, SMOOTHING * width
        if view:
            camera = MovableCamera(physics, *size)
            camera.set_pose(*view)
            picture = camera.render()
        else:
            picture = physics.render(*size, camera_id="overview")
        return reduced(picture)


def write_strips() -> None:
    """Writes a picture of the expert for each task."""
    for domain, task in [*SINGLE_TASKS, *SETS]:
        write_strip(f"expert_{task}", Film(domain, task))


def write_further_strips() -> None:
    """Writes a picture of the expert for each of the kitchen's tasks beyond the reference's."""
    for domain, task in FURTHER_TASKS:
        write_strip(f"expert_{task}", Film(domain, task))


def write_trained_strips() -> None:
    """Writes a picture of each policy that comes with the package."""
    for name, reward in (("top_drawer", "original"), ("top_drawer_grasp", "grasp")):
        write_strip(f"trained_{name}", Film("open_cabinet", "top_drawer", "trained", reward=reward))


def write_strip(name: str, film: Film) -> None:
    """Writes frames evenly spread over a film, row by row."""
    frames = [film[i] for i in np.linspace(0, len(film) - 1, FRAMES).round().astype(int)]
    rows = [np.hstack(frames[start : start + COLUMNS]) for start in range(0, FRAMES, COLUMNS)]
    Image.fromarray(np.vstack(rows)).save(PICTURES / f"{name}.jpg", quality=88, optimize=True)
    print(f"{name}: {len(film)} frames")


def write_readme_film() -> None:
    """Films the expert while it opens a drawer and puts a can into it, at four times the speed."""
    film = Film(**FILM_EPISODE, frames_per_second=FILM_FRAMES_PER_SECOND / FILM_SPEED)
    frames = tqdm(range(len(film)), unit="frame", disable=None)
    pictures = [Image.fromarray(film.render(i, FILM_HEIGHT, FILM_WIDTH, film.view)) for i in frames]
    for picture in pictures:
        text = {"xy": (12, FILM_HEIGHT - 30), "text": film.instruction, "font_size": 18}
        ImageDraw.Draw(picture).text(**text, fill="white", stroke_width=2, stroke_fill=(60, 60, 60))
    durations = [1000 // FILM_FRAMES_PER_SECOND] * len(pictures)
    durations[-1] = HOLD
    first, *others = pictures
    path = PICTURES / "film.webp"
    options = {"duration": durations, "loop": 0, "quality": FILM_QUALITY, "method": 6}
    first.save(path, save_all=True, append_images=others, **options)
    print(f"{path.name}: {len(pictures)} frames, {path.stat().st_size / 1e6:.1f} MB")


def write_mug_film() -> None:
    """Films the mug of the page on a task of one's own while it is held, put down and let go, at twice the speed."""
    domain = runpy.run_path(str(PICTURES.parent / "examples" / "mug.py"))["MUG_KITCHEN"]
    environment = domain.load(random=0, time_limit=None, control_mode=CONTROL_MODE, physics="fast")
    environment.reset()
    grasp = Grasp(environment, "mug")
    height, width = SMOOTHING * HEIGHT, SMOOTHING * WIDTH
    camera = MovableCamera(environment.physics, height, width)
    camera.set_pose(*MUG_VIEW)
    pictures = []
    for action in grasp.actions():
        environment.step(action)
        image = Image.fromarray(reduced(camera.render()))
        ImageDraw.Draw(image).text((8, 8), grasp.phase, font_size=18, stroke_width=2, stroke_fill=(60, 60, 60))
        pictures.append(image)
    print(grasp.result())
    first, *others = pictures
    duration = round(1000 * environment.control_timestep() / 2)
    path = PICTURES / "mug.webp"
    first.save(path, save_all=True, append_images=others, duration=duration, loop=0, quality=FILM_QUALITY, method=4)
    print(f"{path.name}: {len(pictures)} frames, {path.stat().st_size / 1e6:.1f} MB")


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
    made = {
        "strips": write_strips,
        "further": write_further_strips,
        "trained": write_trained_strips,
        "readme": write_readme_film,
        "mug": write_mug_film,
        "video": write_video,
    }
    run_named(__doc__, made)
