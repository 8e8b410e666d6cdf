"""What a recording is made of: with it, episode `i` is the same wherever and whenever it is played."""

import dataclasses
import json
from collections.abc import Mapping
from typing import Any, cast

import gymnasium
from gymnasium.vector import AutoresetMode

from kitchen_suite import checks, gymnasium_env, policies, suite
from kitchen_suite.vector_env.base import SuiteVectorEnv
from kitchen_suite.versions import installed_versions

# What a recording decides itself.
_TAKEN = {"info_format", "max_episode_steps", "random", "render_mode", "time_limit", "visuals"}
_TAKEN |= {"autoreset_mode", "num_envs", "num_threads"}


@dataclasses.dataclass(frozen=True, kw_only=True)
class RecordingSpec:
    """What a recording is made of; episode `i` has the seed `seed + i`.

    Attributes:
      domain_name: see `suite.TASKS_BY_DOMAIN`.
      task_name: one of the domain's tasks.
      task_kwargs: further arguments of the Gymnasium environment, such as JSON can hold.
      policy: see `policies.find`.
      seed: of the first episode.
      max_episode_steps: control steps after which an episode is truncated.
      versions: by package.
    """

    domain_name: str
    task_name: str
    task_kwargs: Mapping[str, Any]
    policy: str
    seed: int
    max_episode_steps: int
    versions: Mapping[str, str]

    @classmethod
    def make(
        cls,
        *,
        domain_name: str,
        task_name: str,
        task_kwargs: Mapping[str, Any],
        policy: str,
        seed: int,
        max_episode_steps: int | None,
    ) -> "RecordingSpec":
        """Makes one of checked names, for the packages installed here.

        Raises:
          TypeError: a name is no string.
          ValueError: an unknown domain, task or policy, or an argument that is not free.
        """
        checks.choice(domain_name, gymnasium_env.IDS.keys(), "domain")
        suite.check_not_fixed(domain_name, task_name, task_kwargs)
        if taken := sorted(_TAKEN & task_kwargs.keys()):
            raise ValueError(f"{', '.join(taken)} cannot be among the task_kwargs: a recording decides that itself")
        policies.find(policy)
        limit = max_episode_steps or gymnasium.spec(gymnasium_env.IDS[domain_name]).max_episode_steps
        return cls(
            domain_name=domain_name,
            task_name=task_name,
            task_kwargs=dict(task_kwargs),
            policy=policy,
            seed=seed,
            max_episode_steps=cast(int, limit),
            versions=installed_versions(),
        )

    @classmethod
    def of(cls, record: Mapping[str, Any]) -> "RecordingSpec":
        """Makes one of what `record` gave.

        Raises:
          ValueError: it is something else.
        """
        names = {field.name for field in dataclasses.fields(cls)}
        if not isinstance(record, Mapping) or record.keys() != names:
            raise ValueError(f"a recording is described by {sorted(names)}, not by {record!r}")
        return cls(**record)

    def record(self) -> dict[str, Any]:
        """All of it, as JSON has it."""
        return json.loads(json.dumps(dataclasses.asdict(self)))

    def environment(self, **extra: Any) -> gymnasium.Env:
        """Makes the environment that each episode can be played again in."""
        return gymnasium.make(
            gymnasium_env.IDS[self.domain_name], max_episode_steps=self.max_episode_steps, **self._settings(), **extra
        )

    def environments(self, num_envs: int, num_threads: int | None) -> SuiteVectorEnv:
        """Makes environments that start episodes only when they are told to."""
        return cast(
            SuiteVectorEnv,
            gymnasium.make_vec(
                gymnasium_env.IDS[self.domain_name],
                num_envs,
                vectorization_mode="vector_entry_point",
                num_threads=num_threads,
                autoreset_mode=AutoresetMode.DISABLED,
                max_episode_steps=self.max_episode_steps,
                **self._settings(),
            ),
        )

    def _settings(self) -> dict[str, Any]:
        task = suite.task_arguments(self.domain_name, self.task_name)
        arguments = json.loads(json.dumps({**task, **self.task_kwargs}))
        return {**arguments, **({"info_format": "arrays"} if self.domain_name == "kitchen" else {})}
