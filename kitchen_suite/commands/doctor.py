"""The command `kitchen-doctor`."""

from absl import flags
from absl.flags import FlagValues

from kitchen_suite.commands.command import FAILURE, Command

DESCRIPTION = """Says what is installed and what works here: the text to paste into an issue. Needs no display.

  kitchen-doctor
  kitchen-doctor --domain_name=mug:MUG_KITCHEN

The last lines have digests of episodes of each domain. Where they are known for the installed versions and this kind
of processor, they are compared.

With a domain, a hand grasps each of its free objects that has a grasp site, lifts it, holds it for ten seconds and
lets it go, in each physics of the domain. Where that fails, the line says what to change.

Exit status: 0, whatever is missing; 1 where a digest differs or an object is not held; 2 for a bad argument, with one
line on stderr; 130 if interrupted.
"""


def define(values: FlagValues) -> None:
    """Defines the flag of a domain to be examined."""
    flags.DEFINE_string("domain_name", None, "Domain whose objects are grasped, such as module:NAME.", values)


def run(given: FlagValues) -> int | None:
    """Prints a fact a line."""
    from kitchen_suite import doctor
    from kitchen_suite.episodes.report import print_line

    if given.domain_name is None:
        return None if doctor.examine(print_line) else FAILURE
    return None if doctor.examine_objects(given.domain_name, print_line) else FAILURE


COMMAND = Command(name="kitchen-doctor", description=DESCRIPTION, define=define, run=run)
main = COMMAND.main
