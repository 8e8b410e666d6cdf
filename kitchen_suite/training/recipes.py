"""The values that each domain trains with, and the check of all values that a user may change; without PyTorch."""

import dataclasses
import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Any, TypeVar, get_args, get_origin, get_type_hints

import msgspec
from msgspec import Meta

from kitchen_suite import checks, files, suite

PPO = "ppo"
BC = "bc"
ALGORITHMS = (PPO, BC)

# Largest number of steps that is accepted; beyond it a mistake is more likely than a wish.
_MAX_STEPS = 10**12

# Types of numbers with their ranges. The largest float is about that of float32.
Steps = Annotated[int, Meta(ge=0, le=_MAX_STEPS)]
# Sizes are bounded by any machine's memory.
Size = Annotated[int, Meta(ge=1, le=2**16)]
Units = Annotated[int, Meta(ge=1, le=2**14)]
SamplesOrPasses = Annotated[int, Meta(ge=1, le=2**20)]
# One that is too great ends in a message that names it: no limit would be the right one for all networks.
LearningRate = Annotated[float, Meta(gt=0, le=1e38)]
Fraction = Annotated[float, Meta(ge=0, le=1)]
# Of moving averages and processes, which would never move at 1.
Decay = Annotated[float, Meta(ge=0, lt=1)]
# Coefficients and norms, which are off at 0.
Coefficient = Annotated[float, Meta(ge=0, le=1e38)]
# Factors and divisors, whose squares float32 still holds.
Factor = Annotated[float, Meta(ge=1e-6, le=10**6)]
# Added to divisors.
Epsilon = Annotated[float, Meta(ge=1e-8, le=10**6)]

Values = TypeVar("Values")

# Where msgspec found what it refuses, such as `$.hidden[1]`.
_PLACE = re.compile(r" - at `\$\.(\w+)")


def checked(kind: type[Values], given: Mapping[str, Any], what: str) -> Values:
    """Returns a dataclass of numbers and tuples of numbers with given values, as read from JSON, beside its defaults.

    Raises a TypeError or a ValueError, with name, value and range, if a name is unknown or a value out of its range.
    `what` are the values, for the message.
    """
    names = [field.name for field in dataclasses.fields(kind)]  # type: ignore[arg-type]
    values = {name: files.json_value(value, checks.choice(name, names, what)) for name, value in given.items()}
    try:
        return msgspec.convert(values, kind)
    except msgspec.ValidationError as error:
        if not (place := _PLACE.search(str(error))):
            raise ValueError(str(error)) from error
        name = place[1]
        expected = f"in {ranges(kind)[name]}, got {checks.shown(values[name])}"
        raise ValueError(f"{name} must be {expected} ({str(error)[: place.start()]})") from error


def ranges(kind: type) -> dict[str, str]:
    """Returns the range of each number of a dataclass by name, and that of a tuple's numbers, such as `(0, 1]`.

    As mathematics writes them: that one is without 0.
    """
    texts = {}
    for name, hint in get_type_hints(kind, include_extras=True).items():
        number = get_args(hint)[0] if get_origin(hint) is tuple else hint
        bounds: Meta = get_args(number)[1]
        low = f"({_bound(bounds.gt)}" if bounds.gt is not None else f"[{_bound(bounds.ge)}"
        high = f"{_bound(bounds.lt)})" if bounds.lt is not None else f"{_bound(bounds.le)}]"
        texts[name] = f"{low}, {high}"
    return texts


def _bound(number: float | None) -> str:
    """Returns a bound as text, an integer without decimals.

    Equal hints are one object to `typing`, so that `ge=0` may come back as another library's `ge=0.0`.
    """
    assert number is not None
    return str(int(number)) if abs(number) < 1e15 and number == int(number) else str(number)


# When to evaluate and when to stop, by algorithm; for PPO, unless the domain's recipe has others.
SCHEDULES: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {
        PPO: {"num_steps": 49_000_000, "eval_interval": 500_000, "target_success": 0.99, "patience": 8_000_000},
        BC: {"num_steps": 8_000, "eval_interval": 4_000, "target_success": 1.1, "patience": 0},
    }
)
EVAL_EPISODES = 100
MIN_PROGRESS = 0.05


