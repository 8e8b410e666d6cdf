"""The command `kitchen-export`."""

from absl.flags import FlagValues

from kitchen_suite.commands import flags
from kitchen_suite.commands.command import Command

DESCRIPTION = """Writes the scene of an episode as files that `mujoco` alone loads. Needs no display.

  kitchen-export --output=scene                                    the default kitchen
  kitchen-export --output=scene --domain_name=open_cabinet --control_mode=joint_position
  kitchen-export --output=scene --variations=layout,dynamics --seed=7
  kitchen-export --output=scene --variations=dynamics --variation_values='{"kettle/mass": 1.2}'

The folder gets scene.xml with its assets, scene.mjb, state.npz (the state after the reset of --seed), scene.json
(timesteps, actuators, meaning of the action, joints, cameras, values, licences) and README.md, which shows how to step
it. scene.mjb equals the environment's model to the bit. The command prints by how much scene.xml, once compiled,
differs from it. Exit status: 0; 1 if writing failed; 2 for a bad argument, with one line on stderr; 130 if interrupted.
"""


def define(values: FlagValues) -> None:
    """Defines the flags."""
    flags.output(values, required=True)
    flags.seed(values)
    drawn = "Values of parameters that vary, in place of drawn ones, such as '{\"kettle/mass\": 1}'."
    flags.json_object(values, "variation_values", drawn)
    flags.task(values)


def run(given: FlagValues) -> None:
    """Writes the scene; prints the folder, and the difference of the XML."""
    from kitchen_suite.adapters.mjcf import BINARY_FILE, XML_FILE, export
    from kitchen_suite.episodes.report import print_line
    from kitchen_suite.episodes.spec import EnvironmentSpec

    spec = EnvironmentSpec.make(given.domain_name, given.task_name, flags.environment_kwargs(given))
    flags.prepare_images(spec)
    differences = export(given.output, spec, seed=given.seed, variation_values=given.variation_values)
    print_line(f"{spec.domain_name} {spec.task_name}, seed {given.seed}, in {given.output}")
    print_line(f"{BINARY_FILE}: the environment's model, to the bit")
    for name, difference in differences.items():
        print_line(f"{XML_FILE}: {name.removeprefix('xml_').replace('_', ' ')}: {difference}")


COMMAND = Command(name="kitchen-export", description=DESCRIPTION, define=define, run=run)
main = COMMAND.main
