"""Custom policies: what a user gives, and the policy of each episode, whose memory no other episode shares.

A policy with a memory, such as a queue of actions, the state of a recurrent network or past observations, has a method
`reset`, which is called before the first action of each episode. How many episodes are played at once then makes no
difference:

- An object that acts for one time step or observation, `PolicyWithMemory`, is copied for each environment. So is one
  whose method is given, such as `policy.select_action`.
- A factory is called for each environment. It is a class, or a function that can be called without arguments, and
  returns a policy. Where that has no `reset`, the factory is called again for each episode.
- A policy that acts for a batch, `BatchPolicyWithMemory`, keeps one memory for each row itself. A factory of such a
  policy is called once.

Functions and objects without `reset` are the same in all episodes, and should keep nothing from step to step.
"""

import copy
import functools
import inspect
import traceback
import types
from collections.abc import Callable, Hashable
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks
from kitchen_suite.policies.registry import Policy, PolicyError

_FACTORY = "a factory, a class or function without required arguments that returns a policy, such as `lambda: Act(...)`"


class PolicyWithMemory(Protocol):
    """A policy of one episode at a time."""

    def reset(self) -> object:
        """Forgets the last episode, before the first action of the next one."""

    def __call__(self, given: Any, /) -> ArrayLike:
        """Returns the action for a time step or an observation."""


class BatchPolicyWithMemory(Protocol):
    """A policy that acts in many environments at once."""

    def reset(self, rows: NDArray[np.int64], /) -> object:
        """Forgets the last episode of some rows, given by their indices, before the first actions of the next ones.

        The first call has the indices of all rows.
        """

    def __call__(self, observations: Any, /) -> ArrayLike:
        """Returns the actions `(n, ...)` for observations of `n` environments."""


class PolicyMaker:
    """Makes the policy of each episode from what a user gives, for policies of one time step or observation."""

    def __init__(self, given: Callable[..., Any], name: str) -> None:
        """Takes a policy or a factory, with a name for errors.

        Raises a PolicyError if it is a class that needs arguments, or a policy with a memory that cannot be copied or
        whose `reset` needs arguments.
        """
        self._given, self._name = given, name
        self._is_factory = _is_factory(given, name)
        self._by_row: dict[Hashable, Policy] = {}
        # The copy that shows that there can be others acts as well.
        self._spare: Policy | None = None
        if not self._is_factory and _reset_of(given):
            self._spare = self._copy()

    def __call__(self, row: Hashable | None = None) -> Policy:
        """Returns the policy of an episode, which ends the one that was returned for the same row before.

        Without a row, the policy acts in no other episode. Raises a PolicyError if it cannot be made or reset.
        """
        policy = self._by_row.get(row)
        if policy is None:
            policy = self._make()
            if row is not None and _reset_of(policy):
                self._keep(policy, row)
        if reset := _reset_of(policy):
            try:
                reset()
            except (Exception, SystemExit) as error:
                raise PolicyError(f"reset() of {self._name} raised {described(error)}") from error
        return policy

    def _keep(self, policy: Policy, row: Hashable) -> None:
        """Keeps the policy of a row, which no other row has."""
        if any(_owner(policy) is _owner(other) for other in self._by_row.values()):
            raise PolicyError(f"{self._name} returns the same object twice: each episode needs a policy of its own")
        self._by_row[row] = policy

    def _make(self) -> Policy:
        """Returns a policy that acts in no episode yet."""
        if self._is_factory:
            policy = _made(self._given, self._name)
            _check_reset(policy, self._name)
            return policy
        if self._spare is None:
            return self._copy() if _reset_of(self._given) else self._given
        policy, self._spare = self._spare, None
        return policy

    def _copy(self) -> Policy:
        """Returns a copy of a policy with a memory."""
        _check_reset(self._given, self._name)
        needs = f"{self._name} has reset(), so that each environment needs a copy of it"
        try:
            copied = copy.deepcopy(self._given)
        except Exception as error:  # Of any `__deepcopy__` or `__reduce__`.
            problem = checks.shortened(f"{type(error).__name__}: {error}", 500)
            raise PolicyError(f"{needs}, but it cannot be copied: {problem}; give {_FACTORY}") from error
        if _owner(copied) is _owner(self._given):
            raise PolicyError(f"{needs}, but a copy is the same object; give {_FACTORY}")
        return copied


