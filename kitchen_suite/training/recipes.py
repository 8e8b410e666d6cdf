"""The settings with which `kitchen-train` trains policies in the suite's domains."""

import dataclasses
from collections.abc import Mapping
from typing import Any

from kitchen_suite import suite


@dataclasses.dataclass(frozen=True, kw_only=True)
class Recipe:
    """The defaults of training in a domain, as far as they are not the general ones.

    Attributes:
      hyperparameters: values that replace defaults of `training.hyperparameters.Hyperparameters`.
      cloning_hyperparameters: values that replace these where demonstrations are cloned first.
      options: arguments of the environments that policies are trained in from scratch, which those that they are
        evaluated in do not have; except for `max_episode_steps`, which both have.
      settings: values that replace defaults of `TrainSettings`: of `num_steps`, `eval_interval`, `target_success` and
        `patience`.
    """

    hyperparameters: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    cloning_hyperparameters: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    options: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    settings: Mapping[str, float] = dataclasses.field(default_factory=dict)


def find_recipe(domain_name: str) -> Recipe:
    """Returns the recipe of a domain; one without values where it has none.

    Raises:
      TypeError: the name is no string.
      ValueError: an unknown domain.
    """
    return suite.find_domain(domain_name).resolve("training") or Recipe()


# The doors of microwave and hinge cabinet are closed in half of the episodes of training, and ajar in the others [rad]:
# exploration alone reaches their handles, and does not pull.
_AJAR = {
    "microwave/door": {"choice": (*[0.0] * 6, -0.05, -0.1, -0.15, -0.2, -0.27, -0.35)},
    "hinge_cabinet/doors": {"choice": ((0.0, 0.0),) * 6 + tuple((0.0, q) for q in (0.08, 0.2, 0.35, 0.5, 0.65, 0.8))},
}

KITCHEN = Recipe(
    hyperparameters={
        "num_envs": 64,
        "rollouts": 32,
        "learning_epochs": 5,
        "mini_batches": 4,
        "hidden": (128, 128),
        "learning_rate": 5e-4,
        "value_learning_rate": 5e-4,
        "kl_target": 0.0,
        "discount": 0.98,
        "entropy_scale": 0.0,
        "reward_scale": 10.0,
        "exploration": 0.5,
        "noise_correlation": 0.7,
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
        "discount": 0.995,
        "reward_scale": 1.0,
        "exploration": 0.1,
        "noise_correlation": 0.0,
        "action_scale": (0.5,) * 9,
    },
    options={"max_episode_steps": 100, "reward": "dense_gain", "sleep": True, "variations": _AJAR},
    settings={"num_steps": 4_000_000, "eval_interval": 40_000, "target_success": 0.97, "patience": 1_000_000},
)

OPEN_CABINET = Recipe(
    # Averaged weights: from one update to the next, the success of the policy itself swings by several percent.
    hyperparameters={"averaging": 0.95},
    settings={"eval_interval": 250_000, "target_success": 0.98},
)
