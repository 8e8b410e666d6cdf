"""Specifications: of environments, and of episodes in them that can be played again anywhere, at any time."""

import contextlib
import dataclasses
import json
import math
import warnings
from collections.abc import Collection, Mapping
from typing import Any, cast

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode

from kitchen_suite import checks, files, policies, signatures, suite
from kitchen_suite.domains.domain import Domain
from kitchen_suite.entities.arms import model_digest
from kitchen_suite.environment.random_states import legacy_generator
from kitchen_suite.gymnasium_env.base import SuiteEnv, suite_env
from kitchen_suite.gymnasium_env.observations import has_pictures
from kitchen_suite.physics_names import EXACT
from kitchen_suite.policies import PolicyRef
from kitchen_suite.tasks.task import SuiteTask
from kitchen_suite.tasks.variations.distributions import NONE, unified
from kitchen_suite.vector_env.base import SuiteVectorEnv
from kitchen_suite.versions import installed_versions

# Arguments of the environments that the commands set themselves.
_RESERVED = {"info_format", "max_episode_steps", "random", "render_mode", "time_limit", "visuals"}
_RESERVED |= {"autoreset_mode", "instructions", "num_envs", "num_threads"}

# How a seed starts the random stream of an episode: as `reset(seed=...)` of a Gymnasium environment does, or as the
# RandomState that `suite.load` makes of `random`. Recordings use the former, with float32 actions; rollouts the latter,
# with float64 actions.
SEEDINGS = ("gymnasium", "dm_control")


