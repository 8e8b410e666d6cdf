"""The sources of policies that have a name, and what a policy is; `policies.reference` reads the names.

A policy is called with the present `dm_env.TimeStep` and returns the action. An episode starts where `timestep.first()`
is true. A policy may have an attribute `labels`, a mapping that says something of its last action, by names that are
the same after every action; recordings keep them. Rollouts assign the task's sentence to an attribute `instruction`,
where a policy has one, before each action.
`policies.memory` describes custom policies with a memory, and factories.

A policy `gym:module:callable` is called with the observation of the Gymnasium environment instead, which is what
policies of Gymnasium's libraries were trained on. `kitchen_suite.policies.PolicyRef` says what a policy is called
with.

A policy of a user's own, or on a server, sees what the `obs_type` of the environment shows: with `pixels_agent_pos`
images and the robot's joints. One with an attribute `privileged` that is true sees everything, for example a scripted
one that records images. The suite's own policies do: experts need it, and trained ones read what they were trained on.
"""

import abc
import contextlib
import dataclasses
import functools
import itertools
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import dm_env
import numpy as np
from numpy.typing import ArrayLike

from kitchen_suite import checks, files, signatures

if TYPE_CHECKING:
    from kitchen_suite.policies.files import StoredPolicy
    from kitchen_suite.tasks.task import SuiteTask

Policy = Callable[[Any], ArrayLike]
"""Returns the action for a `dm_env.TimeStep` of the suite's environment, or for what `takes` says."""

PolicyBuilder = Callable[..., Policy]
"""Builds the policy for one episode from an environment and a generator of the episode's own.

Of many environments that are stepped together the environment is their template: it has their task, and not the physics
of the episode.

The builder of `PolicyRef.builder` also takes a `row`: of several episodes at once each has another one, and the policy
of a row's next episode may be the same object, which is reset. Without a row, a policy with a memory is another object.
"""

# A policy on a server, by its address alone.
ADDRESS = re.compile(r"wss?://\S+")


class PolicyError(ValueError):
    """A policy could not be built, raised an exception, or returned a bad action."""


class PolicySource(abc.ABC):
    """A kind of policies that a name selects.

    Attributes:
      takes_options: whether the name may have options, such as `expert(speed=0.8)`.
      extra: a key of `EXTRA_PACKAGES`, the extra that it needs, if any.
      privileged: whether its policies see observations that the `obs_type` of the environment leaves out.
    """

    takes_options = False
    extra: str | None = None
    privileged = True

    @abc.abstractmethod
    def __call__(
        self, environment: dm_env.Environment, generator: np.random.Generator, *args: Any, **options: Any
    ) -> Policy:
        """Builds the policy for an episode with the options of its name; random numbers come from the generator."""

    def for_episodes(self, digest: str | None) -> PolicyBuilder:
        """Returns the builder for several episodes, which reads a file once and checks its SHA-256 if one is given."""
        return self

    def file(self, options: Mapping[str, Any], task: "SuiteTask | None" = None) -> Path | None:
        """Returns the file that the policy is read from; None without one, or where only a task can determine it."""
        return None

    def missing_observables(self, make_task: "Callable[[], SuiteTask]", options: Mapping[str, Any]) -> list[str]:
        """Returns the extra observables that the policy with given options needs and that a task, once made, lacks."""
        return []


class RandomSource(PolicySource):
    """Policies of uniform actions; elements of the action without bounds are standard normal."""

    def __call__(self, environment: dm_env.Environment, generator: np.random.Generator) -> Policy:
        spec = environment.action_spec()
        shape, bounds = spec.shape, [getattr(spec, "minimum", -np.inf), getattr(spec, "maximum", np.inf)]
        bounded = np.broadcast_to(np.isfinite(bounds[0]) & np.isfinite(bounds[1]), shape)
        low, high = (np.where(bounded, bound, 0.0) for bound in bounds)
        return lambda timestep: np.where(bounded, generator.uniform(low, high, shape), generator.standard_normal(shape))


class ZeroSource(PolicySource):
    """Policies of zero actions."""

    def __call__(self, environment: dm_env.Environment, generator: np.random.Generator) -> Policy:
        zeros = np.zeros(environment.action_spec().shape)
        # Some control modes have no such action, such as poses, whose quaternion cannot be 0.
        environment.task.checked_action(zeros)
        return lambda timestep: zeros.copy()


class ExpertSource(PolicySource):
    """A scripted expert for the environment's task. It needs the extra `experts`.

    Its options are attributes of `experts.MotionStyle`, and arguments of the expert and its control mode.
    """

    takes_options, extra = True, "experts"

    def __init__(self, kind: str = "expert") -> None:
        """Prepares to build the experts of a kind, as in `experts.expert_class`."""
        self._kind = kind

    def __call__(self, environment: dm_env.Environment, generator: np.random.Generator, **options: Any) -> Policy:
        from kitchen_suite.policies import experts

        expert_class = experts.expert_class(environment.task, self._kind)
        constructors = itertools.takewhile(lambda base: base is not experts.Expert, expert_class.__mro__)
        functions: list[Callable[..., Any]] = [experts.MotionStyle, *constructors, *expert_class.control_modes.values()]
        checks.keywords(options, {*signatures.names(*functions)} - {"style"}, what="option")
        names = options.keys() & {field.name for field in dataclasses.fields(experts.MotionStyle)}
        style = experts.MotionStyle(**{name: options.pop(name) for name in names})
        return experts.make_policy(environment, generator, kind=self._kind, style=style, **options)

    def missing_observables(self, make_task: "Callable[[], SuiteTask]", options: Mapping[str, Any]) -> list[str]:
        from kitchen_suite.policies import experts

        task = make_task()
        return experts.expert_class(task, self._kind).missing_in(task)


