"""The PPO agent: how it is built, and how the trained policy is exported from it."""

from collections.abc import Mapping
from typing import Any, cast

import numpy as np
import torch
from gymnasium import spaces

from kitchen_suite.policies.trained import TrainedPolicy
from kitchen_suite.training.hyperparameters import Hyperparameters
from kitchen_suite.training.networks import Policy, build_network
from kitchen_suite.training.ppo import Agent
from kitchen_suite.training.standardisation import CLIP, RunningScaler

# Added to the standard deviation of returns.
_VALUE_EPSILON = 1e-8


def build_agent(observation_size: int, action_space: spaces.Box, config: Hyperparameters) -> Agent:
    """Returns a new agent.

    Args:
      observation_size: length of the flat observation.
      action_space: of one environment.
      config: the hyperparameters.

    Raises:
      ValueError: the hyperparameter `action_scale` does not fit the action space.
    """
    return Agent(
        Policy(observation_size, _action_scale(action_space, config), config),
        build_network([observation_size, *config.hidden, 1]),
        RunningScaler(observation_size, config.standardisation_epsilon),
        RunningScaler(1, _VALUE_EPSILON),
        config,
    )


def _action_scale(action_space: spaces.Box, config: Hyperparameters) -> torch.Tensor:
    """Returns the action `(k,)` for network outputs of one.

    Raises:
      ValueError: its length is not that of an action.
    """
    if action_space.shape != (len(config.action_scale),):
        raise ValueError(f"action_scale must have {action_space.shape[0]} numbers, got {config.action_scale}")
    return torch.tensor(config.action_scale)


def export_policy(agent: Agent, metadata: Mapping[str, Any]) -> TrainedPolicy:
    """Returns the agent's present policy, with averaged weights and without exploration, as numpy arrays."""
    scaler, policy = agent.observation_scaler, cast(Policy, agent.average.module)
    layers = [layer for layer in policy.network if isinstance(layer, torch.nn.Linear)]
    return TrainedPolicy(
        mean=_array(scaler.running_mean),
        deviation=_array(scaler.deviation),
        clip=CLIP,
        weights=tuple(_array(layer.weight) for layer in layers),
        biases=tuple(_array(layer.bias) for layer in layers),
        action_scale=_array(policy.scale),
        metadata=metadata,
    )


@torch.no_grad()
def load_policy(agent: Agent, policy: TrainedPolicy) -> None:
    """Gives an agent the network of a trained policy, and its standardisation for good; the values are not known.

    Raises:
      ValueError: the networks have other layers, or other units of actions.
    """
    own = export_policy(agent, {})
    if policy.layers != own.layers:
        raise ValueError(f"the policy has layers {policy.layers}, but task and hyperparameters make {own.layers}")
    if not np.array_equal(policy.action_scale, own.action_scale):
        raise ValueError(f"the policy has the action_scale {policy.action_scale}, not {own.action_scale}")
    layers = (layer for layer in agent.policy.network if isinstance(layer, torch.nn.Linear))
    for layer, weight, bias in zip(layers, policy.weights, policy.biases, strict=True):
        layer.weight.copy_(torch.as_tensor(weight))
        layer.bias.copy_(torch.as_tensor(bias))
    agent.restart_average()
    scaler = agent.observation_scaler
    scaler.running_mean.copy_(torch.as_tensor(policy.mean))
    scaler.running_variance.copy_((torch.as_tensor(policy.deviation) - scaler.epsilon).clamp(min=0.0).square())
    scaler.freeze()


def _array(tensor: torch.Tensor) -> np.ndarray:
    # A copy: the tensor goes on changing in training.
    return np.array(tensor.detach().numpy(), np.float32)
