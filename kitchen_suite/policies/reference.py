"""Which policy acts: a name with options, the file of a trained policy, the address of a server, or a callable."""

import ast
import contextlib
import dataclasses
import functools
import re
from collections.abc import Callable, Collection, Hashable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import dm_env
import numpy as np
from numpy.typing import NDArray

from kitchen_suite import checks, imports, installation
from kitchen_suite.installation import EXTRA_PACKAGES
from kitchen_suite.policies.memory import PolicyMaker, batch_policy, check_batch_policy, described
from kitchen_suite.policies.registry import ADDRESS, POLICIES, Policy, PolicyBuilder, PolicyError, PolicySource

if TYPE_CHECKING:
    from kitchen_suite.tasks.task import SuiteTask

# What a policy is called with: a time step of the suite's own environment, the observation of the Gymnasium
# environment, or the observations of the vectorised one, for which it returns the actions `(n, ...)`.
TIMESTEP = "timestep"
OBSERVATION = "observation"
BATCH = "batch"
TAKES = (TIMESTEP, OBSERVATION, BATCH)

# A callable that takes the Gymnasium environment's observation.
_OF_GYMNASIUM = re.compile(r"gym:(?P<name>[^:]+:.+)")

# The address of a server with another scheme, or without one: a name with a port.
_OTHER_ADDRESS = re.compile(r"(?P<scheme>https?://)?(?P<host>[\w.-]+(?::\d+)?)(?P<path>/\S*)?")

# Name and password in an address, which recordings and results do not keep.
_CREDENTIALS = re.compile(r"(?<=://)[^\s/@'\"]*@")

# Beginning of the names of policies that are objects, of which recordings and results say no more.
_OBJECT = "object "

# Characters of a policy with options; there is room for the path of a file.
_MAX_LENGTH = 5_000