def load_policy(path: Path) -> "StoredPolicy":
    """Reads a trained policy of any algorithm; raises as `StoredPolicy.load`."""
    from kitchen_suite.policies.chunks import ChunkPolicy
    from kitchen_suite.policies.files import load
    from kitchen_suite.policies.perceptron import PerceptronPolicy

    classes: tuple[type[StoredPolicy], ...] = (PerceptronPolicy, ChunkPolicy)
    return load(path, classes)


class TrainedSource(PolicySource):
    """Trained policies, which act without exploration noise.

    The option `file` names one of `kitchen-train`; the default comes with the package for the task and its reward.
    """

    takes_options = True

    def __init__(self, digest: str | None = None) -> None:
        """Prepares to read files whose SHA-256 must be `digest`, if that is given."""
        self._digest = digest
        self._load = functools.cache(self._load_checked)

    def __call__(
        self, environment: dm_env.Environment, generator: np.random.Generator, *, file: str | None = None
    ) -> Policy:
        path = Path(file) if file else self.file({}, environment.task)
        assert path, "without a file, the task determines it"
        return self._load(path).episode(environment.task)

    def for_episodes(self, digest: str | None) -> PolicyBuilder:
        return type(self)(digest)

    def file(self, options: Mapping[str, Any], task: "SuiteTask | None" = None) -> Path | None:
        from kitchen_suite.policies.files import shipped

        if isinstance(file := options.get("file"), str):
            return Path(file)
        return shipped(task) if task else None

    def missing_observables(self, make_task: "Callable[[], SuiteTask]", options: Mapping[str, Any]) -> list[str]:
        # What prevents reading the file is reported where the policy is built.
        task = make_task()
        with contextlib.suppress(OSError, ValueError):
            if file := self.file(options, task):
                return load_policy(file).missing_observables(task)
        return []

    def _load_checked(self, path: Path) -> "StoredPolicy":
        policy = load_policy(path)
        if self._digest is not None and files.file_digest(path) != self._digest:
            raise ValueError(f"{path} is not the file that the command began with: it was replaced, or differs here")
        return policy


class Takeover:
    """Acts by one policy first, and from a control step on by another one.

    Attributes:
      labels: `is_intervention`, whether the second policy chose the last action.
    """

    def __init__(self, first: Policy, second: Policy, step: int) -> None:
        """Prepares for an episode; `step`, counted from 0, is the first one of the second policy."""
        self._first, self._second, self._takeover, self._step = first, second, step, 0
        self.labels = {"is_intervention": False}

    def __call__(self, timestep: dm_env.TimeStep) -> ArrayLike:
        self._step = 0 if timestep.first() else self._step + 1
        has_taken_over = self._step >= self._takeover
        self.labels = {"is_intervention": has_taken_over}
        if self._step == self._takeover:
            timestep = timestep._replace(step_type=dm_env.StepType.FIRST)
        return (self._second if has_taken_over else self._first)(timestep)


class TakeoverSource(TrainedSource):
    """A trained policy, and the scripted expert that takes over from it: demonstrations from where a policy leads.

    The control step of the takeover is drawn from 0 to the option `latest`; `file` is of the trained policy as in
    `trained`, other options are of `expert`. Source of the idea: Ross, Gordon and Bagnell, A Reduction of Imitation
    Learning and Structured Prediction to No-Regret Online Learning (DAgger), AISTATS 2011.
    """

    extra = "experts"
    _expert = ExpertSource()

    def __call__(
        self,
        environment: dm_env.Environment,
        generator: np.random.Generator,
        *,
        file: str | None = None,
        latest: int = 200,
        **options: Any,
    ) -> Policy:
        step = int(generator.integers(checks.integer(latest, "latest", minimum=0), endpoint=True))
        first = super().__call__(environment, generator, file=file)
        return Takeover(first, self._expert(environment, generator, **options), step)

    def missing_observables(self, make_task: "Callable[[], SuiteTask]", options: Mapping[str, Any]) -> list[str]:
        task = make_task()
        own = super().missing_observables(lambda: task, options)
        return [*dict.fromkeys([*own, *self._expert.missing_observables(lambda: task, options)])]


class RemoteSource(PolicySource):
    """A policy on a server of openpi's protocol, named by an address such as `ws://localhost:8000`. Needs `remote`.

    `remote(address='ws://localhost:8000', timeout=60)` is the same, with the time that an answer may take [s].
    """

    takes_options, extra = True, "remote"
    privileged = False

    def __call__(
        self, environment: dm_env.Environment, generator: np.random.Generator, *, address: str = "", timeout: float = 60
    ) -> Policy:
        from kitchen_suite.policies.remote import RemotePolicy

        if not isinstance(address, str) or not ADDRESS.fullmatch(address):
            raise ValueError(f"address must be one such as 'ws://localhost:8000', got {checks.shown(address)}")
        return RemotePolicy(environment, address, checks.number(timeout, "timeout", positive=True, maximum=86_400))


POLICIES: Mapping[str, PolicySource] = MappingProxyType(
    {
        "random": RandomSource(),
        "zero": ZeroSource(),
        "expert": ExpertSource(),
        "undirected": ExpertSource("undirected"),
        "trained": TrainedSource(),
        "takeover": TakeoverSource(),
        "remote": RemoteSource(),
    }
)
"""The policies that a name alone selects, such as `random`; each is called to build one."""
