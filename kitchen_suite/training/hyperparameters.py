"""What a training run is tuned by, and what suits each domain."""

import dataclasses
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, get_args, get_type_hints

from kitchen_suite import checks

# Those that are divided by, or taken the logarithm of.
_POSITIVE = ("exploration", "standardisation_epsilon")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Hyperparameters:
    """Of PPO, with networks for policy and value of the same hidden layers, ELU units.

    Attributes:
      num_envs: environments that are stepped at once.
      rollouts: control steps of each environment between updates.
      learning_epochs: passes over them in an update.
      mini_batches: parts that each pass is cut into.
      hidden: units of the hidden layers.
      learning_rate: of Adam for the policy, at the start.
      value_learning_rate: of Adam for the values, at the start of each update.
      kl_target: Kullback-Leibler divergence of an update that the learning rate is adapted to; 0 keeps it.
      discount: of later rewards.
      gae_lambda: of generalised advantage estimation.
      ratio_clip: of the surrogate objective.
      value_clip: of the value's change in an update, in units of its standard deviation; 0 for none.
      value_scale: weight of the value's loss.
      entropy_scale: weight of the policy's entropy.
      gradient_norm: greatest norm of a gradient.
      reward_scale: factor of rewards before anything else.
      clone_epochs: passes over demonstrations, where there are any.
      value_batches: batches after them that teach the value alone.
      exploration: standard deviation of the first actions, in units of `action_scale`.
      noise_correlation: of exploration from one control step to the next, in [0, 1).
      standardisation_epsilon: added to the standard deviations that observations are divided by, in their units; above
        0.
      action_scale: action for network outputs of one.
    """

    num_envs: int = 1024
    rollouts: int = 16
    learning_epochs: int = 5
    mini_batches: int = 8
    hidden: tuple[int, ...] = (256, 128, 64)
    learning_rate: float = 3e-4
    value_learning_rate: float = 1e-3
    kl_target: float = 0.008
    discount: float = 0.99
    gae_lambda: float = 0.95
    ratio_clip: float = 0.2
    value_clip: float = 0.2
    value_scale: float = 1.0
    entropy_scale: float = 0.001
    gradient_norm: float = 1.0
    reward_scale: float = 0.1
    clone_epochs: int = 60
    value_batches: int = 10
    exploration: float = 1.0
    noise_correlation: float = 0.9
    standardisation_epsilon: float = 0.05
    action_scale: tuple[float, ...] = (*(0.01,) * 7, 2.0)

    @property
    def batch(self) -> int:
        """Control steps that an update learns from."""
        return self.num_envs * self.rollouts

    @classmethod
    def of(cls, domain_name: str, changes: Mapping[str, Any]) -> "Hyperparameters":
        """Those that suit a domain, with some changed.

        Raises:
          TypeError: a value of the wrong type.
          ValueError: an unknown name, or a value out of range.
        """
        hints = get_type_hints(cls)
        for name, value in changes.items():
            checks.choice(name, hints.keys(), "hyperparameter")
            _check(name, value, hints[name])
        fitting: dict[str, Any] = {name: tuple(value) if name == "hidden" else value for name, value in changes.items()}
        chosen = dataclasses.replace(DEFAULTS[domain_name], **fitting)
        if chosen.batch % chosen.mini_batches:
            raise ValueError(
                f"mini_batches {chosen.mini_batches} must divide the {chosen.batch} steps of a batch "
                "(num_envs * rollouts)"
            )
        if chosen.noise_correlation >= 1:
            raise ValueError(f"noise_correlation must be below 1, got {chosen.noise_correlation}")
        return chosen


def _check(name: str, value: object, kind: Any) -> None:
    """Sees to it that a value is of its kind and not negative.

    Raises:
      TypeError: it is of another kind.
      ValueError: it is negative, or zero where that makes no sense.
    """
    if kind is int:
        checks.integer(value, name, minimum=1)
    elif kind is float:
        checks.number(value, name, positive=name in _POSITIVE)
    elif not isinstance(value, list) or not value:
        raise TypeError(f"{name} must be a list of numbers, got {value!r}")
    else:
        for part in value:
            if get_args(kind)[0] is int:
                checks.integer(part, name, minimum=1)
            else:
                checks.number(part, name, positive=True)


DEFAULTS: Mapping[str, Hyperparameters] = MappingProxyType(
    {
        "open_cabinet": Hyperparameters(),
        "kitchen": Hyperparameters(
            num_envs=32,
            rollouts=140,
            hidden=(512, 512),
            mini_batches=10,
            learning_rate=1e-4,
            kl_target=0.0,
            discount=0.995,
            entropy_scale=0.0,
            reward_scale=1.0,
            exploration=0.1,
            noise_correlation=0.0,
            action_scale=(0.5,) * 9,
        ),
    }
)
