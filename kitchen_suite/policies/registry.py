"""What acts: policies by name, and those a user brings along as `module:callable`.

A policy is called with the present `dm_env.TimeStep` and returns the action; `timestep.first()` tells it that an
episode starts.
"""

import ast
import contextlib
import dataclasses
import importlib.util
import pkgutil
import sys
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import dm_env
import numpy as np
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks

Policy = Callable[[dm_env.TimeStep], ArrayLike]

# Makes the policy for one episode, given the environment and a generator of the episode's own.
PolicyBuilder = Callable[..., Policy]

# What the extra `experts` installs.
_EXPERTS_NEED = ("daqp", "mink")


class PolicyError(Exception):
    """A policy raised an exception, or returned what is no action."""


def random(environment: dm_env.Environment, generator: np.random.Generator) -> Policy:
    """Builds a policy of uniform actions; standard normal ones where the action is unbounded."""
    spec = environment.action_spec()
    bounded = np.isfinite(spec.minimum) & np.isfinite(spec.maximum)
    low, high = np.where(bounded, spec.minimum, 0.0), np.where(bounded, spec.maximum, 0.0)

    def policy(timestep: dm_env.TimeStep) -> NDArray[np.float64]:
        del timestep
        return np.where(bounded, generator.uniform(low, high, spec.shape), generator.standard_normal(spec.shape))

    return policy


def zero(environment: dm_env.Environment, generator: np.random.Generator) -> Policy:
    """Builds a policy of zero actions."""
    del generator
    shape = environment.action_spec().shape
    return lambda timestep: np.zeros(shape)


def expert(environment: dm_env.Environment, generator: np.random.Generator, **options: Any) -> Policy:
    """Builds the scripted expert for the environment's task; it needs the extra `experts`.

    Args:
      environment: of the suite.
      generator: what jitter and noise are drawn from.
      **options: attributes of `experts.MotionStyle`, and arguments of `experts.make_policy`.
    """
    from kitchen_suite import experts

    names = [field.name for field in dataclasses.fields(experts.MotionStyle)]
    style = {name: options.pop(name) for name in names if name in options}
    return experts.make_policy(environment, generator, style=experts.MotionStyle(**style), **options)


def trained(environment: dm_env.Environment, generator: np.random.Generator, *, file: str | None = None) -> Policy:
    """Builds a trained policy, which acts without exploration.

    Args:
      environment: of the suite.
      generator: not used.
      file: what `kitchen-train` has written; by default what comes with the package for the environment's task and
        reward.

    Raises:
      OSError: there is no such file, or it holds nothing of the kind.
      ValueError: the policy is for something else, or none comes with the package.
    """
    del generator
    # Needed by this policy alone, and it imports what writes episodes, which imports this module.
    from kitchen_suite.policies import trained as trained_policy

    policy = trained_policy.TrainedPolicy.load(Path(file) if file else trained_policy.shipped(environment.task))
    sizes = [sum(spec.shape[0] for spec in environment.observation_spec().values()), *environment.action_spec().shape]
    policy.check_fits(*sizes)
    return lambda timestep: policy(trained_policy.flat_timestep(timestep))


POLICIES: Mapping[str, PolicyBuilder] = MappingProxyType(
    {"random": random, "zero": zero, "expert": expert, "trained": trained}
)

_TAKE_OPTIONS = (expert, trained)


def find(name: str) -> PolicyBuilder:
    """Returns what builds a policy, whose actions are checked and come as float64.

    Args:
      name: a key of `POLICIES`, with options where it takes any, such as `expert(speed=0.8, jitter=0.02)` or
        `trained(file='policy.npz')`; or `module:callable`, a policy that is the same object in every episode. Modules
        are also looked for in the working directory.

    Raises:
      ImportError: the policy needs an extra that is not installed.
      ValueError: there is no such policy, it cannot be imported, or it cannot be called.
    """
    if ":" in name:
        imported = _imported(name)
        return lambda environment, generator: _checked(imported, name, environment)
    plain, options = _call(name) if name.endswith(")") else (name, {})
    try:
        build = POLICIES[checks.choice(plain, POLICIES.keys(), "policy")]
    except ValueError as error:
        raise ValueError(f"{error}, or name one of your own as module:callable") from error
    if build is expert and (missing := [name for name in _EXPERTS_NEED if not importlib.util.find_spec(name)]):
        raise ImportError(f"policy {name!r} needs {' and '.join(missing)}: pip install 'kitchen-suite[experts]'")
    if options and build not in _TAKE_OPTIONS:
        raise ValueError(f"policy {plain!r} takes no options, got {name!r}; expert and trained do")

    def built(environment: dm_env.Environment, generator: np.random.Generator) -> Policy:
        try:
            policy = build(environment, generator, **options)
        except (OSError, TypeError, ValueError) as error:
            raise PolicyError(f"policy {name!r} cannot be built: {error}") from error
        return _checked(policy, name, environment)

    return built


def _call(text: str) -> tuple[str, dict[str, Any]]:
    """Name and options of a policy written as a call.

    Raises:
      ValueError: it is no call of a name with constants for named options.
    """
    with contextlib.suppress(SyntaxError, ValueError):
        match ast.parse(text, mode="eval").body:
            case ast.Call(func=ast.Name(id=name), args=[], keywords=options) if all(option.arg for option in options):
                return name, {str(option.arg): ast.literal_eval(option.value) for option in options}
    raise ValueError(f"policy {text!r} must be a name, or a name with options such as expert(speed=0.8, jitter=0.02)")


def _imported(name: str) -> Policy:
    # A console script, unlike `python -m`, does not look there; last, so that it hides nothing installed.
    if (here := str(Path.cwd())) not in sys.path:
        sys.path.append(here)
    try:
        policy = pkgutil.resolve_name(name)
    except (Exception, SystemExit) as error:  # Importing runs whatever the module holds.
        raise ValueError(f"policy {name!r} cannot be imported: {type(error).__name__}: {error}") from error
    if not callable(policy):
        raise ValueError(f"policy {name!r} cannot be called: it is {policy!r}")
    return policy


def _checked(policy: Policy, name: str, environment: dm_env.Environment) -> Policy:
    (size,) = environment.action_spec().shape

    def checked(timestep: dm_env.TimeStep) -> NDArray[np.float64]:
        try:
            action = policy(timestep)
        except Exception as error:
            raise PolicyError(f"policy {name!r} raised {type(error).__name__}: {error} ({_place(error)})") from error
        try:
            return checks.vector(action, size, "action").copy()
        except (TypeError, ValueError) as error:
            raise PolicyError(f"policy {name!r} returned a bad action: {error}") from error

    return checked


def _place(error: Exception) -> str:
    """Where an exception was raised."""
    frame = traceback.extract_tb(error.__traceback__)[-1]
    return f"{frame.filename}, line {frame.lineno}"
