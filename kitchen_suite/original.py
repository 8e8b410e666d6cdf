"""Registers this suite's kitchen under the original's id: programs for `FrankaKitchen-v1` need this import alone.

    import kitchen_suite.original

    env = gymnasium.make("FrankaKitchen-v1", tasks_to_complete=["microwave", "kettle"])

Whether gymnasium_robotics is imported before or after, `FrankaKitchen-v1` is this suite's kitchen, and the other ids of
gymnasium_robotics are its own.
"""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import contextlib
import io

import gymnasium

from kitchen_suite.suite import DOMAINS

with contextlib.redirect_stderr(io.StringIO()):
    # The import registers the original's ids; a later one in the same process does nothing. It prints a notice about
    # other environments.
    import gymnasium_robotics  # noqa: F401

__all__ = ["ID"]

ID = "FrankaKitchen-v1"
"""The original's id."""

_kitchen = DOMAINS["kitchen"]

# Gymnasium warns of an id that is registered twice.
gymnasium.registry.pop(ID, None)
gymnasium.register(
    ID,
    entry_point=_kitchen.env,
    vector_entry_point=_kitchen.vector_env,
    max_episode_steps=_kitchen.episode_steps,
)
