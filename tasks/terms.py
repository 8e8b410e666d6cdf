"""Terms of tasks: named functions that make up observation, reward, termination and success."""

import contextlib
import copy
import dataclasses
import functools
import itertools
import math
import operator
from collections.abc import Callable, Collection, Iterator, Mapping
from types import MappingProxyType
from typing import Any, Generic, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks
from kitchen_suite.tasks.simulation import Simulation
from kitchen_suite.types import Array

# Greatest number of parts in the name of a recorded array, such as the three of `info/reward/approach`.
MAX_NAME_PARTS = 8

# Greatest number of parts in the name of a term: a recording has it as `info/reward/<name>`.
_MAX_PARTS = MAX_NAME_PARTS - 2


State = TypeVar("State")
Step = TypeVar("Step")


class Transition(Generic[State]):
    """A control step of one episode, or of many; what terms of reward, termination and success are functions of.

    An MDP may have a class of its own, which adds quantities that several terms share.

    Attributes:
      before: the MDP's state before the step.
      action: `(..., k)`, the action.
      target: `(..., m)`, targets of the robot's actuators that follow from it, each in its unit.
      after: the MDP's state after the step; it has no terms of the reward yet.
      observations: the task's `extra_observations` after the step, `(..., m)` by name, without noise.
      previous_observations: the same before the step.
    """

    observations: Mapping[str, Array] = MappingProxyType({})
    previous_observations: Mapping[str, Array] = MappingProxyType({})

    def __init__(self, before: State, action: Array, target: Array, after: State) -> None:
        self.before = before
        self.action = action
        self.target = target
        self.after = after

    @functools.cached_property
    def read_only(self) -> Self:
        """The same step in arrays as `read_only` returns them, for functions of a user's own."""
        step = copy.copy(self)
        for name, value in vars(self).items():
            if name in ("before", "action", "target", "after", "observations", "previous_observations"):
                setattr(step, name, read_only(value))
        return step


def read_only(nested: Any) -> Any:
    """Returns nested tuples and dicts of arrays with a view of each array, or a copy, that cannot be written to.

    The views are in C order, in which a sum along the last axis has the same digits in one episode and among many.
    """
    # Plain recursion: dm-tree takes five times as long.
    if isinstance(nested, np.ndarray):
        view = np.asarray(nested, order="C").view()
        view.flags.writeable = False
        return view
    if isinstance(nested, Mapping):
        return MappingProxyType({name: read_only(value) for name, value in nested.items()})
    if isinstance(nested, tuple):
        values = map(read_only, nested)
        return nested._make(values) if hasattr(nested, "_make") else tuple(values)
    return nested


@contextlib.contextmanager
def named_errors(name: str, observations: Collection[str] = ()) -> Iterator[None]:
    """Names a user's function in a ValueError where it writes into what it is given, or reads what is not there.

    Args:
      name: of the function, such as `extra_rewards['lifted']`.
      observations: names of the extra observations of a step.
    """
    try:
        yield
    except KeyError as error:
        raise ValueError(
            f"{name} reads {checks.shown(error.args[0] if error.args else None)}, and there is nothing of that name: "
            f"the extra_observations of a step are {[*observations]}"
        ) from error
    except ValueError as error:
        # NumPy has no error of its own for this.
        if "read-only" not in str(error):
            raise
        raise ValueError(
            f"{name} must not write into the state, the action or observations, which are read-only: {error}; "
            "write into a copy"
        ) from error


RewardTerm = Callable[[Step], Array]
"""A term of a reward: a function that returns `(...)`, given a `Transition`, or what else has the parts that it reads.

`RewardTerm[CompletionStep]` reads no more than a `CompletionStep` has.
"""


Termination = Callable[[Transition], NDArray[np.bool_]]
"""A reason to terminate an episode: a function of a `Transition` that returns bools `(...)`."""


Condition = Callable[[Transition], NDArray[np.bool_]]
"""A condition of success: a function of a `Transition` that returns bools `(...)`."""


def added(task: object, attribute: str) -> dict[str, Any]:
    """Returns the terms by name that a task adds in an attribute: those of the classes that it extends come first.

    A class replaces a term of those that it extends under the same name, and removes one by None.

    Args:
      task: an instance of the class.
      attribute: name of the attribute: a mapping, or a property that returns one, in any of the classes.

    Raises a TypeError or a ValueError, which names the class, for another attribute, another name of a term, or a None
    that removes nothing.
    """
    terms: dict[str, Any] = {}
    owners = [(cls.__name__, vars(cls)) for cls in reversed(type(task).__mro__)]
    for owner, namespace in (*owners, (type(task).__name__, vars(task))):
        own = namespace.get(attribute, {})
        if hasattr(own, "__get__"):
            own = own.__get__(task, type(task))
        if not isinstance(own, Mapping):
            raise TypeError(f"{attribute} of {owner} must be a dict, got {checks.shown(own)}")
        for name, term in own.items():
            _check_name(name, f"{attribute} of {owner}")
            if term is None:
                checks.choice(name, terms, f"term that {attribute} of {owner} removes")
                del terms[name]
            else:
                terms[name] = term
    return terms


def check_recordable(names: Collection[str], what: str) -> None:
    """Raises a ValueError for names of terms under which a recording could not hold their values.

    Args:
      names: of terms of the reward, of terminations, or of conditions of success.
      what: has these names, for messages.
    """
    for name in names:
        _check_name(name, what)
    if taken := sorted(checks.groups(names) & {*names}):
        others = sorted(name for name in names if name.startswith(f"{taken[0]}/"))
        raise ValueError(
            f"{what} must not have both {taken[0]!r} and {others}, since a recording cannot hold an array and a group "
            f"of one name: choose names that do not begin with {taken[0] + '/'!r}"
        )


