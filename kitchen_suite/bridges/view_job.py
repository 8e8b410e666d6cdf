"""The work of `kitchen-view`."""

import dataclasses

from kitchen_suite import suite
from kitchen_suite.bridges.live_episode import LiveEpisode
from kitchen_suite.bridges.viewer import Viewer
from kitchen_suite.bridges.viewer_settings import ViewSettings
from kitchen_suite.rendering.viser_servers import HOST, local_server
from kitchen_suite.rollouts.report import print_line


class ViewJob:
    """Shows episodes in a browser until it is interrupted."""

    failures = (OSError,)
    usage_errors = ()

    def __init__(self, settings: ViewSettings) -> None:
        """Builds the first environment, so that bad settings are refused; raises what `LiveEpisode` does."""
        task_name = settings.task_name or suite.default_task(settings.domain_name)
        self._settings = dataclasses.replace(settings, task_name=task_name)
        self._episode = LiveEpisode(self._settings)

    def progress(self) -> str:
        return "while showing episodes"

    def run(self) -> bool:
        """Serves the page and plays episodes; does not return.

        Raises:
          OSError: the port is in use.
        """
        with local_server(self._settings.port, "kitchen-view") as server:
            viewer = Viewer(server, self._settings, self._episode)
            print_line(f"http://{HOST}:{self._settings.port}  (Ctrl-C ends)")
            viewer.run()
        return True
