"""Policies by name: random, zero, expert, trained, a person, a server, and `module:callable` for a user's own.

A policy is called with the present `dm_env.TimeStep` and returns the action. An episode starts where `timestep.first()`
is true. A policy may have an attribute `labels`, a mapping that says something of its last action, by names that are
the same after every action; recordings keep them. Rollouts assign the task's sentence to an attribute `instruction`,
where a policy has one, before each action.

A policy `gym:module:callable` is called with the observation of the Gymnasium environment instead, which is what
policies of Gymnasium's libraries were trained on. What a policy is called with is its attribute `takes`.

A policy of a user's own, or on a server, sees what the `obs_type` of the environment shows: with `pixels_agent_pos`
images and the robot's joints. One with an attribute `privileged` that is true sees everything, for example a scripted
one that records images. The suite's own policies do: experts need it, and trained ones read what they were trained on.
"""

import abc
import ast
import contextlib
import dataclasses
import functools
import itertools
import pkgutil
import re
import traceback
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import dm_env
import numpy as np
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks, files, signatures
from kitchen_suite.names import EXTRA_PACKAGES

if TYPE_CHECKING:
    from kitchen_suite.policies.stored import StoredPolicy
    from kitchen_suite.tasks.task import SuiteTask

Policy = Callable[[Any], ArrayLike]
"""Returns the action for a `dm_env.TimeStep` of the suite's environment, or for what `takes` says."""

PolicyBuilder = Callable[..., Policy]
"""Builds the policy for one episode from the environment and a generator of the episode's own."""

# What a policy is called with.
TIMESTEP = "timestep"  # Of the suite's own environment.
OBSERVATION = "observation"  # Of the Gymnasium environment.

_ADDRESS = re.compile(r"wss?://\S+")  # A policy on a server, by its address alone.
_OF_GYMNASIUM = re.compile(r"gym:(?P<name>[^:]+:.+)")  # A policy that takes the Gymnasium environment's observation.
# The address of a server with another scheme, or without one: a name with a port.
_OTHER_ADDRESS = re.compile(r"(?P<scheme>https?://)?(?P<host>[\w.-]+(?::\d+)?)(?P<path>/\S*)?")
_MAX_LENGTH = 5_000  # Characters of a policy with options; there is room for the path of a file.


class PolicyError(ValueError):
    """A policy could not be built, raised an exception, or returned a bad action."""


class PolicySource(abc.ABC):
    """A kind of policies that a name selects.

    Attributes:
      takes_options: whether the name may have options, such as `expert(speed=0.8)`.
      extra: a key of `EXTRA_PACKAGES`, the extra that it needs, if any.
      privileged: whether its policies see observations that the `obs_type` of the environment leaves out.
      player: entry point of the function that lets each episode be played before it is stepped, called with its
        `episodes.spec.EpisodeSpec`; None for policies that act by themselves.
    """

    takes_options = False
    extra: str | None = None
    privileged = True
    player: str | None = None

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
        shape = environment.action_spec().shape
        return lambda timestep: np.zeros(shape)


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
    from kitchen_suite.policies import imitated, stored, trained

    classes: tuple[type[stored.StoredPolicy], ...] = (trained.TrainedPolicy, *imitated.POLICIES)
    return stored.load(path, classes)


