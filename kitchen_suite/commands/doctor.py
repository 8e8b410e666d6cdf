"""The command `kitchen-doctor`."""

from absl.flags import FlagValues

from kitchen_suite.commands.command import FAILURE, Command

DESCRIPTION = """Says what is installed and what works here: the text to paste into an issue. Needs no display.

  kitchen-doctor

The last lines have digests of episodes of each domain. Where they are known for the installed versions and this kind
of processor, they are compared. Exit status: 0, whatever is missing; 1 where a digest differs; 2 for a bad argument,
with one line on stderr; 130 if interrupted.
"""


def define(values: FlagValues) -> None:
    """Defines no flags."""


def run(given: FlagValues) -> int | None:
    """Prints a fact a line."""
    from kitchen_suite import doctor
    from kitchen_suite.episodes.report import print_line

    return None if doctor.examine(print_line) else FAILURE


COMMAND = Command(name="kitchen-doctor", description=DESCRIPTION, define=define, run=run)
main = COMMAND.main