@dataclasses.dataclass(frozen=True, kw_only=True)
class PolicyRef:
    """A policy that has been named, but not yet built.

    Attributes:
      text: its name, as recordings and results have it: without the password of an address.
      key: a key of `POLICIES`; for all others `module:callable`, or the empty string for an object.
      options: of the name, such as those of `expert(speed=0.8)`.
      function: the policy itself or a factory of policies, where an object was given in place of a name.
      takes: what it is called with, one of `TAKES`.
    """

    text: str
    key: str
    options: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    function: Callable[..., Any] | None = None
    takes: str = TIMESTEP

    @classmethod
    def of(cls, policy: "str | Path | PolicyRef | Callable[..., Any]", takes: str = TIMESTEP) -> Self:
        """Returns the reference to a policy.

        Args:
          policy: a name or an address as in `parse`, the path of a trained policy's file, or a callable: a policy or a
            factory of policies, as in `policies.memory`.
          takes: what a policy that is a callable is called with: `timestep`, a `dm_env.TimeStep` of the suite's own
            environment; `observation`, that of the Gymnasium environment; or `batch`, the observations of many
            environments, for which it returns as many actions.

        Raises a ValueError if there is no such policy, a TypeError for what cannot be called.
        """
        checks.choice(takes, TAKES, "takes")
        if isinstance(policy, cls):
            if takes not in (TIMESTEP, policy.takes):
                raise ValueError(f"takes={takes!r} contradicts the reference, whose policy takes {policy.takes!r}")
            return policy
        if isinstance(policy, Path) and takes == TIMESTEP:
            return cls(text=f"trained(file={str(policy)!r})", key="trained", options={"file": str(policy)})
        if isinstance(policy, str | Path):
            if takes != TIMESTEP:
                raise ValueError(f"takes={takes!r} is for callables, not for the policy named {checks.shown(policy)}")
            return cls.parse(str(policy))
        if not callable(policy):
            raise TypeError(f"policy must be a name, a file or a callable, got {checks.shown(policy)}")
        name = getattr(policy, "__qualname__", type(policy).__qualname__)
        return cls(text=f"{_OBJECT}{policy.__module__}.{name}", key="", function=policy, takes=takes)

    @classmethod
    def parse(cls, text: str) -> Self:
        """Returns the reference to a policy that is named by a text.

        It is a key of `POLICIES`, with options where it takes any, such as `expert(speed=0.8, jitter=0.02)` or
        `trained(file='policy.npz')`; the path of a file that ends with `.npz`, a trained policy; an address
        `ws://host:port`, a policy on a server; `module:callable`, a policy or a factory of policies as in
        `policies.memory`; or `gym:module:callable`, of one that takes observations of the Gymnasium environment.
        Nothing is imported yet.

        Raises a ValueError if the text is not well-formed, or names no policy.
        """
        if text.startswith(_OBJECT):
            return cls(text=text, key="")
        if hint := _well_formed(text):
            raise ValueError(f"policy {checks.shown(text)} is not a name: write {hint}")
        if text.endswith(".npz") and "(" not in text:
            return cls(text=f"trained(file={text!r})", key="trained", options={"file": text})
        if of_gymnasium := _OF_GYMNASIUM.fullmatch(text):
            return cls(text=text, key=of_gymnasium["name"], takes=OBSERVATION)
        key, options = _key_and_options(text)
        if ":" in key:
            return cls(text=text, key=key)
        text = _CREDENTIALS.sub("", text)
        try:
            source = POLICIES[checks.choice(key, POLICIES.keys(), "policy")]
        except ValueError as error:
            raise ValueError(f"{error}, or name a custom one as module:callable or gym:module:callable") from error
        if options and not source.takes_options:
            others = " and ".join(other for other, each in POLICIES.items() if each.takes_options)
            raise ValueError(f"policy {key!r} takes no options, got {checks.shown(text)}; {others} do")
        return cls(text=text, key=key, options=options)

    @property
    def _source(self) -> PolicySource | None:
        return POLICIES.get(self.key)

    @property
    def without_file(self) -> str:
        """Name of the policy without the path of its file."""
        if "file" not in self.options:
            return self.text
        others = ", ".join(f"{option}={value!r}" for option, value in self.options.items() if option != "file")
        return f"{self.key}({others})" if others else self.key

    def file(self, task: "SuiteTask | None" = None) -> Path | None:
        """Returns the file that the policy is read from; None for policies without a file.

        Without the task that it acts in, only files that are named as in `trained(file=...)` are found.
        """
        return self._source.file(self.options, task) if self._source else None

    @property
    def is_custom(self) -> bool:
        """Whether it is an object or `module:callable`."""
        return self._source is None

    @property
    def is_independent_of_tasks(self) -> bool:
        """Whether it is the same in every task: a custom one or one on a server, which no task has to be built for."""
        return self._source is None or not self._source.privileged

    def missing_observables(self, make_task: "Callable[[], SuiteTask]") -> list[str]:
        """Returns the extra observables that the policy needs and that a task does not have.

        The task is that of `make_task`, which is not called for policies that act in every task.
        """
        return self._source.missing_observables(make_task, self.options) if self._source else []

    def builder(self, digest: str | None = None) -> PolicyBuilder:
        """Returns the builder of the policy, which checks its actions and returns them as float64.

        The builder reads the file of a trained policy once, for its first episode.

        Args:
          digest: SHA-256 that the policy's file must have, if given: the builder raises a PolicyError for another file.

        Raises:
          ImportError: the policy needs an extra that is not installed.
          ValueError: the policy cannot be imported, called or, with a memory, copied.
        """
        source, options, text = self._source, self.options, self.text
        if source is None:
            return self._custom_builder()
        if source.extra:
            installation.installed(EXTRA_PACKAGES[source.extra], f"policy {checks.shown(text)}", source.extra)
        build = source.for_episodes(digest)

        def build_with_checks(
            environment: dm_env.Environment, generator: np.random.Generator, row: Hashable | None = None
        ) -> Policy:
            try:
                policy = build(environment, generator, **options)
            except (OSError, TypeError, ValueError) as error:
                raise PolicyError(f"policy {checks.shown(text)} cannot be built: {error}") from error
            return _CheckedPolicy(policy, text, environment, privileged=source.privileged)

        return build_with_checks

    def sequential_builder(self, digest: str | None = None) -> PolicyBuilder:
        """Returns the builder, as `builder`, for episodes that are played one after the other: all are of one row."""
        return functools.partial(self.builder(digest), row=0)

    def batch_policy(self) -> Policy:
        """Returns the policy for a batch; raises a PolicyError as `memory.batch_policy`."""
        assert self.takes == BATCH
        return batch_policy(self._callable(), self._title)

    def _custom_builder(self) -> PolicyBuilder:
        """Returns the builder of a policy that is an object or `module:callable`, or that a factory makes."""
        given = self._callable()
        if self.takes == BATCH:
            check_batch_policy(given, self._title)
            # It acts in vectorised environments alone, which call `batch_policy`.
            return lambda environment, generator, row=None: _CheckedPolicy(given, self.text, environment, takes=BATCH)
        make = PolicyMaker(given, self._title)

        def build(
            environment: dm_env.Environment, generator: np.random.Generator, row: Hashable | None = None
        ) -> Policy:
            policy = make(row)
            privileged = any(getattr(each, "privileged", False) for each in (policy, given))
            return _CheckedPolicy(policy, self.text, environment, takes=self.takes, privileged=privileged)

        return build

    @property
    def _title(self) -> str:
        return f"policy {checks.shown(self.text)}"

    def _callable(self) -> Callable[..., Any]:
        """Returns the object that was given, or imports it; modules are also looked for in the working directory."""
        if self.function is not None:
            return self.function
        if not self.key:
            raise ValueError(f"policy {checks.shown(self.text)} was an object of a program, which no name leads to")
        imported = imports.named(self.key, "policy")
        if not callable(imported):
            raise ValueError(f"policy {checks.shown(self.text)} cannot be called: it is {checks.shown(imported)}")
        return imported