def _check_name(name: object, what: str) -> None:
    """Raises a ValueError for what is no name of a term."""
    if not (isinstance(name, str) and name.isprintable() and all(name.split("/")) and name.count("/") < _MAX_PARTS):
        raise ValueError(
            f"{what} must have names as keys, of 1 to {_MAX_PARTS} printable parts with slashes between them, got "
            f"{checks.shown(name)}"
        )


def added_functions(task: object, attribute: str) -> dict[str, Callable[[Any], Any]]:
    """Returns terms as `added` does; raises a TypeError also for one that is no function."""
    terms = added(task, attribute)
    for name, term in terms.items():
        if not callable(term):
            owner = type(task).__name__
            raise TypeError(f"{attribute}[{name!r}] of {owner} must be a function, got {checks.shown(term)}")
    return terms


def in_shape(
    terms: Mapping[str, Callable[[Any], Any]], attribute: str, dtype: type
) -> dict[str, Callable[[Transition], NDArray[Any]]]:
    """Returns terms, by name, that return a fresh array `(...)` with an element for each episode of a step.

    A Python number is that of all episodes. Another value of a wrong shape is refused rather than broadcast, since it
    may have been reduced over all episodes of a batch. Arrays are copied, since views would change with the state.

    Args:
      terms: functions of a `Transition`.
      attribute: where the task has them, such as `extra_rewards`, for messages.
      dtype: of the arrays; with bool, the terms must return bools, since a NaN would count as True.

    The terms are given steps in arrays that cannot be written to. They raise a TypeError for what holds no numbers or
    no bools, and a ValueError for another shape, for a write into a step, and for an observation that is missing.
    """
    return {name: _in_shape(term, f"{attribute}[{name!r}]", dtype) for name, term in terms.items()}


def _in_shape(term: Callable[[Any], Any], name: str, dtype: type) -> Callable[[Transition], NDArray[Any]]:
    def value_of(step: Transition) -> NDArray[Any]:
        shape = step.action.shape[:-1]
        with named_errors(name, step.observations):
            value = term(step.read_only)
        array = checks.array_of(value, name)
        if array.dtype.kind not in "biuf":
            raise TypeError(f"{name} must return numbers of the shape {shape}, got {checks.shown(value)}")
        # NumPy's float64 is a float as well, but may be the maximum of a batch.
        is_of_all = type(value) in (bool, int, float)
        if array.shape != shape and not is_of_all:
            raise ValueError(f"{name} must have the shape {shape}, got {array.shape}: reduce along the last axis alone")
        if dtype is bool and array.dtype.kind != "b":
            raise TypeError(f"{name} must return bools, got {checks.shown(value)}: compare it with a number")
        return np.full(shape, value, dtype) if is_of_all else np.array(array, dtype)

    return value_of


def total(terms: Mapping[str, Array]) -> Array:
    """Returns the reward `(...)`, the sum of its terms."""
    return functools.reduce(operator.add, terms.values())


@dataclasses.dataclass(frozen=True)
class Observation:
    """A quantity that is measured after every control step: a term of `MDP.observations`, or of `extra_observations`.

    Attributes:
      read: returns it, `(..., k)`, given the simulation and the MDP's state after the step. The axes `(...)` are those
        of the state's arrays: none for one episode, one for many. It must compute each episode from that alone.
      noise: a corruptor as dm_control has them, which is called with the value `(k,)` of one episode and its
        `random_state`, once a step and once a reset, such as `noises.Additive(distributions.Uniform(-0.01, 0.01))` of
        `dm_control.composer.variation`; None for no noise. Terms of the reward get the value without noise. The MDP's
        own observations have that of `MDP.corrupted` instead.
      enabled: whether agents observe it; terms of the reward get it in any case.
      of_robot: whether it belongs to the robot's part of an observation, such as `agent_pos` in Gymnasium.
      minimum: lower bound of its elements in observation spaces.
      maximum: upper bound of its elements in observation spaces.
    """

    read: Callable[[Simulation, Any], ArrayLike]
    noise: Callable[..., ArrayLike] | None = None
    enabled: bool = True
    of_robot: bool = False
    minimum: float = -math.inf
    maximum: float = math.inf

    def __post_init__(self) -> None:
        """Raises a TypeError or a ValueError for a bad attribute."""
        if not callable(self.read):
            raise TypeError(f"read must be a function of a simulation and a state, got {checks.shown(self.read)}")
        if not (self.noise is None or callable(self.noise)):
            raise TypeError(f"noise must be a corruptor or None, got {checks.shown(self.noise)}")
        checks.boolean(self.enabled, "enabled")
        checks.boolean(self.of_robot, "of_robot")
        if not self.minimum < self.maximum:
            bounds = f"{checks.shown(self.minimum)} and {checks.shown(self.maximum)}"
            raise ValueError(f"minimum must be less than maximum, got {bounds}")


def end_to_end(sizes: Mapping[str, int]) -> Mapping[str, slice]:
    """Returns the places of parts of some sizes, by name, in an array that holds them end to end."""
    stops = itertools.accumulate(sizes.values())
    places = {name: slice(stop - size, stop) for (name, size), stop in zip(sizes.items(), stops, strict=True)}
    return MappingProxyType(places)