class TrainedSource(PolicySource):
    """Trained policies, which act without exploration noise; some algorithms draw their actions.

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
        return self._load(path).episode(environment.task, generator)

    def for_episodes(self, digest: str | None) -> PolicyBuilder:
        return type(self)(digest)

    def file(self, options: Mapping[str, Any], task: "SuiteTask | None" = None) -> Path | None:
        from kitchen_suite.policies.trained import shipped

        if isinstance(file := options.get("file"), str):
            return Path(file)
        return shipped(task) if task else None

    def missing_observables(self, make_task: "Callable[[], SuiteTask]", options: Mapping[str, Any]) -> list[str]:
        # What prevents reading the file is reported where the policy is built.
        task = make_task()
        with contextlib.suppress(OSError, ValueError):
            if file := self.file(options, task):
                return self._load(file).missing_observables(task)
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


class TeleopSource(PolicySource):
    """A person, who moves the hand in a browser. It needs the extra `experts`, and in commands `web`.

    The option `policy` names one that acts until the person takes over, `rewind=False` forbids to go back, and `port`
    is that of the page. In commands, each episode is played in the page before it is recorded or scored.
    """

    takes_options, extra = True, "experts"
    player = "kitchen_suite.viewer.viewer:Player"

    def __call__(
        self,
        environment: dm_env.Environment,
        generator: np.random.Generator,
        *,
        policy: str | None = None,
        rewind: bool = True,
        port: int = 8080,
    ) -> Policy:
        from kitchen_suite.policies.experts.teleoperation import TeleoperatedPolicy

        if policy is not None and (not isinstance(policy, str) or player_of(policy)):
            raise ValueError(f"policy must be the name of one that acts by itself, got {checks.shown(policy)}")
        if policy is not None and _OF_GYMNASIUM.fullmatch(policy):
            raise ValueError(f"policy must be one that takes a dm_env.TimeStep, got {checks.shown(policy)}")
        checks.boolean(rewind, "rewind")
        checks.integer(port, "port", minimum=1024, maximum=65535)
        return TeleoperatedPolicy(environment.task, find(policy)(environment, generator) if policy else None)

    def file(self, options: Mapping[str, Any], task: "SuiteTask | None" = None) -> Path | None:
        first = options.get("policy")
        return policy_file(first, task) if isinstance(first, str) else None

    def missing_observables(self, make_task: "Callable[[], SuiteTask]", options: Mapping[str, Any]) -> list[str]:
        first = options.get("policy")
        return missing_observables(first, make_task) if isinstance(first, str) else []


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

        if not isinstance(address, str) or not _ADDRESS.fullmatch(address):
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
        "teleop": TeleopSource(),
        "remote": RemoteSource(),
    }
)
"""The policies that a name alone selects, such as `random`; each is called to build one."""


def find(name: str, *, digest: str | None = None) -> PolicyBuilder:
    """Returns the builder of a named policy. The policy checks its actions and returns them as float64.

    The builder reads the file of a trained policy once, for its first episode.

    Args:
      name: a key of `POLICIES`, with options where it takes any, such as `expert(speed=0.8, jitter=0.02)` or
        `trained(file='policy.npz')`; an address `ws://host:port`, a policy on a server; or `module:callable`, a policy
        that is the same object in every episode; `gym:module:callable` is one that takes observations of the Gymnasium
        environment. Modules are also looked for in the working directory.
      digest: SHA-256 that the policy's file must have, if given: the builder raises a PolicyError for another file.

    Raises:
      ImportError: the policy needs an extra that is not installed.
      ValueError: the policy does not exist, cannot be imported or cannot be called, or `name` is not well-formed.
    """
    if meant := _meant(name):
        raise ValueError(f"policy {checks.shown(name)} is not a name: write {meant}")
    key, options = _key_and_options(name)
    if ":" in key:
        of_gymnasium = _OF_GYMNASIUM.fullmatch(name)
        imported = checks.imported(of_gymnasium["name"] if of_gymnasium else name, "policy")
        if not callable(imported):
            raise ValueError(f"policy {checks.shown(name)} cannot be called: it is {checks.shown(imported)}")
        if of_gymnasium:
            return lambda environment, generator: _CheckedPolicy(imported, name, environment, takes=OBSERVATION)
        privileged = bool(getattr(imported, "privileged", False))
        return lambda environment, generator: _CheckedPolicy(imported, name, environment, privileged=privileged)
    try:
        source = POLICIES[checks.choice(key, POLICIES.keys(), "policy")]
    except ValueError as error:
        raise ValueError(f"{error}, or name one of your own as module:callable or gym:module:callable") from error
    if source.extra:
        checks.installed(EXTRA_PACKAGES[source.extra], f"policy {checks.shown(name)}", source.extra)
    if options and not source.takes_options:
        others = " and ".join(other for other, each in POLICIES.items() if each.takes_options)
        raise ValueError(f"policy {key!r} takes no options, got {checks.shown(name)}; {others} do")
    build = source.for_episodes(digest)

    def build_with_checks(environment: dm_env.Environment, generator: np.random.Generator) -> Policy:
        try:
            policy = build(environment, generator, **options)
        except (OSError, TypeError, ValueError) as error:
            raise PolicyError(f"policy {checks.shown(name)} cannot be built: {error}") from error
        return _CheckedPolicy(policy, name, environment, privileged=source.privileged)

    return build_with_checks


def policy_file(name: str, task: "SuiteTask | None" = None) -> Path | None:
    """Returns the file that a named policy is read from; None for policies without a file.

    Without the task that it acts in, only files that are named as in `trained(file=...)` are found.
    """
    key, options = _key_and_options(name)
    return POLICIES[key].file(options, task) if key in POLICIES else None


def missing_observables(name: str, make_task: "Callable[[], SuiteTask]") -> list[str]:
    """Returns the extra observables that a named policy needs and that a task does not have.

    The task is that of `make_task`, which is not called for policies that act in every task.
    """
    key, options = _key_and_options(name)
    return POLICIES[key].missing_observables(make_task, options) if key in POLICIES else []


def options_of(name: str) -> dict[str, Any]:
    """Returns the options in the name of a policy."""
    return _key_and_options(name)[1]


def player_of(name: str) -> Callable[..., Any] | None:
    """Returns what plays the episodes of a named policy ahead, see `PolicySource.player`; None for most policies."""
    source = POLICIES.get(_key_and_options(name)[0])
    return pkgutil.resolve_name(source.player) if source and source.player else None


def labels_of(policy: Policy) -> Mapping[str, NDArray]:
    """Returns what a policy says of its last action, by name: its `labels` as arrays, none if it has no such attribute.

    A label is a number, or an array of numbers of the same shape for every action.
    """
    return {label: np.asarray(value) for label, value in getattr(policy, "labels", {}).items()}


def takes(policy: Policy) -> str:
    """Returns what a policy is called with, `TIMESTEP` or `OBSERVATION`: its attribute `takes`, if it has one."""
    return getattr(policy, "takes", TIMESTEP)


def instruct(policy: Policy, sentence: Callable[[], str]) -> None:
    """Assigns the task's sentence, which a function returns, to the attribute `instruction` of a policy that has it."""
    if hasattr(policy, "instruction"):
        policy.instruction = sentence()


