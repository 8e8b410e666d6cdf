"""Evaluates a policy under a published protocol, with confidence intervals. Needs no display.

  kitchen-evaluate --policy=expert                             200 episodes of random 4 of the kitchen's 7 tasks
  kitchen-evaluate --policy=expert --protocol=d4rl --json=expert.json --web=expert.html
  kitchen-evaluate --policy="trained(file='policy.npz')" --task_name=all --output=evaluation
  kitchen-evaluate --policy=expert --output=evaluation --resume    continues an evaluation that was interrupted

Flags that are given replace the protocol's values, and the JSON has the final ones. The same evaluation has the same
JSON, to the byte, whatever --num_envs and --num_threads. A policy module:callable must be stateless, or be played with
--num_envs=1. Exit status: 0; 1 if writing failed; 2 for a bad argument or policy, with one line on stderr; 130 if
interrupted. Protocols:

"""

import sys
import textwrap

from kitchen_suite.cli.command import Command
from kitchen_suite.evaluation.protocols import PROTOCOLS
from kitchen_suite.evaluation.settings import EvaluateSettings


def _protocol_lines() -> str:
    """Returns a few lines of help on each protocol."""
    lines = []
    for protocol in PROTOCOLS.values():
        domains = "" if protocol.is_general else "kitchen; "
        text = f"{protocol.follows} ({domains}{protocol.num_episodes:,} episodes, seeds from {protocol.seed:,})"
        first = f"  {protocol.name:<17} "
        lines.append(textwrap.fill(text, 110, initial_indent=first, subsequent_indent=" " * 20))
    return "\n".join(lines)


COMMAND = Command(
    name="kitchen-evaluate",
    description=f"{__doc__}{_protocol_lines()}\n",
    settings=EvaluateSettings,
    job="kitchen_suite.evaluation.evaluate_job:EvaluateJob",
    renders=lambda settings: settings.observes_pictures,
)
main, console_main = COMMAND.main, COMMAND.console_main

if __name__ == "__main__":
    sys.exit(console_main())