@dataclasses.dataclass(frozen=True, kw_only=True)
class EnvironmentSpec:
    """How Gymnasium environments of a task are made, with further arguments `task_kwargs`, which JSON can hold.

    An episode is truncated after `max_episode_steps` control steps.
    """

    domain_name: str
    task_name: str
    task_kwargs: Mapping[str, Any]
    max_episode_steps: int

    @staticmethod
    def make(
        domain_name: str,
        task_name: str | None,
        task_kwargs: Mapping[str, Any] | None,
        max_episode_steps: int | None = None,
    ) -> "EnvironmentSpec":
        """Makes a specification of checked arguments; None stands for the domain's default.

        Arguments that name a file are replaced by the file's contents, NumPy's numbers and arrays by those of Python.

        Raises:
          OSError: a file that an argument names cannot be read.
          TypeError: an argument has another type, or one that JSON cannot hold.
          ValueError: an argument is not valid, or there is no such domain or task.
        """
        task_kwargs = checks.arguments(task_kwargs, "task_kwargs")
        task_name = suite.default_task(domain_name) if task_name is None else task_name
        if max_episode_steps is not None:
            checks.integer(max_episode_steps, "max_episode_steps", minimum=1)
        suite.check_not_fixed(domain_name, task_name, task_kwargs)
        _check_not_reserved(task_kwargs)
        domain = suite.find_domain(domain_name)
        env_class = domain.env_class
        # Before Gymnasium does, which takes some names itself, such as `disable_env_checker`.
        env_class.check_keywords(domain, task_kwargs, exclude=_RESERVED)
        contents = domain.with_contents(task_kwargs)
        task_kwargs = {name: files.json_value(value, name) for name, value in contents.items()}
        obs_type = env_class.find_obs_type(task_kwargs.get("obs_type"))
        # The quality of observed pictures must not depend on that of a video.
        quality = {"render_quality": "high"} if has_pictures(obs_type) else {}
        return EnvironmentSpec(
            domain_name=domain_name,
            task_name=task_name,
            task_kwargs={**quality, **task_kwargs},
            max_episode_steps=domain.episode_steps if max_episode_steps is None else int(max_episode_steps),
        )

    def episodes(self, policy: PolicyRef, *, seed: int, seeding: str = "gymnasium") -> "EpisodeSpec":
        """Returns the specification of episodes that a policy plays in such environments, with the versions here.

        Args:
          policy: which policy acts.
          seed: of the first episode; later episodes have the next ones.
          seeding: one of `SEEDINGS`.

        Raises:
          ImportError: the policy needs an extra that is not installed.
          OSError: the file that names the policy cannot be read.
          ValueError: the policy cannot be imported.
        """
        policy.builder()
        checks.choice(seeding, SEEDINGS, "seeding")
        digest = None
        if path := policy.file():
            with files.reading(path, "a trained policy"):
                digest = files.file_digest(path)
        # Of the environments alone, where this is the specification of other episodes.
        own = {field.name: getattr(self, field.name) for field in dataclasses.fields(EnvironmentSpec)}
        return EpisodeSpec(
            **own,
            policy=policy.text,
            seed=checks.integer(seed, "seed", minimum=0),
            seeding=seeding,
            versions=self.current_versions,
            policy_sha256=digest,
        )

    def as_json(self) -> dict[str, Any]:
        return json.loads(json.dumps(dataclasses.asdict(self)))

    @property
    def current_versions(self) -> dict[str, str]:
        """Versions of the packages here, and the digest of the model of a user's arm."""
        robot = self.task_kwargs.get("robot")
        if not isinstance(robot, str) or ":" not in robot:
            return installed_versions()
        return {**installed_versions(), f"robot {robot}": model_digest(robot)}

    @property
    def env_class(self) -> type[SuiteEnv]:
        return cast(type[SuiteEnv], suite.find_domain(self.domain_name).env_class)

    def argument(self, name: str) -> Any:
        """Returns the value of an argument that applies, as JSON represents it: the default where it is omitted.

        None stands for what only the environments know, such as the domain's control step, and for no variations.
        """
        domain = suite.find_domain(self.domain_name)
        arguments = {**suite.task_arguments(self.domain_name, self.task_name), **self.task_kwargs}
        value = arguments[name] if name in arguments else self.env_class.default_of(domain, name)
        if name == "variations":
            value = unified(value)
        elif name == "control_timestep" and value == domain.resolve("task").default_control_timestep:
            value = None
        elif value is None and name in domain.control_options:
            value = self._control_default(domain, name)
        elif value is None and name in ("physics", "obs_type"):
            value = self.env_class.default_of(domain, name)
        return json.loads(json.dumps(value))

    def _control_default(self, domain: Domain, name: str) -> Any:
        """Returns the default of an argument of the control mode, or that of the mode itself."""
        if name in ("control_mode", "control_timestep"):
            return self.env_class.default_of(domain, name)
        modes = domain.resolve("task").control_modes
        mode = checks.choice(self.argument("control_mode"), modes, "control_mode")
        return signatures.signature(modes[mode]).defaults.get(name)

    @property
    def has_other_control_mode(self) -> bool:
        """Whether actions have another meaning than by the domain's default."""
        default = self.env_class.default_of(suite.find_domain(self.domain_name), "control_mode")
        return self.argument("control_mode") != default

    @property
    def observes_images(self) -> bool:
        """Whether observations hold images, so that playing needs a GL library."""
        return has_pictures(self.env_class.find_obs_type(self.argument("obs_type")))

    @property
    def names(self) -> set[tuple[str, str]]:
        """Argument and value of each name that defines the task: its drawer, or the tasks that it may request."""
        defined = {name: self.argument(name) for name in suite.task_arguments(self.domain_name, self.task_name)}
        texts = {name: [value] if isinstance(value, str) else value for name, value in defined.items()}
        return {(name, str(each)) for name, value in texts.items() if isinstance(value, list) for each in value}

    @property
    def variations(self) -> str:
        """Description of what varies between episodes, of physics unless exact and of replaced control steps."""
        variations = self.argument("variations") or [NONE]
        names = ",".join(variations)
        split, physics = self.argument("variation_split"), self.argument("physics")
        heading = f"variations {names}" + (f" ({split})" if names != NONE else "")
        if (timestep := self.argument("control_timestep")) is not None:
            heading = f"control steps of {timestep:g} s, {heading}"
        return heading if physics == EXACT else f"{physics} physics, {heading}"

    @property
    def circumstances(self) -> str:
        """The `variations`, after the name of a generated kitchen."""
        if "design" not in suite.find_domain(self.domain_name).arguments(self.env_class):
            return self.variations
        design = self.argument("design")
        kitchen = f"kitchen {design} of {self.argument('split')}" if isinstance(design, int) else "a custom kitchen"
        return f"{kitchen}, {self.variations}"

    def make_environment(self, **extra: Any) -> gymnasium.Env:
        """Makes a single environment; `extra` are further arguments, which replace none of the specification's."""
        # A film, for example, does not replace the `render_quality` of observed pictures.
        arguments = {"max_episode_steps": self.max_episode_steps, **extra, **self._arguments}
        try:
            return gymnasium.make(suite.find_domain(self.domain_name).env_id, **arguments)
        except TypeError as error:
            # Gymnasium adds all arguments to the message.
            raise TypeError(str(error).partition(" was raised from the environment creator")[0]) from error

    def make_vector_env(
        self,
        num_envs: int,
        num_threads: int | None,
        autoreset_mode: AutoresetMode = AutoresetMode.DISABLED,
        **extra: Any,
    ) -> SuiteVectorEnv:
        """Makes vectorised environments; `extra` are further arguments, which replace the specification's."""
        environments = gymnasium.make_vec(
            suite.find_domain(self.domain_name).env_id,
            num_envs,
            vectorization_mode="vector_entry_point",
            num_threads=num_threads,
            autoreset_mode=autoreset_mode,
            max_episode_steps=self.max_episode_steps,
            **{**self._arguments, **extra},
        )
        return cast(SuiteVectorEnv, environments)

    @property
    def _arguments(self) -> dict[str, Any]:
        task = suite.task_arguments(self.domain_name, self.task_name)
        arguments = json.loads(json.dumps({**task, **self.task_kwargs}))
        return {**arguments, **self.env_class.array_options}


