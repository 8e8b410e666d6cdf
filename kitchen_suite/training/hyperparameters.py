"""Hyperparameters of PPO, of imitation and of offline learning, and the recipe of each domain: its own defaults."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any, TypeVar, get_args, get_type_hints

import numpy as np
from dm_env import specs

from kitchen_suite import checks, suite


@dataclasses.dataclass(frozen=True, kw_only=True)
class Recipe:
    """The defaults of training in a domain, as far as they are not the general ones.

    Attributes:
      hyperparameters: values that replace defaults of `Hyperparameters`.
      cloning_hyperparameters: values that replace these where demonstrations are cloned first.
      options: arguments of the environments that policies are trained in from scratch, which those that they are
        evaluated in do not have; except for `max_episode_steps`, which both have.
      settings: values that replace `num_steps`, `eval_interval`, `target_success` and `patience` of `TrainSettings`.
    """

    hyperparameters: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    cloning_hyperparameters: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    options: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    settings: Mapping[str, float] = dataclasses.field(default_factory=dict)


def find_recipe(domain_name: str) -> Recipe:
    """Returns the recipe of a domain; one without values where it has none."""
    return suite.find_domain(domain_name).resolve("training") or Recipe()


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
    settings={"num_steps": 4_000_000, "eval_interval": 40_000, "target_success": 0.97, "patience": 1_000_000},
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
    settings={"eval_interval": 250_000, "target_success": 0.98},
)


Config = TypeVar("Config")

# Hyperparameters that are divided by, or whose logarithm is taken.
_POSITIVE = ("exploration", "standardisation_epsilon")

# Greatest values, of those that have one: of factors, and of sizes beyond any machine's memory.
_MAXIMA = {
    **dict.fromkeys(("batch_size", "clone_epochs"), 2**20),
    **dict.fromkeys(("num_envs", "rollouts", "mini_batches", "candidates"), 2**16),
    **dict.fromkeys(("hidden", "width", "value_width", "features", "codes", "latent"), 2**14),
    **dict.fromkeys(("chunk", "n_step", "blocks", "flow_steps", "codebooks", "shift"), 2**10),
    **dict.fromkeys(("averaging", "discount", "expectile", "target_rate", "gae_lambda"), 1),
}


@dataclasses.dataclass(frozen=True, kw_only=True)
class Hyperparameters:
    """Hyperparameters of PPO and of behaviour cloning before it.

    Policy and value function are multilayer perceptrons with ELU units and the same hidden layers.

    Attributes:
      num_envs: environments stepped together.
      rollouts: control steps of each environment between updates (rollout length).
      learning_epochs: passes over the batch in an update.
      mini_batches: minibatches of each pass.
      hidden: units of each hidden layer.
      learning_rate: initial learning rate of the policy (Adam).
      value_learning_rate: learning rate of the value network (Adam) at the start of each update.
      kl_target: Kullback-Leibler divergence of an update that the learning rates are adapted to; 0 keeps them constant.
      discount: discount factor.
      gae_lambda: lambda of generalised advantage estimation (GAE).
      ratio_clip: clip range of the probability ratio in the surrogate objective.
      value_clip: clip range of the change of a value in an update, in standard deviations of the returns; 0 for none.
      value_scale: coefficient of the value loss.
      entropy_scale: entropy coefficient.
      gradient_norm: maximum norm of the gradient, which is clipped to it.
      averaging: decay of a moving average of the policy's weights, which is evaluated and exported; 0 for none.
      reward_scale: factor of the rewards.
      clone_epochs: passes over the demonstrations in behaviour cloning.
      value_batches: batches after cloning that train the value network alone (value warm-up).
      exploration: initial standard deviation of the actions, in units of `action_scale`.
      noise_correlation: correlation of the exploration noise of successive control steps, in [0, 1).
      standardisation_epsilon: added to the standard deviations by which observations are divided; positive.
      action_scale: action for network outputs of one; without any, half the range of the action's elements, or 0.01 rad
        and a gripper logit of 2 in `joint_offset`.
    """

    num_envs: int = 256
    rollouts: int = 16
    learning_epochs: int = 2
    mini_batches: int = 4
    hidden: tuple[int, ...] = (128, 128)
    learning_rate: float = 1e-3
    value_learning_rate: float = 1e-3
    kl_target: float = 0.008
    discount: float = 0.99
    gae_lambda: float = 0.95
    ratio_clip: float = 0.2
    value_clip: float = 0.2
    value_scale: float = 1.0
    entropy_scale: float = 0.001
    gradient_norm: float = 1.0
    averaging: float = 0.0
    reward_scale: float = 0.1
    clone_epochs: int = 60
    value_batches: int = 10
    exploration: float = 1.0
    noise_correlation: float = 0.9
    standardisation_epsilon: float = 0.01
    action_scale: tuple[float, ...] = ()

    @property
    def batch_size(self) -> int:
        """Control steps of an update, over all environments."""
        return self.num_envs * self.rollouts

    def for_actions(self, spec: specs.Array) -> "Hyperparameters":
        """Returns the hyperparameters with an action scale for a spec; unchanged if they have one."""
        if self.action_scale:
            return self
        bounded = isinstance(spec, specs.BoundedArray)
        half = np.broadcast_to((spec.maximum - spec.minimum) / 2.0, spec.shape) if bounded else np.array(OFFSET_SCALE)
        return dataclasses.replace(self, action_scale=tuple(half.tolist()))

    @classmethod
    def defaults(cls, domain_name: str, *, cloning: bool = False) -> "Hyperparameters":
        """Returns the defaults of a domain, from scratch or with demonstrations that are cloned first."""
        recipe = find_recipe(domain_name)
        return cls(**{**recipe.hyperparameters, **(recipe.cloning_hyperparameters if cloning else {})})

    @classmethod
    def for_domain(cls, domain_name: str, changes: Mapping[str, Any], *, cloning: bool = False) -> "Hyperparameters":
        """Returns the defaults of a domain, as in `defaults`, with some values changed; see `checked_changes`."""
        config = checked_changes(cls.defaults(domain_name, cloning=cloning), changes)
        if config.batch_size % config.mini_batches:
            steps = f"{config.batch_size} steps of a batch (num_envs * rollouts)"
            raise ValueError(f"mini_batches {config.mini_batches} must divide the {steps}")
        if config.noise_correlation >= 1:
            raise ValueError(f"noise_correlation must be below 1, got {config.noise_correlation}")
        return config


def checked_changes(defaults: Config, changes: Mapping[str, Any]) -> Config:
    """Returns hyperparameters, a dataclass of numbers and tuples of numbers, with changes by name, as read from JSON.

    Raises:
      TypeError: a value has the wrong type.
      ValueError: a name is unknown, or a value is out of range.
    """
    hints, values = get_type_hints(type(defaults)), {}
    for name, value in changes.items():
        _check(name, value, hints[checks.choice(name, hints.keys(), "hyperparameter")])
        values[name] = tuple(value) if isinstance(value, list) else value
    return dataclasses.replace(defaults, **values)  # type: ignore[type-var]


def _check(name: str, value: Any, kind: Any) -> None:
    """Raises a TypeError or ValueError for a value, as read from JSON, of another type or out of range."""
    elements = get_args(kind)
    if elements and not (isinstance(value, list) and value):
        raise TypeError(f"{name} must be a list of numbers, got {checks.shown(value)}")
    for number in value if elements else [value]:
        if int in (kind, *elements):
            checks.integer(number, name, minimum=1, maximum=_MAXIMA.get(name))
        else:
            positive = bool(elements) or name in _POSITIVE
            checks.number(number, name, positive=positive, maximum=_MAXIMA.get(name, math.inf))


@dataclasses.dataclass(frozen=True, kw_only=True)
class ChunkHyperparameters:
    """Hyperparameters of all algorithms that learn chunks of actions from recordings.

    Networks are residual: blocks with normalisation and SiLU units.

    Attributes:
      width: values between the blocks.
      blocks: number of blocks.
      chunk: number of actions that are predicted at once.
      executed: number of these that are applied before the next prediction.
      batch_size: control steps of a step of the optimiser.
      learning_rate: of the optimiser (AdamW in imitation, Adam offline) at first; it falls to 0 like half a cosine.
      averaging: decay of the moving average of the policy's weights, which is evaluated and exported.
      standardisation_epsilon: added to the standard deviations by which inputs are divided; positive.
    """

    width: int = 384
    blocks: int = 3
    chunk: int = 8
    executed: int = 1
    batch_size: int = 512
    learning_rate: float = 1e-3
    averaging: float = 0.999
    standardisation_epsilon: float = 0.01


@dataclasses.dataclass(frozen=True, kw_only=True)
class ImitationHyperparameters(ChunkHyperparameters):
    """Hyperparameters of all algorithms of imitation.

    Attributes:
      weight_decay: of the optimiser.
      input_noise: standard deviation of normal noise on the inputs in training, in units of their standard deviations.
      features: number of features of each camera's picture; from pictures alone, as `shift` and `tint`.
      shift: greatest displacement of pictures in training [pixels].
      tint: greatest change of contrast, and twice that of brightness, of each colour of pictures in training.
    """

    weight_decay: float = 1e-4
    input_noise: float = 0.0
    features: int = 128
    shift: int = 1
    tint: float = 0.2


@dataclasses.dataclass(frozen=True, kw_only=True)
class FlowHyperparameters(ImitationHyperparameters):
    """Hyperparameters of flow matching.

    Attributes:
      flow_steps: steps of Euler's method in a prediction.
    """

    executed: int = 4
    flow_steps: int = 8


@dataclasses.dataclass(frozen=True, kw_only=True)
class TokenHyperparameters(ImitationHyperparameters):
    """Hyperparameters of VQ-BeT.

    Attributes:
      codebooks: number of codes of a chunk; each later one is for the residual of the earlier ones.
      codes: number of codes in each codebook.
      latent: length of a code vector.
      quantizer_steps: steps of the optimiser, the first ones, that fit codes and decoder.
      offset_scale: factor of the error of the predicted chunks, beside the likelihood of the codes.
    """

    codebooks: int = 2
    codes: int = 16
    latent: int = 64
    quantizer_steps: int = 1500
    offset_scale: float = 5.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class OfflineHyperparameters(ChunkHyperparameters):
    """Hyperparameters of all algorithms of offline reinforcement learning.

    Attributes:
      n_step: control steps of an n-step return, before the value of the state after them.
      discount: discount factor; of goals also that with which later states are drawn.
    """

    width: int = 256
    blocks: int = 2
    batch_size: int = 256
    n_step: int = 1
    discount: float = 0.99


@dataclasses.dataclass(frozen=True, kw_only=True)
class ValueHyperparameters(OfflineHyperparameters):
    """Hyperparameters of algorithms that learn values.

    A greater network without noise learns the outcome of each recorded episode by heart, and then sees no advantage.

    Attributes:
      value_width: values between the blocks of value networks.
      value_noise: standard deviation of normal noise on the inputs of value networks in training, standardised.
      target_rate: share by which target networks move in a step of the optimiser.
    """

    value_width: int = 64
    value_noise: float = 0.3
    target_rate: float = 0.01


@dataclasses.dataclass(frozen=True, kw_only=True)
class IQLHyperparameters(ValueHyperparameters):
    """Hyperparameters of implicit Q-learning.

    Attributes:
      expectile: of the values of actions that the value function learns.
      temperature: inverse temperature: factor of an action's advantage in the logarithm of its weight.
    """

    n_step: int = 8
    expectile: float = 0.7
    temperature: float = 5.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class IDQLHyperparameters(ValueHyperparameters):
    """Hyperparameters of IDQL.

    Attributes:
      expectile: of the values of actions that the value function learns.
      flow_steps: steps of Euler's method in a prediction.
      candidates: number of chunks that are drawn, of which the most valuable one is taken.
    """

    executed: int = 4
    n_step: int = 30
    expectile: float = 0.7
    flow_steps: int = 8
    candidates: int = 32


@dataclasses.dataclass(frozen=True, kw_only=True)
class TD3BCHyperparameters(ValueHyperparameters):
    """Hyperparameters of TD3+BC.

    Attributes:
      bc_weight: factor of the squared distance from recorded actions, beside values divided by their mean magnitude.
      target_noise: standard deviation of the noise on the actions of the targets, standardised.
      noise_clip: greatest magnitude of this noise.
    """

    n_step: int = 8
    bc_weight: float = 10.0
    target_noise: float = 0.2
    noise_clip: float = 0.5
