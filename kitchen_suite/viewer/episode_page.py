"""Web pages of episodes, recorded while these are played; needs the extra `web`."""

import contextlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import viser
from dm_control import mjcf

from kitchen_suite import files
from kitchen_suite.environment import Environment
from kitchen_suite.episodes.episode import EpisodeBuffer, Watch
from kitchen_suite.rendering.cameras import find_camera
from kitchen_suite.viewer.scene import Scene, show_both, side_by_side
from kitchen_suite.viewer.servers import silent_server
from kitchen_suite.viewer.web_page import WebPage

Step = tuple[EpisodeBuffer, Environment]

_END = 1.0  # Time that the end of an episode is shown before the player begins again [s].


class SceneRecorder(contextlib.ExitStack):
    """Records the scene of an episode, or those of two next to each other; a context manager.

    Models may change from episode to episode.
    """

    def __init__(self) -> None:
        super().__init__()
        self._scenes: list[Scene] = []
        self._labels: tuple[str, str] | None = None
        self._server: viser.ViserServer | None = None
        self._recording: viser.infra.StateSerializer | None = None

    def start(self, physics: Sequence[mjcf.Physics], camera: int, labels: tuple[str, str] | None = None) -> None:
        """Begins an episode with its first frame, seen through the camera of an id at first; two have labels."""
        if not self._shows(physics, labels):
            self.close()
            self._server = server = self.enter_context(silent_server())
            if labels is None:
                self._scenes = [Scene(server, each, camera) for each in physics]
            else:
                first, second = physics
                places = side_by_side(first, second, camera, labels)
                self._scenes = [Scene(server, *each) for each in zip(physics, (camera, camera), places, strict=True)]
                show_both(server, first, camera, places)
            self._labels = labels
        assert self._server
        self._update(physics)
        self._recording = self._server.get_scene_serializer()

    def add_frame(self, physics: Sequence[mjcf.Physics], seconds: float) -> None:
        """Adds a frame, a number of seconds after the one before."""
        assert self._recording
        self._recording.insert_sleep(seconds)
        self._update(physics)

    def finish(self, seconds: float) -> bytes:
        """Ends the episode; returns its recording, in which the last frame is shown for a number of seconds."""
        assert self._recording
        self._recording.insert_sleep(seconds)
        return self._recording.serialize()

    def _update(self, physics: Sequence[mjcf.Physics]) -> None:
        for scene, each in zip(self._scenes, physics, strict=True):
            scene.update(each)

    def _shows(self, physics: Sequence[mjcf.Physics], labels: tuple[str, str] | None) -> bool:
        if labels != self._labels or len(physics) != len(self._scenes):
            return False
        return all(scene.shows(each) for scene, each in zip(self._scenes, physics, strict=True))


class EpisodePage:
    """A web page of the first episodes that are played, in any environments."""

    def __init__(
        self,
        path: Path,
        *,
        camera: str,
        num_episodes: int | None = None,
        report: Callable[[str], object] = lambda text: None,
    ) -> None:
        """Prepares a page, seen through a camera at first; without a number of episodes it has all of them.

        `report` is called with a line about the file, when it is written.
        """
        self._path = path
        self._report = report
        self._camera = camera
        self._num_episodes = num_episodes
        self._page = WebPage()
        self._about: dict[str, Any] = {}

    @contextlib.contextmanager
    def open(self) -> Iterator[Watch]:
        """Yields a function that adds the current step; in the end the page is written.

        An exception, such as an interrupt, ends the page early: the steps until then are kept.
        """
        with self._recorder() as recorder:

            def watch(buffer: EpisodeBuffer, environment: Environment) -> None:
                self._add(recorder, [(buffer, environment)], buffer.name)
                if buffer.has_ended:
                    self._end_episode(recorder)

            yield watch

    @contextlib.contextmanager
    def open_side_by_side(self, labels: tuple[str, str]) -> Iterator[Callable[[str, Iterable[Sequence[Step]]], None]]:
        """Yields a function that adds an episode of a name, which two policies play, from the steps of both.

        An episode that has ended stands still until the other one has, with the last of its steps. The page is written
        as in `open`.
        """
        with self._recorder() as recorder:

            def add(name: str, steps: Iterable[Sequence[Step]]) -> None:
                for both in steps:
                    self._add(recorder, both, name, labels)
                self._end_episode(recorder)

            yield add

    @contextlib.contextmanager
    def _recorder(self) -> Iterator[SceneRecorder]:
        """Yields what records the episodes; in the end the page is written."""
        is_complete = False
        with SceneRecorder() as recorder:
            try:
                yield recorder
                is_complete = True
            finally:
                self._end_episode(recorder)
                if self._page:
                    self._write(is_complete)

    def _write(self, is_complete: bool) -> None:
        with files.atomic_write(self._path) as partial:
            partial.write_text(self._page.html(self._path.stem), encoding="utf-8")
        size = self._path.stat().st_size / 1e6
        end = f", {size:.1f} MB" if is_complete else f" ends early, in episode {len(self._page)}"
        self._report(f"web page {self._path}{end}")

    def _add(
        self, recorder: SceneRecorder, steps: Sequence[Step], name: str, labels: tuple[str, str] | None = None
    ) -> None:
        """Adds a step of an episode, or of two at once: its frame, and its numbers unless it has been added before."""
        physics = [environment.physics for _, environment in steps]
        _, environment = steps[0]
        timestep = environment.control_timestep()
        if all(buffer.steps == 0 for buffer, _ in steps):
            self._end_episode(recorder)
            if self._num_episodes is None or len(self._page) < self._num_episodes:
                recorder.start(physics, find_camera(physics[0], self._camera), labels)
                parts = [_new_part(label) for label in labels or ("",)]
                name = name or f"episode {len(self._page)}"
                instruction = environment.task.instruction
                self._about = {"name": name, "instruction": instruction, "timestep": timestep, "parts": parts}
        elif self._about:
            recorder.add_frame(physics, timestep)
        if self._about:
            for part, (buffer, environment) in zip(self._about["parts"], steps, strict=True):
                if len(part["rewards"]) == buffer.steps:
                    _add_numbers(part, buffer, environment)

    def _end_episode(self, recorder: SceneRecorder) -> None:
        about, self._about = self._about, {}
        if about:
            self._page.add(recorder.finish(_END), about)


def _new_part(label: str) -> dict[str, Any]:
    """Returns the numbers of an episode that has not begun, as `web_page.html` reads them."""
    return {"label": label, "rewards": [], "returns": [], "tasks": [], "metrics": {}}


def _add_numbers(part: dict[str, Any], buffer: EpisodeBuffer, environment: Environment) -> None:
    """Adds the reward and return of a step, tasks with the control steps of their completion, and metrics."""
    task = environment.task
    part["returns"].append(buffer.reward + (part["returns"] or [0.0])[-1])
    part["rewards"].append(buffer.reward)
    if completions := task.episode_completions:
        part["tasks"] = [*completions.steps_by_task.items()]
    for name, value in task.episode_metrics.items():
        if not isinstance(value, dict):
            part["metrics"].setdefault(name, []).append(value)
