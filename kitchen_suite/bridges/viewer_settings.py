"""Settings of `kitchen-view`."""

import dataclasses

from kitchen_suite.rollouts.settings import TaskSettings


@dataclasses.dataclass(frozen=True, kw_only=True)
class ViewSettings(TaskSettings):
    """Settings of `kitchen-view`; each is the flag of its name."""

    domain_name: str = "kitchen"
    policy: str = "random"
    seed: int = 0
    max_episode_steps: int | None = None
    camera: str = "overview"
    render_quality: str = "fast"
    port: int = 8080
