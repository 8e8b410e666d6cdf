"""The domain `microwave_table`: the door of a microwave on a table is to be opened."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from kitchen_suite.domains.base import CONTROL_OPTIONS, Domain, build_environment, check_task_options, checked_visuals

if TYPE_CHECKING:
    from kitchen_suite.environment import Environment


def microwave_table(
    *,
    time_limit: float | None = 5.0,
    random: int | np.random.RandomState | None = None,
    visuals: bool = True,
    render_quality: str = "high",
    environment_kwargs: Mapping[str, Any] | None = None,
    **task_options: Any,
) -> "Environment":
    """Builds an environment of a Franka before a microwave on a table.

    Args:
      time_limit: length of an episode [s]; `None` for no limit.
      random: seed, or random state to draw from.
      visuals: `False` omits geoms and textures that only rendering needs; trajectories are the same to the bit.
      render_quality: `high`, or `fast`: images without shadows, reflections, sky and multisampling, and with fewer
        faces; see `rendering.quality.set_render_quality`.
      environment_kwargs: further arguments of `Environment`.
      **task_options: further arguments of `MicrowaveTableTask`, among them the observables that `SuiteTask` adds.

    Raises:
      TypeError: an argument of the wrong type, or an unknown one.
      ValueError: see `MicrowaveTableTask`; or the time limit is not positive and finite.
    """
    from kitchen_suite.entities.scenes import build_microwave_table_scene
    from kitchen_suite.tasks.microwave_table.task import CONTROL_MODES, MicrowaveTableTask

    check_task_options(task_options, microwave_table, MicrowaveTableTask, CONTROL_MODES)
    scene = build_microwave_table_scene(visuals=checked_visuals(visuals, task_options))
    return build_environment(
        MicrowaveTableTask(scene, **task_options),
        time_limit=time_limit,
        random=random,
        render_quality=render_quality,
        environment_kwargs=environment_kwargs,
    )


MICROWAVE_TABLE = Domain(
    name="microwave_table",
    build=microwave_table,
    tasks=MappingProxyType({"open": {}}),
    env_id="KitchenSuite/FrankaMicrowaveTable-v1",
    env="kitchen_suite.gymnasium_env.cabinets:FrankaMicrowaveTableEnv",
    vector_env="kitchen_suite.vector_env.cabinets:FrankaMicrowaveTableVectorEnv",
    episode_steps=500,
    state_options=("gripper", *CONTROL_OPTIONS),
    cloning_options=("gripper", *CONTROL_OPTIONS),
)