@dataclasses.dataclass(frozen=True, kw_only=True)
class EpisodeSpec(EnvironmentSpec):
    """The environments and the episodes of a recording, or of a condition of an evaluation.

    Episode `i` has the seed `seed + i`.

    Attributes:
      policy: name of the policy, as `policies.find` takes it.
      seeding: one of `SEEDINGS`.
      versions: by package; with another arm than the package's own also the digest of its model.
      policy_sha256: SHA-256 of the file that the policy names, if it names one: another file is another policy.
      origin: where the episodes come from, if other programs recorded them; these have no seeds.
    """

    policy: str
    seed: int
    seeding: str
    versions: Mapping[str, str]
    policy_sha256: str | None = None
    origin: Mapping[str, Any] | None = None

    @classmethod
    def from_json(cls, record: Mapping[str, Any]) -> "EpisodeSpec":
        """Returns the specification that `as_json` wrote; raises a ValueError if it is another record."""
        spec = files.parse(record, cls, "not a specification")
        if unknown := sorted(record.keys() - {field.name for field in dataclasses.fields(cls)}):
            raise ValueError(f"unknown attributes {unknown}")
        suite.check_named(spec.domain_name, spec.task_kwargs)
        suite.task_arguments(spec.domain_name, spec.task_name)
        _check_not_reserved(spec.task_kwargs)
        checks.choice(spec.seeding, SEEDINGS, "seeding")
        checks.integer(spec.seed, "seed", minimum=0)
        checks.integer(spec.max_episode_steps, "max_episode_steps", minimum=1)
        return spec

    def as_json(self) -> dict[str, Any]:
        """Returns the specification as JSON represents it, without what is None."""
        record = super().as_json()
        # The order of the attributes in files.
        order = ("domain_name", "task_name", "task_kwargs", "policy", "seed", "seeding", "max_episode_steps")
        return {name: value for name, value in {**dict.fromkeys(order), **record}.items() if value is not None}

    def without(self, arguments: Collection[str]) -> "EpisodeSpec":
        """Returns the specification without some arguments of the environment."""
        kwargs = {name: value for name, value in self.task_kwargs.items() if name not in arguments}
        return dataclasses.replace(self, task_kwargs=kwargs)

    def seed_of(self, index: int) -> int:
        """Returns the seed of an episode; one that another program recorded has none."""
        return self.seed + index

    def check_policy(self, policy: PolicyRef, environment: gymnasium.Env) -> None:
        """Builds the policy once, so that a PolicyError on bad options is raised before the first episode.

        A custom policy, which has no options, is looked up alone: it may take long to make. Warns of a policy from a
        file that was trained for a task that does not include this one.
        """
        build = policy.builder(self.policy_sha256)
        if not policy.is_custom:
            build(suite_env(environment).environment, policy_generator(self.seed))
        if path := policy.file():
            record = policies.load_policy(path).metadata
            its_task = {name: record[name] for name in ("domain_name", "task_name", "task_kwargs")}
            trained = dataclasses.replace(self, **its_task)
            domain = suite.DOMAINS.get(trained.domain_name)
            # A task of another version of the suite is not known here.
            if domain and trained.task_name in domain.tasks and not self.names <= trained.names:
                found, wanted = (f"{each.domain_name} {each.task_name}" for each in (trained, self))
                warnings.warn(f"the policy {path} was trained for {found}, not for {wanted}", stacklevel=2)

    def prepared(self, policy: PolicyRef) -> "EpisodeSpec":
        """Returns the specification with what the policy needs to act, and the digest of the policy's file."""
        observing = self.with_observables(policy)
        with contextlib.closing(observing.make_environment()) as environment:
            observing.check_policy(policy, environment)
            file = policy.file(suite_env(environment).composer_task)
        return dataclasses.replace(observing, policy_sha256=files.file_digest(file) if file else None)

    def with_observables(self, policy: PolicyRef) -> "EpisodeSpec":
        """Returns the specification with the extra observables that the policy needs, where layouts vary or always."""
        with contextlib.ExitStack() as stack:

            def make_task() -> SuiteTask:
                return suite_env(stack.enter_context(contextlib.closing(self.make_environment()))).composer_task

            missing = policy.missing_observables(make_task)
        if not missing:
            return self
        extras = [*(self.argument("extra_observables") or []), *missing]
        return dataclasses.replace(self, task_kwargs={**self.task_kwargs, "extra_observables": extras})


