"""Writes the scene of an episode as files that `mujoco` alone loads. Needs no display.

  kitchen-export --output=scene                                    the default kitchen
  kitchen-export --output=scene --domain_name=open_cabinet --control_mode=joint_position
  kitchen-export --output=scene --variations=layout,dynamics --seed=7
  kitchen-export --output=scene --variations=dynamics --variation_values='{"kettle/mass": 1.2}'

The folder gets scene.xml with its assets, scene.mjb, state.npz (the state after the reset of --seed), scene.json
(timesteps, actuators, meaning of the action, joints, cameras, values, licences) and README.md, which shows how to step
it. scene.mjb equals the environment's model to the bit. The command prints by how much scene.xml, once compiled,
differs from it. Exit status: 0; 1 if writing failed; 2 for a bad argument, with one line on stderr; 130 if interrupted.
"""

import sys

from kitchen_suite.bridges.export_settings import ExportSettings
from kitchen_suite.cli.command import Command

COMMAND = Command(
    name="kitchen-export",
    description=__doc__,
    settings=ExportSettings,
    job="kitchen_suite.bridges.export:ExportJob",
    renders=lambda settings: settings.observes_pictures,
)
main, console_main = COMMAND.main, COMMAND.console_main

if __name__ == "__main__":
    sys.exit(console_main())
