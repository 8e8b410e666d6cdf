"""Recordings of episodes, which viser's player shows; needs the extra `web`."""

import contextlib
from typing import TYPE_CHECKING, Any

from kitchen_suite.rendering.viser_servers import silent_server
from kitchen_suite.rendering.web_scenes import WebScene

if TYPE_CHECKING:
    from dm_control import mjcf


class SceneRecorder(contextlib.ExitStack):
    """Records episodes, also of models that change from episode to episode; a context manager."""

    def __init__(self) -> None:
        super().__init__()
        self._scene: WebScene | None = None
        self._server: Any = None
        self._recording: Any = None

    def start(self, physics: "mjcf.Physics", camera: int) -> None:
        """Begins an episode with its first frame, seen through the camera of an id at first."""
        if self._scene is None or not self._scene.shows(physics):
            self.close()
            self._server = self.enter_context(silent_server())
            self._scene = WebScene(self._server, physics, camera)
        self._scene.update(physics)
        self._recording = self._server.get_scene_serializer()

    def add_frame(self, physics: "mjcf.Physics", seconds: float) -> None:
        """Adds a frame, a number of seconds after the one before."""
        assert self._scene
        self._recording.insert_sleep(seconds)
        self._scene.update(physics)

    def finish(self, seconds: float) -> bytes:
        """Ends the episode; returns its recording, in which the last frame is shown for a number of seconds."""
        self._recording.insert_sleep(seconds)
        return self._recording.serialize()
