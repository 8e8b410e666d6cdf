"""Measures speed and memory of the suite against bare MuJoCo and other implementations.

  kitchen-benchmark                                        ratios of control steps per second in the kitchen
  kitchen-benchmark --domain_name=open_cabinet --rounds=31
  kitchen-benchmark --measure=scaling --num_envs=1,8,32    by number of environments and threads, with memory
  kitchen-benchmark --measure=soak                         memory in the course of a million control steps
  kitchen-benchmark --measure=rendering                    frames per second by render quality, and what a frame costs

Machines are shared and noisy, so only ratios are comparable: in every round each case plays one episode with the same
actions, and its rate is divided by that of bare MuJoCo in the same round. The table has the median over the rounds.
Frames are compared with those of the original's renderer, or of `high` where a domain has no original; the best of
the rounds counts.
Exit status: 0; 2 for a bad argument, with one line on stderr; 130 if interrupted.
"""

import sys

from kitchen_suite.benchmarks.settings import BenchmarkSettings
from kitchen_suite.cli.command import Command

COMMAND = Command(
    name="kitchen-benchmark",
    description=__doc__,
    settings=BenchmarkSettings,
    job="kitchen_suite.benchmarks.benchmark_job:BenchmarkJob",
    renders=lambda settings: settings.measure == "rendering",
)
main, console_main = COMMAND.main, COMMAND.console_main

if __name__ == "__main__":
    sys.exit(console_main())