@dataclasses.dataclass(frozen=True, kw_only=True)
class Recipe:
    """The defaults of training in a domain, as far as they are not the general ones.

    Attributes:
      hyperparameters: values that replace defaults of `ppo.PPOHyperparameters`.
      cloning_hyperparameters: values that replace these where demonstrations are cloned first.
      options: arguments of the environments that policies are trained in from scratch, which those that they are
        evaluated in do not have; except for `max_episode_steps`, which both have.
      schedule: values that replace those of the algorithm's `Schedule`.
    """

    hyperparameters: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    cloning_hyperparameters: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    options: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    schedule: Mapping[str, float] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Schedule:
    """When the policy of a seed is evaluated, and when its training stops.

    Steps are control steps over all environments, or steps of the optimiser in behaviour cloning.

    Attributes:
      num_steps: greatest number of steps.
      eval_interval: steps between evaluations and checkpoints.
      eval_episodes: episodes of an evaluation.
      target_success: success rate of two evaluations in a row that ends the training; above 1 for none.
      patience: steps without `min_progress` after which a seed is given up; 0 for never.
      min_progress: mean opening [m], or tasks completed, that is progress.
    """

    num_steps: Steps
    eval_interval: Annotated[int, Meta(ge=1, le=_MAX_STEPS)]
    eval_episodes: Annotated[int, Meta(ge=1, le=checks.MAX_ENVS)]
    target_success: Coefficient
    patience: Steps
    min_progress: Coefficient


def find_recipe(domain_name: str) -> Recipe:
    """Returns the recipe of a domain; one without values where it has none."""
    return suite.find_domain(domain_name).resolve("training") or Recipe()


def find_schedule(domain_name: str, algorithm: str, **given: Any) -> Schedule:
    """Returns the schedule of an algorithm in a domain, with those values that are given and not None."""
    checks.choice(algorithm, ALGORITHMS, "algorithm")
    own = find_recipe(domain_name).schedule if algorithm == PPO else {}
    defaults = {**SCHEDULES[algorithm], "eval_episodes": EVAL_EPISODES, "min_progress": MIN_PROGRESS, **own}
    chosen = {name: value for name, value in given.items() if value is not None}
    return checked(Schedule, {**defaults, **chosen}, "value of the schedule")


# The doors of microwave and hinge cabinet are closed in half of the episodes of training, and ajar in the others [rad]:
# exploration alone reaches their handles, and does not pull.
_AJAR = {
    "microwave/door": {"choice": (*[0.0] * 6, -0.05, -0.1, -0.15, -0.2, -0.27, -0.35)},
    "hinge_cabinet/doors": {"choice": ((0.0, 0.0),) * 6 + tuple((0.0, q) for q in (0.08, 0.2, 0.35, 0.5, 0.65, 0.8))},
}

KITCHEN_RECIPE = Recipe(
    hyperparameters={
        "num_envs": 64,
        "rollouts": 32,
        "learning_epochs": 5,
        "mini_batches": 4,
        "hidden": (128, 128),
        "learning_rate": 5e-4,
        "value_learning_rate": 5e-4,
        "kl_target": 0.03,
        "discount": 0.98,
        "entropy_scale": 0.0,
        "averaging": 0.9,
        "reward_scale": 10.0,
        "exploration": 0.2,
        "noise_correlation": 0.85,
        "standardisation_epsilon": 0.05,
        "action_scale": (1.0,) * 9,
    },
    cloning_hyperparameters={
        "num_envs": 32,
        "rollouts": 140,
        "learning_epochs": 5,
        "hidden": (512, 512),
        "mini_batches": 10,
        "learning_rate": 1e-4,
        "value_learning_rate": 1e-3,
        "kl_target": 0.0,
        "discount": 0.995,
        "averaging": 0.0,
        "reward_scale": 1.0,
        "exploration": 0.1,
        "noise_correlation": 0.0,
        "action_scale": (0.5,) * 9,
    },
    options={"max_episode_steps": 100, "reward": "dense_gain", "physics": "fast", "variations": _AJAR},
    schedule={"num_steps": 4_000_000, "eval_interval": 40_000, "target_success": 0.97, "patience": 1_000_000},
)

OFFSET_SCALE = (*(0.01,) * 7, 2.0)  # Scale of the actions of `joint_offset`: joint offsets [rad], gripper logit.

# Drawers are open by a little in almost half of the episodes of training: exploration alone holds the handle of a
# closed one, and does not pull.
_AJAR_DRAWER = {"choice": (*[0.0] * 7, 0.02, 0.04, 0.06, 0.08, 0.08)}
_AJAR_DRAWERS = {f"cabinet/drawer_{drawer}": _AJAR_DRAWER for drawer in ("top", "bottom")}

OPEN_CABINET_RECIPE = Recipe(
    # Averaged weights: from one update to the next, the success of the policy itself swings by several percent.
    hyperparameters={"averaging": 0.95, "action_scale": OFFSET_SCALE},
    options={"max_episode_steps": 300, "variations": _AJAR_DRAWERS},
    schedule={"eval_interval": 250_000, "target_success": 0.98},
)
