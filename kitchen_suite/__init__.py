"""Kitchen Suite: the Franka kitchen as dm_control composer tasks.

`kitchen_suite.suite.load` builds an environment; `kitchen_suite.entities` and `kitchen_suite.tasks` are its parts.
"""

import pathlib as _pathlib

__version__ = "0.1.0"

# An installed copy contains `entities` and `tasks`. In a checkout they stand beside this folder, in which case their
# parent folder is added to where subpackages are searched for.
_parent = _pathlib.Path(__file__).resolve().parent.parent
if (_parent / "setup.cfg").is_file():
    __path__.append(str(_parent))