def without_file(name: str) -> str:
    """Returns the name of a policy without the path of its file."""
    key, options = _key_and_options(name)
    if "file" not in options:
        return name
    others = ", ".join(f"{option}={value!r}" for option, value in options.items() if option != "file")
    return f"{key}({others})" if others else key


def _meant(name: str) -> str | None:
    """Returns how to write a policy that is named in a form which none has; None for other names."""
    key, mark, rest = name.partition(":")
    if name.endswith(".npz"):
        return f"trained(file={checks.shown(rest if mark and key in POLICIES else name)})"
    if mark and key in POLICIES:
        return f"its options as in a call, {key}({rest})" if POLICIES[key].takes_options else key
    if name.endswith(".py"):
        checks.imported(name, "policy")  # Raises the error of a file in place of a module.
    address = _OTHER_ADDRESS.fullmatch(name)
    if address and (address["scheme"] or re.search(r":\d", name)):
        scheme = "wss" if address["scheme"] == "https://" else "ws"
        return f"{scheme}://{address['host']}{address['path'] or ''}, the address of a server"
    return None


def _key_and_options(text: str) -> tuple[str, dict[str, Any]]:
    """Returns a policy's name and its options, written as in a Python call; an address is an option of `remote`."""
    if _ADDRESS.fullmatch(text):
        return "remote", {"address": text}
    if "(" not in text:
        return text, {}
    if len(text) > _MAX_LENGTH:
        raise ValueError(f"policy {checks.shown(text)} is not well-formed: it has {len(text)} characters")
    # Python's parser raises the last two for nested text.
    with contextlib.suppress(SyntaxError, ValueError, MemoryError, RecursionError):
        match ast.parse(text, mode="eval").body:
            case ast.Call(func=ast.Name(id=name), args=[], keywords=options) if all(option.arg for option in options):
                return name, {str(option.arg): ast.literal_eval(option.value) for option in options}
    forms = "expert(speed=0.8, jitter=0.02) or trained(file='policy.npz'), with strings in quotes"
    problem = f"policy {checks.shown(text)} is not well-formed"
    raise ValueError(f"{problem}: it must be a name, or a name with options such as {forms}")


class _CheckedPolicy:
    """A policy that returns valid actions in fresh arrays, or raises a PolicyError that names it.

    Unless it is privileged, it sees no observations that the `obs_type` of the environment leaves out.
    """

    def __init__(
        self,
        policy: Policy,
        name: str,
        environment: dm_env.Environment,
        *,
        takes: str = TIMESTEP,
        privileged: bool = False,
    ) -> None:
        self._policy, self._name, self._environment = policy, name, environment
        self.takes = takes
        sees_everything = privileged or takes == OBSERVATION
        self._hidden: Collection[str] = () if sees_everything else environment.task.hidden_keys

    def __call__(self, given: Any) -> NDArray[np.float64]:
        if self._hidden:
            shown = {key: value for key, value in given.observation.items() if key not in self._hidden}
            given = given._replace(observation=shown)
        try:
            action = self._policy(given)
        except ConnectionError as error:
            raise PolicyError(f"policy {checks.shown(self._name)} cannot act: {error}") from error
        except (Exception, SystemExit) as error:
            frame = traceback.extract_tb(error.__traceback__)[-1]
            problem = f"{type(error).__name__}: {error} ({frame.filename}, line {frame.lineno})"
            if isinstance(error, KeyError) and str(error) in map(repr, self._hidden):
                problem += "; the obs_type does not show it: choose another one, or set privileged = True on the policy"
            raise PolicyError(f"policy {checks.shown(self._name)} raised {problem}") from error
        try:
            return self._environment.task.checked_action(action)
        except (TypeError, ValueError) as error:
            raise PolicyError(f"policy {checks.shown(self._name)} returned a bad action: {error}") from error

    @property
    def labels(self) -> Mapping[str, NDArray]:
        return labels_of(self._policy)

    @property
    def instruction(self) -> str:
        return self._policy.instruction  # type: ignore[attr-defined]

    @instruction.setter
    def instruction(self, sentence: str) -> None:
        try:
            self._policy.instruction = sentence  # type: ignore[attr-defined]
        except Exception as error:
            raise PolicyError(f"policy {checks.shown(self._name)} refuses its instruction: {error}") from error