def find(name: str, *, digest: str | None = None) -> PolicyBuilder:
    """Returns the builder of a named policy; see `PolicyRef.parse` and `PolicyRef.builder`."""
    return PolicyRef.parse(name).builder(digest)


def labels_of(policy: Policy) -> Mapping[str, NDArray]:
    """Returns what a policy says of its last action, by name: its `labels` as arrays, none if it has no such attribute.

    A label is a number, or an array of numbers of the same shape for every action.
    """
    return {label: np.asarray(value) for label, value in getattr(policy, "labels", {}).items()}


def takes_of(policy: Policy) -> str:
    """Returns what a policy is called with, `TIMESTEP` or `OBSERVATION`: its attribute `takes`, if it has one."""
    return getattr(policy, "takes", TIMESTEP)


def instruct(policy: Policy, sentence: Callable[[], str]) -> None:
    """Assigns the task's sentence, which a function returns, to the attribute `instruction` of a policy that has it."""
    if hasattr(policy, "instruction"):
        policy.instruction = sentence()


def _well_formed(text: str) -> str:
    """Returns how to write a policy that is named in a form which none has; the empty string for other texts."""
    key, mark, rest = text.partition(":")
    if mark and key in POLICIES:
        if rest.endswith(".npz"):
            return rest
        return f"its options as in a call, {key}({rest})" if POLICIES[key].takes_options else key
    if text.endswith(".py"):
        imports.check_no_file(text, "policy")
    address = _OTHER_ADDRESS.fullmatch(text)
    if address and (address["scheme"] or re.search(r":\d", text)):
        scheme = "wss" if address["scheme"] == "https://" else "ws"
        return f"{scheme}://{address['host']}{address['path'] or ''}, the address of a server"
    return ""


def _key_and_options(text: str) -> tuple[str, dict[str, Any]]:
    """Returns a policy's name and its options, written as in a Python call; an address is an option of `remote`."""
    if ADDRESS.fullmatch(text):
        return "remote", {"address": text}
    if "(" not in text:
        return text, {}
    if len(text) > _MAX_LENGTH:
        raise ValueError(f"policy {checks.shown(text)} is not well-formed: it has {len(text)} characters")
    # Python's parser raises the last two for nested text.
    with contextlib.suppress(SyntaxError, ValueError, MemoryError, RecursionError):
        match ast.parse(text, mode="eval").body:
            case ast.Call(func=ast.Name(id=name), args=[], keywords=options) if all(option.arg for option in options):
                given = {str(option.arg): ast.literal_eval(option.value) for option in options}
                if len(given) == len(options):
                    return name, given
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
            problem = described(error)
            if isinstance(error, KeyError) and str(error) in map(repr, self._hidden):
                problem += "; the obs_type does not show it: choose another one, or set privileged = True on the policy"
            raise PolicyError(f"policy {checks.shown(self._name)} raised {problem}") from error
        try:
            return self._environment.task.checked_action(action)
        except Exception as error:  # Of `__array__` as well, such as that of a tensor that requires a gradient.
            mode = self._environment.task.mdp.action_mode.name
            where = f"policy {checks.shown(self._name)} returned a bad action in control_mode {mode!r}"
            raise PolicyError(f"{where}: {error}") from error

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