def _check_not_reserved(task_kwargs: Mapping[str, Any]) -> None:
    if reserved := sorted(_RESERVED & task_kwargs.keys()):
        raise ValueError(f"{', '.join(reserved)} cannot be among the task_kwargs: what plays episodes sets it")


def merged_kwargs(task_kwargs: Mapping[str, Any], named: Mapping[str, Any]) -> dict[str, Any]:
    """Returns arguments of a task's environments with some that are given by name, without those that are None.

    A text of `variations` names what varies, separated by commas, is `none`, or a JSON object of distributions.

    Raises a ValueError if an argument is given twice, with different values, or the text is not JSON.
    """
    chosen = {name: value for name, value in named.items() if value is not None}
    if isinstance(text := chosen.get("variations"), str):
        chosen["variations"] = _parsed_variations(text)
    for name, value in chosen.items():
        if (other := task_kwargs.get(name, value)) != value:
            raise ValueError(f"{name} is {checks.shown(value)}, but {checks.shown(other)} in the task_kwargs")
    return {**task_kwargs, **chosen}


def _parsed_variations(text: str) -> Any:
    if not text.lstrip().startswith("{"):
        return [] if text == NONE else text.split(",")
    try:
        return files.parse_json(text)
    except ValueError as error:
        raise ValueError(f"variations cannot be read as JSON: {error}") from error


def even_count(num_episodes: int, num_envs: int) -> int:
    """Returns the number of environments, at most `num_envs`, of which all play episodes to the end."""
    rounds = math.ceil(num_episodes / num_envs)
    return math.ceil(num_episodes / rounds)


def reset_to_seed(
    environment: gymnasium.Env, seed: int, seeding: str, options: Mapping[str, Any] | None = None
) -> tuple[Any, dict[str, Any]]:
    """Starts an episode that depends on nothing but its seed, by one of `SEEDINGS`, and the options of its reset."""
    inner = suite_env(environment)
    inner.composer_task.reset_statistics()
    chosen = None if options is None else dict(options)
    if seeding == "gymnasium":
        return environment.reset(seed=seed, options=chosen)
    inner.np_random = legacy_generator(seed)
    return environment.reset(options=chosen)


def policy_generator(seed: int) -> np.random.Generator:
    """Returns the generator of an episode's policy; the 1 tells its stream from that of the environment's seed."""
    return np.random.default_rng((seed, 1))
