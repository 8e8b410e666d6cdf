"""The domain `open_cabinet`: a drawer of a cabinet is to be opened."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from kitchen_suite.domains.base import CONTROL_OPTIONS, Domain, build_environment, check_task_options, checked_visuals

if TYPE_CHECKING:
    from kitchen_suite.entities import CabinetConfig
    from kitchen_suite.environment import Environment


def open_cabinet(
    *,
    drawer: str,
    time_limit: float | None = 7.0,
    random: int | np.random.RandomState | None = None,
    visuals: bool = True,
    render_quality: str = "high",
    cabinet_config: "CabinetConfig | None" = None,
    environment_kwargs: Mapping[str, Any] | None = None,
    **task_options: Any,
) -> "Environment":
    """Builds an environment of a cabinet whose drawer is to be opened.

    Args:
      drawer: `top` or `bottom`.
      time_limit: length of an episode [s]; `None` for no limit.
      random: seed, or random state to draw from.
      visuals: `False` omits geoms and textures that only rendering needs; trajectories are the same to the bit.
      render_quality: `high`, or `fast`: images without shadows, reflections, sky and multisampling, and with fewer
        faces; see `rendering.quality.set_render_quality`.
      cabinet_config: dimensions and joint resistances of the cabinet; the default cabinet when omitted.
      environment_kwargs: further arguments of `Environment`.
      **task_options: further arguments of `OpenCabinetTask`, among them the observables that `SuiteTask` adds.

    Raises:
      TypeError: an argument of the wrong type, or an unknown one.
      ValueError: see `OpenCabinetTask`; or the time limit is not positive and finite.
    """
    from kitchen_suite.entities import CabinetConfig, build_open_cabinet_scene
    from kitchen_suite.tasks import OpenCabinetTask
    from kitchen_suite.tasks.control_modes.modes import OFFSET_MODES

    check_task_options(task_options, open_cabinet, OpenCabinetTask, OFFSET_MODES)
    if not isinstance(cabinet_config, CabinetConfig | None):
        raise TypeError(f"cabinet_config must be a CabinetConfig, got {cabinet_config!r}")
    scene = build_open_cabinet_scene(cabinet_config, visuals=checked_visuals(visuals, task_options))
    return build_environment(
        OpenCabinetTask(scene, drawer=drawer, **task_options),
        time_limit=time_limit,
        random=random,
        render_quality=render_quality,
        environment_kwargs=environment_kwargs,
    )


OPEN_CABINET = Domain(
    name="open_cabinet",
    build=open_cabinet,
    tasks=MappingProxyType({f"{drawer}_drawer": {"drawer": drawer} for drawer in ("top", "bottom")}),
    env_id="KitchenSuite/FrankaOpenCabinet-v1",
    env="kitchen_suite.gymnasium_env.cabinets:FrankaOpenCabinetEnv",
    vector_env="kitchen_suite.vector_env.cabinets:FrankaOpenCabinetVectorEnv",
    episode_steps=700,
    task_id="KitchenSuite/{}-v1",
    # Averaged weights: from one update to the next, the success of the policy itself swings by several percent.
    hyperparameters=MappingProxyType({"averaging": 0.95}),
    training_settings=MappingProxyType({"eval_interval": 250_000, "target_success": 0.98}),
    state_options=("gripper", *CONTROL_OPTIONS),
    cloning_options=("gripper", *CONTROL_OPTIONS),
    expert="kitchen_suite.policies.experts.open_cabinet:DrawerExpert",
    benchmark="kitchen_suite.benchmarks.open_cabinet:OPEN_CABINET",
)
