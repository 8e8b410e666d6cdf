"""Hyperparameters of PPO and of behaviour cloning, and the recipe of each domain: its own defaults."""

import dataclasses
from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Any, TypeVar

import numpy as np
from dm_env import specs

from kitchen_suite import checks, files, suite
from kitchen_suite.training.ranges import (
    MAX_STEPS,
    Coefficient,
    Decay,
    Epsilon,
    Factor,
    Fraction,
    InRange,
    Interval,
    LearningRate,
    SamplesOrPasses,
    Size,
    Steps,
    Units,
)

PPO = "ppo"
BC = "bc"
ALGORITHMS = (PPO, BC)

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
      hyperparameters: values that replace defaults of `PPOHyperparameters`.
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
class Schedule(InRange):
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
    eval_interval: Annotated[int, Interval(1, MAX_STEPS)]
    eval_episodes: Annotated[int, Interval(1, checks.MAX_ENVS)]
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
    return Schedule(**{**defaults, **{name: value for name, value in given.items() if value is not None}})


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

OFFSET_SCALE = (*(0.01,) * 7, 2.0)  # Scale of joint offsets [rad] and the gripper logit.

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


Config = TypeVar("Config", bound=InRange)


@dataclasses.dataclass(frozen=True, kw_only=True)
class PPOHyperparameters(InRange):
    """Hyperparameters of PPO and of behaviour cloning before it.

    Policy and value function are multilayer perceptrons with ELU units and the same hidden layers.

    Attributes:
      num_envs: environments stepped together.
      rollouts: control steps of each environment between updates (rollout length).
      learning_epochs: passes over the batch in an update.
      mini_batches: minibatches of each pass.
      hidden: units of each hidden layer; without any, policy and value function are affine.
      learning_rate: initial learning rate of the policy (Adam).
      value_learning_rate: learning rate of the value network (Adam) at the start of each update.
      kl_target: Kullback-Leibler divergence of an update that the learning rates are adapted to; 0 keeps them constant.
      discount: discount factor.
      gae_lambda: lambda of generalised advantage estimation (GAE).
      ratio_clip: clip range of the probability ratio in the surrogate objective.
      value_clip: clip range of the change of a value in an update, in standard deviations of the returns; 0 for none.
      value_scale: coefficient of the value loss.
      entropy_scale: entropy coefficient.
      gradient_norm: maximum norm of the gradient, which is clipped to it; 0 for none.
      averaging: decay of a moving average of the policy's weights, which is evaluated and exported; 0 for none.
      reward_scale: factor of the rewards.
      clone_epochs: passes over the demonstrations in behaviour cloning.
      value_batches: batches after cloning that train the value network alone (value warm-up); 0 for none.
      exploration: initial standard deviation of the actions, in units of `action_scale`.
      noise_correlation: correlation of the exploration noise of successive control steps.
      standardisation_epsilon: added to the standard deviations by which observations are divided.
      action_scale: action for network outputs of one; without any, half the range of the action's elements, or 0.01 rad
        and a gripper logit of 2 in `joint_offset`.
    """

    num_envs: Size = 256
    rollouts: Size = 16
    learning_epochs: SamplesOrPasses = 2
    mini_batches: Size = 4
    hidden: tuple[Units, ...] = (128, 128)
    learning_rate: LearningRate = 1e-3
    value_learning_rate: LearningRate = 1e-3
    kl_target: Coefficient = 0.008
    discount: Annotated[float, Interval(0, 1, open_low=True)] = 0.99
    gae_lambda: Fraction = 0.95
    ratio_clip: Annotated[float, Interval(0, 1, open_low=True)] = 0.2
    value_clip: Coefficient = 0.2
    value_scale: Factor = 1.0
    entropy_scale: Coefficient = 0.001
    gradient_norm: Coefficient = 1.0
    averaging: Decay = 0.0
    reward_scale: Factor = 0.1
    clone_epochs: SamplesOrPasses = 60
    value_batches: Annotated[int, Interval(0, 2**20)] = 10
    exploration: Factor = 1.0
    noise_correlation: Decay = 0.9
    standardisation_epsilon: Epsilon = 0.01
    action_scale: tuple[Factor, ...] = ()

    def __post_init__(self) -> None:
        """Raises a TypeError or a ValueError for values out of range, or that do not go together."""
        super().__post_init__()
        if self.batch_size < 2:
            raise ValueError(f"rollouts must be at least 2 where num_envs is 1, got {self.rollouts}")
        if self.batch_size % self.mini_batches:
            steps = f"{self.batch_size} steps of a batch (num_envs * rollouts)"
            raise ValueError(f"mini_batches {self.mini_batches} must divide the {steps}")

    @property
    def batch_size(self) -> int:
        """Control steps of an update, over all environments."""
        return self.num_envs * self.rollouts

    def for_actions(self, spec: specs.Array) -> "PPOHyperparameters":
        """Returns the hyperparameters with an action scale for a spec; unchanged if they have one."""
        if self.action_scale:
            return self
        bounded = isinstance(spec, specs.BoundedArray)
        half = np.broadcast_to((spec.maximum - spec.minimum) / 2.0, spec.shape) if bounded else np.array(OFFSET_SCALE)
        return dataclasses.replace(self, action_scale=tuple(half.tolist()))

    @classmethod
    def defaults(cls, domain_name: str, *, cloning: bool = False) -> "PPOHyperparameters":
        """Returns the defaults of a domain, from scratch or with demonstrations that are cloned first."""
        recipe = find_recipe(domain_name)
        return cls(**{**recipe.hyperparameters, **(recipe.cloning_hyperparameters if cloning else {})})

    @classmethod
    def for_domain(cls, domain_name: str, changes: Mapping[str, Any], *, cloning: bool = False) -> "PPOHyperparameters":
        """Returns the defaults of a domain, as in `defaults`, with some values changed; see `checked_changes`."""
        return checked_changes(cls.defaults(domain_name, cloning=cloning), changes)


