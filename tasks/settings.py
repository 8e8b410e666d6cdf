"""Settings of environments of any task: those that are no arguments of its scene or its class."""

import dataclasses
from collections.abc import Mapping
from typing import Any

from kitchen_suite import checks
from kitchen_suite.physics_names import EXACT


@dataclasses.dataclass(frozen=True, kw_only=True)
class Settings:
    """Settings that scene, task and environment are built with; `Domain.load` explains them.

    Attributes:
      visuals: whether there are geoms and textures that only rendering needs.
      render_quality: `high` or `fast`; None is `fast`, without a warning where packages for light meshes are missing.
      physics: `exact` or `fast`.
      control_timestep: length of a control step [s]; the task's when None.
      quality: whether the quality of episodes is measured.
      episode_seeds: whether each episode has a seed of its own, or the distance between these seeds.
    """

    visuals: bool = True
    render_quality: str | None = "high"
    physics: str = EXACT
    control_timestep: float | None = None
    quality: bool = False
    episode_seeds: bool | int = False

    def __post_init__(self) -> None:
        """Raises a TypeError for a flag that is no bool."""
        checks.boolean(self.visuals, "visuals")
        checks.boolean(self.quality, "quality")

    def check_beside(self, arguments: Mapping[str, Any], of_environment: Mapping[str, Any]) -> None:
        """Raises a ValueError for other arguments that contradict the settings.

        Args:
          arguments: of scene and task.
          of_environment: of the environment.
        """
        if not self.visuals and arguments.get("cameras"):
            raise ValueError("visuals=False leaves out what pictures show: leave out cameras, or visuals=False")
        if self.physics != EXACT and "sleep" in arguments:
            raise ValueError(f"physics={self.physics!r} decides whether objects sleep: leave out sleep, or physics")
        if of_environment.get("n_sub_steps") is None:
            return
        if self.control_timestep is not None:
            raise ValueError("control_timestep and n_sub_steps both set the control step: leave out n_sub_steps")
        if self.quality:
            raise ValueError("quality is not measured with n_sub_steps: set control_timestep instead")
