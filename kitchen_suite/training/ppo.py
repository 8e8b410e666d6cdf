"""Proximal policy optimisation (PPO), in plain PyTorch."""

import copy
import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, cast

import numpy as np
import torch
from gymnasium import spaces
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from kitchen_suite.policies.networks import CLIP
from kitchen_suite.policies.trained import TrainedPolicy
from kitchen_suite.training.hyperparameters import Hyperparameters

# Bounds of adapted learning rates, the factor of an adaptation, and how far beyond the target the divergence must be.
_LEARNING_RATES, _RATE_FACTOR, _TOLERANCE = (1e-6, 1e-2), 1.5, 2.0

_EPSILON = 1e-8  # Added to the standard deviations of advantages and of returns.

# Metrics of a step of the optimiser, in order.
_STEP_METRICS = ("loss/policy loss", "loss/value loss", "loss/entropy loss", "learning/divergence")


class GaussianPolicy(torch.nn.Module):
    """Gaussian policy: the mean is computed by a network, the standard deviations do not depend on the observation.

    Both, and the actions that it deals with, are in units of `scale`, so that an optimiser step has the same effect on
    every element of the action, whether it is an angle or a gripper logit.

    Attributes:
      network: from standardised observations `(n, m)` to the means `(n, k)`.
      log_deviation: `(k,)`, logarithms of the standard deviations.
      scale: `(k,)`, action for network outputs of one.
    """

    scale: torch.Tensor

    def __init__(self, observation_size: int, scale: torch.Tensor, config: Hyperparameters) -> None:
        """Builds the network, with the hidden layers and the exploration of the hyperparameters."""
        super().__init__()
        self.network = build_network([observation_size, *config.hidden, scale.numel()])
        self.log_deviation = torch.nn.Parameter(torch.full(scale.shape, math.log(config.exploration)))
        self.register_buffer("scale", scale)
        last_layer = self.network[-1]
        assert isinstance(last_layer, torch.nn.Linear)
        with torch.no_grad():
            # The first actions are almost pure exploration noise.
            last_layer.weight.mul_(0.01)
            last_layer.bias.zero_()

    def log_densities(self, observations: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
        """Returns the logarithms `(n,)` of the densities of actions `(n, k)`, without the constant of the normal."""
        noise = (actions - self.network(observations)) / self.log_deviation.exp()
        return -0.5 * noise.square().sum(dim=-1) - self.log_deviation.sum()


def build_network(sizes: Sequence[int]) -> torch.nn.Sequential:
    """Returns a multilayer perceptron with ELU units between its linear layers, of the given sizes."""
    layers: list[torch.nn.Module] = []
    for inputs, outputs in itertools.pairwise(sizes):
        layers += [torch.nn.Linear(inputs, outputs), torch.nn.ELU()]
    return torch.nn.Sequential(*layers[:-1])


class RunningScaler(torch.nn.Module):
    """Standardises vectors, element by element.

    The statistics have 64 bits: with 32, millions of samples would leave later ones without effect.

    Attributes:
      running_mean: `(m,)`.
      running_variance: `(m,)`.
      current_count: `()`, number of vectors seen.
      epsilon: added to the standard deviations.
    """

    running_mean: torch.Tensor
    running_variance: torch.Tensor
    current_count: torch.Tensor

    def __init__(self, size: int, epsilon: float) -> None:
        """Begins with mean 0 and variance 1, which count as one vector."""
        super().__init__()
        self.epsilon = epsilon
        self.register_buffer("running_mean", torch.zeros(size, dtype=torch.float64))
        self.register_buffer("running_variance", torch.ones(size, dtype=torch.float64))
        self.register_buffer("current_count", torch.ones((), dtype=torch.float64))

    @torch.no_grad()
    def update(self, vectors: torch.Tensor) -> None:
        """Adds vectors `(n, m)`, two or more, to the statistics."""
        variance, mean = torch.var_mean(vectors.double(), dim=0)
        count, total = vectors.shape[0], self.current_count + vectors.shape[0]
        delta = mean - self.running_mean
        squares = self.running_variance * self.current_count + variance * count
        squares += delta.square() * self.current_count * count / total
        self.running_mean += delta * count / total
        self.running_variance.copy_(squares / total)
        self.current_count.copy_(total)

    def freeze(self) -> None:
        """Fixes the statistics: vectors that are added later change them by nearly nothing."""
        self.current_count.fill_(1e15)

    @property
    def deviation(self) -> torch.Tensor:
        """`(m,)`, divisors of the vectors: standard deviations with the epsilon."""
        return self.running_variance.sqrt() + self.epsilon

    def forward(self, vectors: torch.Tensor) -> torch.Tensor:
        """Returns vectors `(..., m)` standardised, and clipped at `CLIP`."""
        return ((vectors - self.running_mean.float()) / self.deviation.float()).clamp(-CLIP, CLIP)

    def inverse(self, vectors: torch.Tensor) -> torch.Tensor:
        """Returns the vectors `(..., m)` that have been standardised, except for the clipping."""
        return vectors * self.deviation.float() + self.running_mean.float()


class Batch:
    """Control steps of all environments, time first.

    Attributes:
      observations: `(t, n, m)`, before each step.
      actions: `(t, n, k)`, in units of the policy's scale.
      rewards: `(t, n)`, scaled.
      ended: `(t, n)`, whether a step ended an episode.
      truncated: `(t, n)`, whether a step truncated one.
      last_observations: `(t, n, m)`, of the episodes that steps truncated; of other steps they have no meaning.
      next_observations: `(n, m)`, after the last step.
    """

    def __init__(self, steps: int, count: int, observation_size: int, action_size: int) -> None:
        """Allocates the tensors for `steps` of `count` environments."""
        self.observations = torch.empty(steps, count, observation_size)
        self.actions = torch.empty(steps, count, action_size)
        self.rewards = torch.empty(steps, count)
        self.ended, self.truncated = torch.zeros(2, steps, count, dtype=torch.bool)
        self.last_observations = torch.empty_like(self.observations)
        self.next_observations = torch.empty(count, observation_size)


def advantages(
    rewards: torch.Tensor, values: torch.Tensor, ended: torch.Tensor, *, discount: float, gae_lambda: float
) -> torch.Tensor:
    """Returns the generalised advantage estimates `(t, n)` (GAE).

    Rewards are `(t, n)`; where a step truncated an episode, with the discounted value of its last observation. Values
    `(t + 1, n)` are those of the observations before each step, and after the last one. Where `ended` `(t, n)` is true,
    what follows belongs to another episode.
    """
    goes_on = (~ended).float()
    errors = rewards + discount * goes_on * values[1:] - values[:-1]
    estimates, last = torch.empty_like(errors), torch.zeros_like(errors[0])
    for step in reversed(range(len(errors))):
        last = errors[step] + discount * gae_lambda * goes_on[step] * last
        estimates[step] = last
    return estimates


class Samples(NamedTuple):
    """Control steps that the optimiser learns from, one in each of `b` rows.

    Attributes:
      observations: `(b, m)`, standardised.
      actions: `(b, k)`, in units of the policy's scale.
      log_densities: `(b,)`, of the actions, by the policy before the update.
      advantages: `(b,)`, of the actions, standardised.
      values: `(b, 1)`, outputs of the value network before the update.
      returns: `(b, 1)`, estimated, standardised.
    """

    observations: torch.Tensor
    actions: torch.Tensor
    log_densities: torch.Tensor
    advantages: torch.Tensor
    values: torch.Tensor
    returns: torch.Tensor


class Agent:
    """A policy and a value function, and their optimiser.

    Attributes:
      policy: acts on standardised observations.
      average: the policy with weights averaged over updates, which is evaluated and exported.
      value: network of the value function, from standardised observations to standardised returns `(n, 1)`.
      observation_scaler: standardises observations.
      value_scaler: standardises returns.
      optimizer: with a parameter group of each network, that of the policy first.
    """

    def __init__(self, observation_size: int, action_space: spaces.Box, config: Hyperparameters) -> None:
        """Builds networks, scalers and optimiser for flat observations and the actions of one environment."""
        if action_space.shape != (len(config.action_scale),):
            raise ValueError(f"action_scale must have {action_space.shape[0]} numbers, got {config.action_scale}")
        self._config = config
        self.policy = policy = GaussianPolicy(observation_size, torch.tensor(config.action_scale), config)
        self.value = value = build_network([observation_size, *config.hidden, 1])
        self.observation_scaler = RunningScaler(observation_size, config.standardisation_epsilon)
        self.value_scaler = RunningScaler(1, _EPSILON)
        self.average = AveragedModel(policy, multi_avg_fn=get_ema_multi_avg_fn(config.averaging))
        groups = [
            {"params": list(policy.parameters()), "lr": config.learning_rate},
            {"params": list(value.parameters()), "lr": config.value_learning_rate},
        ]
        self.optimizer = torch.optim.Adam(groups, fused=True)

    @property
    def modules(self) -> dict[str, Any]:
        """All that has a state dict, by name."""
        names = ("policy", "average", "value", "observation_scaler", "value_scaler", "optimizer")
        return {name: getattr(self, name) for name in names}

    @property
    def networks(self) -> dict[str, torch.nn.Module]:
        """The networks that learn, by name."""
        return {"policy": self.policy, "value": self.value}

    def restart_average(self) -> None:
        """Makes the averaged policy the present one, after the present one has been changed by other means."""
        self.average.module.load_state_dict(self.policy.state_dict())
        self.average.n_averaged.zero_()

    def update(self, batch: Batch, *, values_only: bool = False) -> dict[str, float]:
        """Learns from a full batch, whose observations are then added to the standardisation; returns metrics by name.

        The learning rate of the value network restarts with each update; both are adapted to the divergence. With
        `values_only` the policy stays as it is, and with it the learning rates: without divergence, they would rise.
        """
        self.optimizer.param_groups[1]["lr"] = self._config.value_learning_rate
        self.policy.requires_grad_(not values_only)
        samples, passes = self.samples(batch), []
        for _ in range(self._config.learning_epochs):
            order = torch.randperm(len(samples.actions))
            size = len(order) // self._config.mini_batches
            shuffled = [tensor[order].split(size) for tensor in samples]
            steps = [self._step(Samples(*part)) for part in zip(*shuffled, strict=True)]
            passes.append(torch.stack(steps).mean(dim=0))
            if self._config.kl_target and not values_only:
                self._adapt(passes[-1][-1].item())
        self.average.update_parameters(self.policy)
        self.observation_scaler.update(batch.observations.flatten(0, 1))
        deviation = (self.policy.log_deviation.detach().exp() * self.policy.scale).mean().item()
        return {
            **dict(zip(_STEP_METRICS, torch.stack(passes).mean(dim=0).tolist(), strict=True)),
            "policy/standard deviation": deviation,
            "learning/learning rate": self.optimizer.param_groups[0]["lr"],
        }

    @torch.no_grad()
    def samples(self, batch: Batch) -> Samples:
        """Returns the samples of a batch, whose returns are added to their statistics."""
        config = self._config
        observations = self.observation_scaler(torch.cat([batch.observations, batch.next_observations[None]]))
        outputs = self.value(observations)
        values = self.value_scaler.inverse(outputs).squeeze(-1)
        rewards = self._bootstrapped(batch)
        estimates = advantages(rewards, values, batch.ended, discount=config.discount, gae_lambda=config.gae_lambda)
        returns = (estimates + values[:-1]).reshape(-1, 1)
        self.value_scaler.update(returns)
        return Samples(
            observations=observations[:-1].flatten(0, 1),
            actions=batch.actions.flatten(0, 1),
            log_densities=self.policy.log_densities(observations[:-1], batch.actions).flatten(),
            advantages=((estimates - estimates.mean()) / (estimates.std() + _EPSILON)).flatten(),
            values=outputs[:-1].flatten(0, 1),
            returns=self.value_scaler(returns),
        )

    def _bootstrapped(self, batch: Batch) -> torch.Tensor:
        """Returns the rewards `(t, n)`; with the discounted value of the last observation where a step truncated."""
        last, rewards = batch.last_observations[batch.truncated], batch.rewards.clone()
        following = self.value_scaler.inverse(self.value(self.observation_scaler(last))).squeeze(-1)
        rewards[batch.truncated] += self._config.discount * following
        return rewards

    def _step(self, samples: Samples) -> torch.Tensor:
        """Makes a step of the optimiser; returns the `_STEP_METRICS`."""
        config, values = self._config, samples.values
        change = self.policy.log_densities(samples.observations, samples.actions) - samples.log_densities
        ratio = change.exp()
        clipped = ratio.clamp(1 - config.ratio_clip, 1 + config.ratio_clip)
        policy_loss = -torch.minimum(samples.advantages * ratio, samples.advantages * clipped).mean()
        predicted = self.value(samples.observations)
        if config.value_clip:
            predicted = values + (predicted - values).clamp(-config.value_clip, config.value_clip)
        value_loss = config.value_scale * torch.nn.functional.mse_loss(predicted, samples.returns)
        # The mean entropy of the elements of an action, without its constant.
        entropy_loss = -config.entropy_scale * self.policy.log_deviation.mean()
        self.optimizer.zero_grad()
        (policy_loss + value_loss + entropy_loss).backward()
        if config.gradient_norm:
            parameters = [*self.policy.parameters(), *self.value.parameters()]
            torch.nn.utils.clip_grad_norm_(parameters, config.gradient_norm)
        self.optimizer.step()
        divergence = (ratio - 1 - change).mean()
        return torch.stack([policy_loss, value_loss, entropy_loss, divergence]).detach()

    def _adapt(self, divergence: float) -> None:
        """Adapts the learning rates to the divergence of a pass over the batch."""
        target, (least, greatest) = self._config.kl_target, _LEARNING_RATES
        for group in self.optimizer.param_groups:
            if divergence > _TOLERANCE * target:
                group["lr"] = max(group["lr"] / _RATE_FACTOR, least)
            elif divergence < target / _TOLERANCE:
                group["lr"] = min(group["lr"] * _RATE_FACTOR, greatest)


class Actor:
    """Explores with a copy of an agent's policy, so that the agent can learn at the same time.

    Exploration noise is a stationary AR(1) process over control steps with a standard normal distribution, `x' = c x +
    sqrt(1 - c^2) w`, `w ~ N(0, 1)`, so that it adds up to motions instead of averaging out; the PPO ratio treats the
    steps as independent. Source of the idea: Hollenstein et al., Colored Noise in PPO, AAAI 2024.
    """

    def __init__(self, agent: Agent, correlation: float, seed: int) -> None:
        """Copies the policy; correlation, in [0, 1), and seed are of the noise."""
        self._agent, self._correlation = agent, correlation
        self._policy, self._scaler = copy.deepcopy(agent.policy), copy.deepcopy(agent.observation_scaler)
        self._generator, self._noise = torch.Generator().manual_seed(seed), torch.empty(0)

    def refresh(self) -> None:
        """Copies the policy as it is now."""
        self._policy.load_state_dict(self._agent.policy.state_dict())
        self._scaler.load_state_dict(self._agent.observation_scaler.state_dict())

    @torch.no_grad()
    def explore(self, observations: torch.Tensor) -> torch.Tensor:
        """Returns actions `(n, k)` with exploration for observations `(n, m)`, in units of the policy's scale."""
        means = self._policy.network(self._scaler(observations))
        noise = torch.randn(means.shape, generator=self._generator)
        # The process restarts if its shape changes.
        if self._noise.shape == means.shape:
            noise = self._correlation * self._noise + math.sqrt(1 - self._correlation**2) * noise
        self._noise = noise
        return means + self._policy.log_deviation.exp() * noise


def export_policy(agent: Agent, metadata: Mapping[str, Any]) -> TrainedPolicy:
    """Returns the agent's present policy, with averaged weights and without exploration, as numpy arrays."""
    scaler, policy = agent.observation_scaler, cast(GaussianPolicy, agent.average.module)
    layers = _linear_layers(policy)
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
def adopt_policy(agent: Agent, policy: TrainedPolicy) -> None:
    """Sets an agent's network to a trained policy's, and fixes its standardisation; values stay untrained."""
    own = export_policy(agent, {})
    if policy.layers != own.layers:
        raise ValueError(f"the policy has layers {policy.layers}, but task and hyperparameters make {own.layers}")
    if not np.array_equal(policy.action_scale, own.action_scale):
        raise ValueError(f"the policy has the action_scale {policy.action_scale}, not {own.action_scale}")
    scaler, least = agent.observation_scaler, policy.deviation.min()
    if least < np.float32(scaler.epsilon):
        raise ValueError(f"standardisation_epsilon must be at most {least}, the policy's least, got {scaler.epsilon}")
    for layer, weight, bias in zip(_linear_layers(agent.policy), policy.weights, policy.biases, strict=True):
        layer.weight.copy_(torch.as_tensor(weight))
        layer.bias.copy_(torch.as_tensor(bias))
    agent.restart_average()
    scaler.running_mean.copy_(torch.as_tensor(policy.mean))
    scaler.running_variance.copy_((torch.as_tensor(policy.deviation) - scaler.epsilon).clamp(min=0.0).square())
    scaler.freeze()


def _linear_layers(policy: GaussianPolicy) -> list[torch.nn.Linear]:
    return [layer for layer in policy.network if isinstance(layer, torch.nn.Linear)]


def _array(tensor: torch.Tensor) -> np.ndarray:
    # A copy: the tensor goes on changing in training.
    return np.array(tensor.detach().numpy(), np.float32)
