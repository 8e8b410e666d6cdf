"""Web pages of episodes, recorded while these are played; needs the extra `web`."""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import viser
from dm_control import mjcf

from kitchen_suite import files
from kitchen_suite.environment import Environment
from kitchen_suite.episodes.episode import EpisodeBuffer, Watch
from kitchen_suite.episodes.report import print_line
from kitchen_suite.rendering.cameras import find_camera
from kitchen_suite.viewer.scene import Scene
from kitchen_suite.viewer.servers import silent_server
from kitchen_suite.viewer.web_page import WebPage

_END = 1.0  # Time that the end of an episode is shown before the player begins again [s].


class SceneRecorder(contextlib.ExitStack):
    """Records the scenes of episodes, also of models that change from episode to episode; a context manager."""

    def __init__(self) -> None:
        super().__init__()
        self._scene: Scene | None = None
        self._server: viser.ViserServer | None = None
        self._recording: viser.infra.StateSerializer | None = None

    def start(self, physics: mjcf.Physics, camera: int) -> None:
        """Begins an episode with its first frame, seen through the camera of an id at first."""
        if self._server is None or self._scene is None or not self._scene.shows(physics):
            self.close()
            self._server = self.enter_context(silent_server())
            self._scene = Scene(self._server, physics, camera)
        self._scene.update(physics)
        self._recording = self._server.get_scene_serializer()

    def add_frame(self, physics: mjcf.Physics, seconds: float) -> None:
        """Adds a frame, a number of seconds after the one before."""
        assert self._scene
        assert self._recording
        self._recording.insert_sleep(seconds)
        self._scene.update(physics)

    def finish(self, seconds: float) -> bytes:
        """Ends the episode; returns its recording, in which the last frame is shown for a number of seconds."""
        assert self._recording
        self._recording.insert_sleep(seconds)
        return self._recording.serialize()


class EpisodePage:
    """A web page of the first episodes that are played, in any environments."""

    def __init__(self, path: Path, *, camera: str, num_episodes: int | None = None) -> None:
        """Prepares a page, seen through a camera at first; without a number of episodes it has all of them."""
        self._path = path
        self._camera = camera
        self._num_episodes = num_episodes
        self._page = WebPage()
        self._about: dict[str, Any] = {}

    @contextlib.contextmanager
    def open(self) -> Iterator[Watch]:
        """Yields a function that adds the current step; in the end the page is written.

        An exception, such as an interrupt, ends the page early: the steps until then are kept.
        """
        is_complete = False
        with SceneRecorder() as recorder:
            try:
                yield lambda buffer, environment: self._add(recorder, buffer, environment)
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
        print_line(f"web page {self._path}{end}")

    def _add(self, recorder: SceneRecorder, buffer: EpisodeBuffer, environment: Environment) -> None:
        """Adds a step: its frame, reward and return, tasks with the control steps of their completion, measures."""
        physics, timestep = environment.physics, environment.control_timestep()
        if buffer.steps == 0:
            self._end_episode(recorder)
            if self._num_episodes is None or len(self._page) < self._num_episodes:
                recorder.start(physics, find_camera(physics, self._camera))
                name, instruction = buffer.name or f"episode {len(self._page)}", environment.task.instruction
                self._about = {"name": name, "instruction": instruction, "timestep": timestep}
                self._about |= {"rewards": [], "returns": [], "tasks": [], "metrics": {}}
        elif self._about:
            recorder.add_frame(physics, timestep)
        if about := self._about:
            task = environment.task
            about["returns"].append(buffer.reward + (about["returns"] or [0.0])[-1])
            about["rewards"].append(buffer.reward)
            if completions := task.episode_completions:
                about["tasks"] = [*completions.steps_by_task.items()]
            for name, value in task.episode_metrics.items():
                if not isinstance(value, dict):
                    about["metrics"].setdefault(name, []).append(value)
            if buffer.has_ended:
                self._end_episode(recorder)

    def _end_episode(self, recorder: SceneRecorder) -> None:
        about, self._about = self._about, {}
        if about:
            self._page.add(recorder.finish(_END), about)
