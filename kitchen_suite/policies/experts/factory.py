"""Builds the expert for a task, and wraps it as a policy of dm_env time steps."""

import pkgutil
from collections.abc import Callable
from typing import Any

import dm_env
import numpy as np
from dm_control import composer
from numpy.typing import NDArray

from kitchen_suite import suite
from kitchen_suite.policies.experts.base import Expert


def make(task: composer.Task, **options: Any) -> Expert:
    """Builds the expert for a task from the task's settings; it never reads the physics.

    Args:
      task: of an environment of the suite.
      **options: arguments of the expert's class, such as `style`; they replace those of the task.

    Raises:
      TypeError: an argument is unknown or of the wrong type.
      ValueError: there is no expert for this kind of task, or an option has a value that the expert rejects.
    """
    return expert_class(task).for_task(task, **options)


def expert_class(task: composer.Task) -> type[Expert]:
    """Returns the class of the expert for a task: that of its domain.

    Raises:
      ValueError: there is no expert for this kind of task.
    """
    entry_points = {domain.name: domain.expert for domain in suite.DOMAINS.values() if domain.expert}
    name = getattr(task, "domain_name", None)
    if name not in entry_points:
        names = ", ".join(entry_points)
        raise ValueError(f"there is no expert for {type(task).__name__}; the domains with one are {names}")
    expert: type[Expert] = pkgutil.resolve_name(entry_points[name])
    return expert


def make_policy(
    environment: composer.Environment, generator: np.random.Generator, **options: Any
) -> Callable[[dm_env.TimeStep], NDArray[np.float32]]:
    """Builds a policy that maps time steps to the expert's actions, and resets the expert at each first time step.

    Args:
      environment: of the suite.
      generator: source of jitter and action noise.
      **options: see `make`.
    """
    expert = make(environment.task, **options)

    def policy(timestep: dm_env.TimeStep) -> NDArray[np.float32]:
        if timestep.first():
            expert.reset(generator)
        return expert.act(expert.observed(timestep))

    return policy
