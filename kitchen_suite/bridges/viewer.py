"""The live viewer: episodes in a browser; needs the extra `web`."""

import queue
import time
from typing import Any

from kitchen_suite.bridges.live_episode import LiveEpisode
from kitchen_suite.bridges.viewer_panel import ViewerPanel
from kitchen_suite.bridges.viewer_settings import ViewSettings
from kitchen_suite.rendering.cameras import camera_names, find_camera
from kitchen_suite.rendering.web_scenes import WebScene, set_camera

# Time between two looks at the panel [s].
_IDLE = 0.05

# Errors of a choice in the panel, of the policy, or of physics that diverges (a RuntimeError); they are shown there.
_ERRORS = (ImportError, OSError, RuntimeError, TypeError, ValueError)


class Viewer:
    """Plays an episode in real time, and does what is chosen in the panel."""

    def __init__(self, server: Any, settings: ViewSettings, episode: LiveEpisode) -> None:
        """Shows an episode.

        Args:
          server: of viser.
          settings: of the episode.
          episode: that is shown first.
        """
        self._server, self._episode = server, episode
        self._panel = ViewerPanel(server.gui, settings)
        self._problem = ""
        self._due = time.monotonic()
        self._scene = self._show_scene()

    def run(self) -> None:
        """Plays episodes until an exception is raised, such as an interrupt."""
        while True:
            self.turn()

    def turn(self) -> None:
        """Makes the control step that is due, if there is one, and obeys the panel until the next one is."""
        panel, now = self._panel, time.monotonic()
        if not panel.is_paused and not self._problem and now >= self._due:
            self._step()
            # Where steps take longer than they should, time passes more slowly.
            self._due = max(self._due + self._episode.timestep / panel.speed, now)
        wait = _IDLE if panel.is_paused or self._problem else min(_IDLE, max(self._due - time.monotonic(), 0.0))
        try:
            command = panel.commands.get(timeout=wait) if wait else panel.commands.get_nowait()
        except queue.Empty:
            return
        self._obey(command)

    @property
    def episode(self) -> LiveEpisode:
        """The episode that is shown."""
        return self._episode

    def _obey(self, command: str) -> None:
        if command == "step":
            self._step()
        elif command == "camera":
            self._look()
        else:
            self._try(self._load if command == "load" else self._reset)
        self._due = time.monotonic()

    def _step(self) -> None:
        if not self._episode.has_ended:
            self._try(self._episode.step)
        elif self._panel.continues:
            self._panel.seed = self._episode.seed + 1
            self._try(self._reset)

    def _load(self) -> None:
        self._panel.show("Loading.")
        episode = LiveEpisode(self._panel.settings())
        self._episode.close()
        self._episode = episode
        self._scene = self._show_scene()

    def _reset(self) -> None:
        self._episode.start(self._panel.seed)
        if not self._scene.shows(self._episode.physics):
            self._scene = self._show_scene()

    def _try(self, action: Any) -> None:
        """Calls a function, and shows the state after it, or its error; time then stands still until a reset."""
        try:
            action()
            self._problem = ""
        except _ERRORS as error:
            self._problem = " ".join(str(error).split())
        self._scene.update(self._episode.physics)
        self._panel.show(f"**Error:** {self._problem}" if self._problem else self._episode.report())

    def _show_scene(self) -> WebScene:
        """Replaces the scene by that of the episode's model."""
        physics, server = self._episode.physics, self._server
        server.scene.reset()
        server.scene.set_up_direction("+z")
        self._panel.offer_cameras(camera_names(physics))
        scene = WebScene(server, physics, find_camera(physics, self._panel.camera))
        scene.update(physics)
        self._panel.show(self._episode.report())
        self._look()
        return scene

    def _look(self) -> None:
        """Lets all browsers look through the camera that is chosen."""
        physics, view = self._episode.physics, self._server.initial_camera
        set_camera(self._server, physics, find_camera(physics, self._panel.camera))
        for client in self._server.get_clients().values():
            with client.atomic():
                client.camera.position, client.camera.look_at = view.position, view.look_at
                client.camera.fov = view.fov
