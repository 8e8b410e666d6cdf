"""`python -m kitchen_suite` is the command `kitchen-suite`."""

import sys

from kitchen_suite.commands.commands import console_main

if __name__ == "__main__":
    sys.exit(console_main())
