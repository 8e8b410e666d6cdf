"""Attributes of single environments, read from a vector of them as from Gymnasium's own vectors."""

from typing import Any

from gymnasium import spaces

from kitchen_suite import checks
from kitchen_suite.gymnasium_env.base import SuiteEnv

# Attributes of the single environment that are the same throughout an episode. LeRobot reads `_max_episode_steps`,
# `task` and `task_description`.
SHARED_ATTRIBUTES = (
    "action_space",
    "instruction",
    "instructions",
    "max_episode_steps",
    "metadata",
    "observation_space",
    "render_mode",
    "_max_episode_steps",
    "variation_space",
    "variation_split",
    "task",
    "task_description",
)


class SharedAttributes:
    """A vector of environments with the attributes that these share."""

    num_envs: int
    _template_env: SuiteEnv

    @property
    def instruction(self) -> tuple[str, ...]:
        """The sentence of each environment's task."""
        return self._each("instruction")

    @property
    def variation_space(self) -> spaces.Dict:
        """Ranges of the parameters that vary in a single environment, by name; empty if nothing varies."""
        return self._template_env.variation_space

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Returns an attribute of every single environment, as Gymnasium's own vectors do.

        Raises:
          AttributeError: the attribute is none of `SHARED_ATTRIBUTES`.
          TypeError: the name is no string.
        """
        try:
            checks.choice(name, SHARED_ATTRIBUTES, "attribute")
        except ValueError as error:
            # As Gymnasium's vectors do, so that callers can ask whether an attribute exists.
            raise AttributeError(str(error)) from error
        return self._each(name)

    def _each(self, name: str) -> tuple[Any, ...]:
        """Returns one of `SHARED_ATTRIBUTES` of every single environment."""
        return (getattr(self._template_env, name),) * self.num_envs

    def call(self, name: str) -> tuple[Any, ...]:
        """Returns the same as `get_attr`: LeRobot calls attributes. Methods cannot be called."""
        return self.get_attr(name)
