"""skrl's PPO agent: how it is built, and how the trained policy is exported from it."""

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


def build_agent(observation_size: int, action_space: spaces.Box, config: Hyperparameters) -> PPO:
    """Returns a new agent in training mode, which updates its networks after every `num_envs * rollouts` steps.

    Args:
      observation_size: length of the flat observation.
      action_space: of one environment.
      config: the hyperparameters.

    Raises:
      ValueError: the hyperparameter `action_scale` does not fit the action space.
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
        cfg=ppo_config(config, observation_space),
    )
    _set_up_optimizer(agent, config)
    agent.init()
    agent.enable_training_mode(True)
    return agent


def ppo_config(config: Hyperparameters, observation_space: spaces.Box) -> dict[str, Any]:
    """Returns skrl's configuration of PPO for our hyperparameters."""
    return {
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
        # We write curves and checkpoints ourselves: skrl's files may be left incomplete.
        "experiment": {"write_interval": 0, "checkpoint_interval": 0},
    }


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


def value_group(agent: PPO) -> dict[str, Any]:
    """Returns the optimiser's parameter group of the value network; `lr` is its learning rate."""
    return agent.optimizer.param_groups[1]


def _action_scale(action_space: spaces.Box, config: Hyperparameters) -> torch.Tensor:
    """Returns the action `(k,)` for network outputs of one.

    Raises:
      ValueError: its length is not that of an action.
    """
    if action_space.shape != (len(config.action_scale),):
        raise ValueError(f"action_scale must have {action_space.shape[0]} numbers, got {config.action_scale}")
    return torch.tensor(config.action_scale)


def export_policy(agent: PPO, metadata: Mapping[str, Any]) -> TrainedPolicy:
    """Returns the agent's present policy, without exploration, as numpy arrays."""
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
