"""Configs of the suite's environments for LeRobot; importing this module registers one type for each domain.

Needs the extra `lerobot`.
"""

import dataclasses
from typing import Any, ClassVar

from kitchen_suite import installation, suite
from kitchen_suite.closing import closed_on_error
from kitchen_suite.domains.domain import Domain
from kitchen_suite.episodes.spec import EnvironmentSpec, merged_kwargs
from kitchen_suite.lerobot.environments import LeRobotVectorEnv, features_of, make_vector_env
from kitchen_suite.lerobot.observations import OBS_TYPES

# Before its import, so that a missing one is named with what installs it.
installation.installed(("lerobot",), "kitchen_suite.lerobot", "lerobot")

from lerobot.configs import FeatureType, PolicyFeature  # noqa: E402
from lerobot.envs import EnvConfig  # noqa: E402


@dataclasses.dataclass
class SuiteEnvConfig(EnvConfig):
    """Environments of a domain; each attribute is a flag, such as `--env.task=kettle`.

    Attributes:
      task: a task of the domain, or several, separated by commas, which are evaluated one after the other.
      fps: control steps per second, rounded down; set by the environment.
      obs_type: one of `observations.OBS_TYPES`, such as `pixels_agent_pos`.
      physics: `exact` or `fast`; `exact` when None.
      control_mode: meaning of the action; the domain's own when None.
      cameras: names of the cameras whose pictures are observed; the domain's default when None.
      image_size: height and width of their pictures [pixels]; 128 x 128 when None.
      extra_observables: names of further quantities to observe.
      variations: groups of parameters that vary, separated by commas, or distributions as a JSON object.
      variation_split: `seen` or `held_out`.
      max_episode_steps: control steps after which an episode is truncated; the domain's when None.
      task_kwargs: further arguments of the domain's Gymnasium environment.
      render_mode: `rgb_array`; with None no GL library is needed, and films are black.
      num_threads: threads that step the environments; one per processor when None.
    """

    domain_name: ClassVar[str]

    fps: int = 0
    obs_type: str = OBS_TYPES[0]
    physics: str | None = None
    control_mode: str | None = None
    cameras: list[str] | None = None
    image_size: list[int] | None = None
    extra_observables: list[str] | None = None
    variations: str | None = None
    variation_split: str | None = None
    max_episode_steps: int | None = None
    task_kwargs: dict[str, Any] = dataclasses.field(default_factory=dict)
    render_mode: str | None = "rgb_array"
    num_threads: int | None = None

    def __post_init__(self) -> None:
        """Sets the features and `fps`, and checks the other attributes."""
        (features, self.fps), *others = [features_of(spec) for spec in self._specs()]
        if any(other != (features, self.fps) for other in others):
            raise ValueError(f"tasks {self.task} have different observations: evaluate them one by one")
        kinds = {feature.key: FeatureType[feature.kind] for feature in features}
        self.features = {each.key: PolicyFeature(type=kinds[each.key], shape=each.shape) for each in features}
        self.features_map = {feature.key: feature.column for feature in features}

    @property
    def gym_kwargs(self) -> dict[str, Any]:
        """Arguments of the domain's Gymnasium environment."""
        chosen = {name: getattr(self, name) for name in ("cameras", "image_size", "extra_observables")}
        given = {"obs_type": self.obs_type, **{name: value for name, value in chosen.items() if value is not None}}
        if twice := sorted(self.task_kwargs.keys() & given.keys()):
            raise ValueError(f"{', '.join(twice)} cannot be among the task_kwargs: it has a flag of its own")
        return {**self.task_kwargs, **given}

    def create_envs(self, n_envs: int, use_async_envs: bool = False) -> dict[str, dict[int, LeRobotVectorEnv]]:
        """Returns vectors of `n_envs` environments by domain and number of the task.

        Threads step them, whatever `use_async_envs`.
        """
        each: list[LeRobotVectorEnv] = []
        with closed_on_error(each):
            for spec in self._specs():
                each.append(make_vector_env(spec, n_envs, num_threads=self.num_threads, render_mode=self.render_mode))
        return {self.domain_name: dict(enumerate(each))}

    def _specs(self) -> list[EnvironmentSpec]:
        """Returns a specification of the environments of each task."""
        names = ("physics", "control_mode", "variations", "variation_split")
        kwargs = merged_kwargs(self.gym_kwargs, {name: getattr(self, name) for name in names})
        tasks = self.task.split(",") if self.task else [None]
        return [EnvironmentSpec.make(self.domain_name, task, kwargs, self.max_episode_steps) for task in tasks]


def register(domain: Domain) -> type[SuiteEnvConfig]:
    """Registers a domain with LeRobot as `--env.type` of its name; returns the class of its config."""
    if known := EnvConfig.get_known_choices().get(domain.name):
        if not issubclass(known, SuiteEnvConfig):
            raise ValueError(f"LeRobot has environments {domain.name!r} of its own: choose another name")
        return known
    name = f"{domain.name.title().replace('_', '')}EnvConfig"
    attributes = {"domain_name": domain.name, "__doc__": SuiteEnvConfig.__doc__, "__module__": __name__}
    config: type[SuiteEnvConfig] = dataclasses.dataclass(type(name, (SuiteEnvConfig,), attributes))
    globals()[name] = config  # Pickle finds classes by name.
    EnvConfig.register_subclass(domain.name)(config)
    return config


def make_env(
    n_envs: int = 1, use_async_envs: bool = False, cfg: EnvConfig | None = None
) -> dict[str, dict[int, LeRobotVectorEnv]]:
    """Makes environments as the function of that name in the `env.py` of a repository for LeRobot's EnvHub.

    Args:
      n_envs: number of environments.
      use_async_envs: ignored; threads step the environments.
      cfg: config of a domain of the suite; of another config only `task` is read, a task of the kitchen.

    Returns:
      Vectors of environments by domain and number of the task.
    """
    if isinstance(cfg, SuiteEnvConfig):
        return cfg.create_envs(n_envs, use_async_envs)
    config = register(suite.find_domain("kitchen"))
    return config(task=cfg.task if cfg else None).create_envs(n_envs, use_async_envs)


for _domain in suite.DOMAINS.values():
    register(_domain)