def batch_policy(given: Callable[..., Any], name: str) -> Policy:
    """Returns a policy for a batch, which may be given by a factory.

    Raises a PolicyError if it cannot be made, or has a memory that is not reset by rows.
    """
    policy = _made(given, name) if _is_factory(given, name) else given
    _check_reset_of_rows(policy, name)
    return policy


def check_batch_policy(given: Callable[..., Any], name: str) -> None:
    """Raises a PolicyError as `batch_policy`, as far as it is known before a factory is called."""
    if not _is_factory(given, name):
        _check_reset_of_rows(given, name)


def reset_rows(policy: Policy, rows: NDArray[np.int64], name: str) -> None:
    """Tells a policy for a batch which rows begin an episode, if it has a memory; raises a PolicyError if it fails."""
    reset = _reset_of(policy)
    if reset is None:
        return
    try:
        reset(rows)
    except (Exception, SystemExit) as error:
        raise PolicyError(f"reset(rows) of {name} raised {described(error)}") from error


def described(error: BaseException) -> str:
    """Returns an exception of a policy in words: its kind, its text, and where it was raised."""
    frame = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__}: {error} ({frame.filename}, line {frame.lineno})"


def _is_factory(given: Callable[..., Any], name: str) -> bool:
    """Returns whether what is given returns policies, and not actions.

    A function of any number of arguments, such as the calls of PyTorch's modules, returns actions.
    """
    if isinstance(given, type):
        if not _can_be_called(given):
            raise PolicyError(f"{name} is a class that needs arguments, and no policy; give {_FACTORY}")
        return True
    try:
        parameters = inspect.signature(given).parameters.values()
    except (TypeError, ValueError):  # Of functions in C, some of which have no signature.
        return False
    takes_any = any(parameter.kind == inspect.Parameter.VAR_POSITIONAL for parameter in parameters)
    return not takes_any and _can_be_called(given)


def _can_be_called(function: Callable[..., Any], *arguments: Any) -> bool:
    """Returns whether the signature of a function or a class, if it has one, allows some arguments."""
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):
        return True
    try:
        signature.bind(*arguments)
    except TypeError:
        return False
    return True


def _made(factory: Callable[[], Any], name: str) -> Policy:
    """Returns the policy that a factory returns."""
    try:
        policy = factory()
    except (Exception, SystemExit) as error:
        raise PolicyError(f"the factory {name} raised {described(error)}") from error
    if not callable(policy) or isinstance(policy, type):
        raise PolicyError(
            f"{name} requires no argument, so that it is called without any to make a policy, but it returned "
            f"{checks.shown(policy)}: a policy is called with what it observes, and a factory returns a policy"
        )
    return policy


def _owner(policy: Callable[..., Any]) -> Any:
    """Returns the object whose method a policy is, or the policy itself."""
    while isinstance(policy, functools.partial):
        policy = policy.func
    return policy.__self__ if isinstance(policy, types.MethodType) else policy


def _reset_of(policy: Callable[..., Any]) -> Callable[..., object] | None:
    """Returns the method `reset` of a policy, or of the object whose method it is; None without one."""
    owner = _owner(policy)
    reset = None if isinstance(owner, type) else getattr(owner, "reset", None)
    return reset if callable(reset) else None


def _check_reset(policy: Policy, name: str) -> None:
    """Raises a PolicyError unless `reset` of a policy of one observation can be called without arguments."""
    reset = _reset_of(policy)
    if reset and not _can_be_called(reset):
        raise PolicyError(
            f"reset() of {name} needs arguments, {inspect.signature(reset)}, but is called without any; reset(rows) is "
            "for takes='batch'"
        )


def _check_reset_of_rows(policy: Policy, name: str) -> None:
    """Raises a PolicyError unless `reset` of a policy for a batch can be called with rows."""
    reset = _reset_of(policy)
    if reset and not _can_be_called(reset, np.arange(1)):
        raise PolicyError(
            f"{name} has a reset() that takes no rows, so that episodes which begin at different times would share "
            "their memory: write reset(rows), which is called with the indices of the rows that begin an episode, or "
            "give a policy of one observation, takes='observation'"
        )
