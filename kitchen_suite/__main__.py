"""`python -m kitchen_suite` is the command `kitchen-suite`."""

import sys

from kitchen_suite.commands import console

if __name__ == "__main__":
    sys.exit(console())
