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


def build(observation_size: int, action_space: spaces.Box, config: Hyperparameters) -> PPO:
    """Builds an agent that learns from batches of `num_envs * rollouts` steps, and is ready to.

    Args:
      observation_size: how many numbers it sees.
      action_space: of one environment.
      config: what it is tuned by.

    Raises:
      ValueError: these do not fit the action space.
    """
    observation_space = spaces.Box(-np.inf, np.inf, (observation_size,), np.float32)
    models = {
        "policy": Policy(observation_space, action_space, _action_scale(action_space, config), config),
        "value": Value(observation_space, action_space, config.hidden),
    }
    agent = PPO(
        models=models,
        memory=RandomMemory(memory_size=config.rollouts, num_envs=config.num_envs, device=DEVICE),
        observation_space=observation_space,
        action_space=action_space,
        device=DEVICE,
        cfg={
            "rollouts": config.rollouts,
            "learning_epochs": config.learning_epochs,
            "mini_batches": config.mini_batches,
            "discount_factor": config.discount,
            "gae_lambda": config.gae_lambda,
            "observation_preprocessor": RunningStandardScaler,
            "observation_preprocessor_kwargs": {
                "size": observation_space,
                "epsilon": config.standardisation_epsilon,
                "clip_threshold": _CLIP,
                "device": DEVICE,
            },
            "value_preprocessor": RunningStandardScaler,
            "value_preprocessor_kwargs": {"size": 1, "device": DEVICE},
            "grad_norm_clip": config.gradient_norm,
            "ratio_clip": config.ratio_clip,
            "value_clip": config.value_clip,
            "value_loss_scale": config.value_scale,
            "entropy_loss_scale": config.entropy_scale,
            "time_limit_bootstrap": True,
            "rewards_shaper": lambda rewards, timestep, timesteps: rewards * config.reward_scale,
            # Curves and checkpoints are not skrl's: its files are not written whole.
            "experiment": {"write_interval": 0, "checkpoint_interval": 0},
        },
    )
    _set_up_optimizer(agent, config)
    agent.init()
    agent.enable_training_mode(True)
    return agent


def value_group(agent: PPO) -> dict[str, Any]:
    """The optimiser's settings for the value network, its learning rate `lr` among them."""
    return agent.optimizer.param_groups[1]


def _set_up_optimizer(agent: PPO, config: Hyperparameters) -> None:
    """Replaces skrl's optimiser, which has one learning rate for both networks, and its scheduler."""
    agent.optimizer = torch.optim.Adam(
        [
            {"params": agent.policy.parameters(), "lr": config.learning_rate},
            {"params": agent.value.parameters(), "lr": config.value_learning_rate},
        ]
    )
    agent.checkpoint_modules["optimizer"] = agent.optimizer
    if config.kl_target:
        agent.scheduler = KLAdaptiveLR(agent.optimizer, kl_threshold=config.kl_target)


def _action_scale(action_space: spaces.Box, config: Hyperparameters) -> torch.Tensor:
    """Actions `(k,)` for network outputs of one.

    Raises:
      ValueError: there is not one for each action.
    """
    if action_space.shape != (len(config.action_scale),):
        raise ValueError(f"action_scale must have {action_space.shape[0]} numbers, got {config.action_scale}")
    return torch.tensor(config.action_scale)


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
