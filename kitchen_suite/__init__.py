"""Kitchen Suite: the Franka kitchen as dm_control composer tasks.

`kitchen_suite.suite.load` makes an environment; `kitchen_suite.entities` and `kitchen_suite.tasks` are its parts.
"""

from pathlib import Path

__version__ = "0.1.0"

# In a checkout, `entities` and `tasks` stand beside this folder, not inside it; an installed copy has them inside.
if (_checkout := Path(__file__).resolve().parent.parent).joinpath("setup.cfg").is_file():
    __path__.append(str(_checkout))
