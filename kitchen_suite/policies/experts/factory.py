"""Experts for the suite's tasks, and as policies of dm_env environments."""

from collections.abc import Callable
from typing import Any

import dm_env
import numpy as np
from dm_control import composer
from numpy.typing import NDArray

from kitchen_suite.policies.experts.base import Expert
from kitchen_suite.policies.experts.kitchen import KitchenExpert
from kitchen_suite.policies.experts.open_cabinet import DrawerExpert
from kitchen_suite.tasks import KitchenTask, OpenCabinetTask


def make(task: composer.Task, **options: Any) -> Expert:
    """Makes the expert for a task, of whose configuration it is told, and nothing else.

    Args:
      task: of an environment of the suite.
      **options: arguments of `KitchenExpert` or `DrawerExpert` that replace those of the task, `style` among them.

    Raises:
      TypeError: an argument of the wrong type, or an unknown one.
      ValueError: there is no expert for such a task, or it refuses an option.
    """
    if isinstance(task, OpenCabinetTask):
        return DrawerExpert(**{"drawer": task.drawer, **options})
    if not isinstance(task, KitchenTask):
        raise ValueError(f"there is no expert for {type(task).__name__}; there are for KitchenTask and OpenCabinetTask")
    settings = {
        "tasks": task.mdp.goals.tasks,
        "goals": task.goals,
        "threshold": task.threshold,
        "velocity_scale": task.mdp.velocity_scale,
        "feedback": task.mdp.feedback,
    }
    return KitchenExpert(**{**settings, **options})


def make_policy(
    environment: composer.Environment, generator: np.random.Generator, **options: Any
) -> Callable[[dm_env.TimeStep], NDArray[np.float32]]:
    """Makes a policy: it takes time steps, and begins anew with each first one.

    Args:
      environment: of the suite.
      generator: what jitter and noise are drawn from.
      **options: see `make`.
    """
    expert = make(environment.task, **options)

    def policy(timestep: dm_env.TimeStep) -> NDArray[np.float32]:
        if timestep.first():
            expert.reset(generator)
        # Goals, which the kitchen shows after its state, are left out.
        observation = np.concatenate([np.ravel(part) for part in timestep.observation.values()])
        return expert.act(observation[: expert.observation_size])

    return policy
