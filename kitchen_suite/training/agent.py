"""Builds skrl's PPO agent, and takes the trained policy out of it."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from skrl.agents.torch.ppo import PPO
from skrl.memories.torch import RandomMemory
from skrl.resources.preprocessors.torch import RunningStandardScaler
from skrl.resources.schedulers.torch import KLAdaptiveLR

from kitchen_suite.policies.trained import TrainedPolicy
from kitchen_suite.training.hyperparameters import Hyperparameters
from kitchen_suite.training.networks import DEVICE, Policy, Value

# Bound of standardised observations.
_CLIP = 10.0


def build(observation_size: int, action_space: spaces.Box, choices: Hyperparameters) -> PPO:
    """Builds an agent that learns from batches of `num_envs * rollouts` steps, and is ready to.

    Args:
      observation_size: how many numbers it sees.
      action_space: of one environment.
      choices: what it is tuned by.

    Raises:
      ValueError: these do not fit the action space.
    """
    observation_space = spaces.Box(-np.inf, np.inf, (observation_size,), np.float32)
    models = {
        "policy": Policy(observation_space, action_space, _action_scale(action_space, choices), choices),
        "value": Value(observation_space, action_space, choices.hidden),
    }
    agent = PPO(
        models=models,
        memory=RandomMemory(memory_size=choices.rollouts, num_envs=choices.num_envs, device=DEVICE),
        observation_space=observation_space,
        action_space=action_space,
        device=DEVICE,
        cfg={
            "rollouts": choices.rollouts,
            "learning_epochs": choices.learning_epochs,
            "mini_batches": choices.mini_batches,
            "discount_factor": choices.discount,
            "gae_lambda": choices.gae_lambda,
            "observation_preprocessor": RunningStandardScaler,
            "observation_preprocessor_kwargs": {
                "size": observation_space,
                "epsilon": choices.standardisation_epsilon,
                "clip_threshold": _CLIP,
                "device": DEVICE,
            },
            "value_preprocessor": RunningStandardScaler,
            "value_preprocessor_kwargs": {"size": 1, "device": DEVICE},
            "grad_norm_clip": choices.gradient_norm,
            "ratio_clip": choices.ratio_clip,
            "value_clip": choices.value_clip,
            "value_loss_scale": choices.value_scale,
            "entropy_loss_scale": choices.entropy_scale,
            "time_limit_bootstrap": True,
            "rewards_shaper": lambda rewards, timestep, timesteps: rewards * choices.reward_scale,
            # Curves and checkpoints are not skrl's: its files are not written whole.
            "experiment": {"write_interval": 0, "checkpoint_interval": 0},
        },
    )
    _set_up_optimizer(agent, choices)
    agent.init()
    agent.enable_training_mode(True)
    return agent


def value_group(agent: PPO) -> dict[str, Any]:
    """The optimiser's settings for the value network, its learning rate `lr` among them."""
    return agent.optimizer.param_groups[1]


def _set_up_optimizer(agent: PPO, choices: Hyperparameters) -> None:
    """Replaces skrl's optimiser, which has one learning rate for both networks, and its scheduler."""
    agent.optimizer = torch.optim.Adam(
        [
            {"params": agent.policy.parameters(), "lr": choices.learning_rate},
            {"params": agent.value.parameters(), "lr": choices.value_learning_rate},
        ]
    )
    agent.checkpoint_modules["optimizer"] = agent.optimizer
    if choices.kl_target:
        agent.scheduler = KLAdaptiveLR(agent.optimizer, kl_threshold=choices.kl_target)


def _action_scale(action_space: spaces.Box, choices: Hyperparameters) -> torch.Tensor:
    """Actions `(k,)` for network outputs of one.

    Raises:
      ValueError: there is not one for each action.
    """
    if action_space.shape != (len(choices.action_scale),):
        raise ValueError(f"action_scale must have {action_space.shape[0]} numbers, got {choices.action_scale}")
    return torch.tensor(choices.action_scale)


def export(agent: PPO, metadata: Mapping[str, Any]) -> TrainedPolicy:
    """The policy as it is now, without exploration."""
    scaler, policy = agent.checkpoint_modules["observation_preprocessor"], agent.models["policy"]
    layers = [layer for layer in policy.network if isinstance(layer, torch.nn.Linear)]
    return TrainedPolicy(
        mean=_array(scaler.running_mean),
        deviation=_array(scaler.running_variance.sqrt() + scaler.epsilon),
        clip=scaler.clip_threshold,
        weights=tuple(_array(layer.weight) for layer in layers),
        biases=tuple(_array(layer.bias) for layer in layers),
        action_scale=_array(policy.scale),
        metadata=metadata,
    )


def _array(tensor: torch.Tensor) -> np.ndarray:
    return tensor.detach().cpu().numpy().astype(np.float32)
