"""Shows episodes live in a browser on this machine. Needs no display, and no GL library.

  kitchen-view                                             the kitchen with random actions, at http://127.0.0.1:8080
  kitchen-view --policy=expert --task_name=kettle          the scripted expert moves the kettle
  kitchen-view --domain_name=open_cabinet --policy=trained
  kitchen-view --variations=layout,appearance --port=9000  every episode in another kitchen, at another port

In the page, choose domain, task, policy, variations and seed; reset, pause, step and set the speed. Other machines are
refused; from one, use ssh -L 8080:localhost:8080 HOST. Exit status: 1 if the port is in use; 2 for a bad argument, with
one line on stderr; 130 after Ctrl-C, which ends the viewer.
"""

import sys

from kitchen_suite.bridges.viewer_settings import ViewSettings
from kitchen_suite.cli.command import Command

COMMAND = Command(
    name="kitchen-view",
    description=__doc__,
    settings=ViewSettings,
    job="kitchen_suite.bridges.viewer:ViewJob",
    renders=lambda settings: str(settings.task_kwargs.get("obs_type")).startswith("pixels"),
    needs=(("viser", "mjviser"), "web"),
)
main, console_main = COMMAND.main, COMMAND.console_main

if __name__ == "__main__":
    sys.exit(console_main())