def checked_changes(defaults: Config, changes: Mapping[str, Any]) -> Config:
    """Returns hyperparameters, a dataclass of numbers and tuples of numbers, with changes by name, as read from JSON.

    Raises:
      TypeError: a value has the wrong type.
      ValueError: a name is unknown, or a value is out of range.
    """
    names = [field.name for field in dataclasses.fields(defaults)]
    values = {}
    for name, change in changes.items():
        value = files.json_value(change, checks.choice(name, names, "hyperparameter"))
        values[name] = tuple(value) if isinstance(value, list) else value
    return dataclasses.replace(defaults, **values)


@dataclasses.dataclass(frozen=True, kw_only=True)
class BCHyperparameters(InRange):
    """Hyperparameters of behaviour cloning in chunks of actions.

    The network is residual: blocks with normalisation and SiLU units.

    Attributes:
      width: values between the blocks.
      blocks: number of blocks.
      chunk: number of actions that are predicted at once.
      executed: number of these that are applied before the next prediction.
      batch_size: control steps of a step of the optimiser.
      learning_rate: of the optimiser (AdamW) at first; it falls to 0 like half a cosine.
      weight_decay: of the optimiser.
      averaging: decay of the moving average of the policy's weights, which is evaluated and exported.
      standardisation_epsilon: added to the standard deviations by which inputs are divided.
      input_noise: standard deviation of normal noise on the inputs in training, in units of their standard deviations.
      features: number of features of each camera's picture; from pictures alone, as `shift` and `tint`.
      shift: greatest displacement of pictures in training [pixels].
      tint: greatest change of contrast, and twice that of brightness, of each colour of pictures in training.
    """

    width: Units = 384
    blocks: Annotated[int, Interval(0, 2**10)] = 3
    chunk: Annotated[int, Interval(1, 2**10)] = 8
    executed: Annotated[int, Interval(1, 2**10)] = 1
    batch_size: SamplesOrPasses = 512
    learning_rate: LearningRate = 1e-3
    weight_decay: Coefficient = 1e-4
    averaging: Decay = 0.999
    standardisation_epsilon: Epsilon = 0.01
    input_noise: Coefficient = 0.0
    features: Units = 128
    shift: Annotated[int, Interval(0, 2**10)] = 1
    tint: Fraction = 0.2

    def __post_init__(self) -> None:
        """Raises a TypeError or a ValueError for values out of range, or that do not go together."""
        super().__post_init__()
        if self.executed > self.chunk:
            raise ValueError(f"executed must be at most chunk, {self.chunk}, got {self.executed}")

    @classmethod
    def changed(cls, changes: Mapping[str, Any]) -> "BCHyperparameters":
        """Returns the defaults with some values changed; see `checked_changes`."""
        return checked_changes(cls(), changes)
