"""Proximal policy optimisation (PPO) on many environments at once, from scratch, a clone or a trained policy.

From top to bottom: the hyperparameters; the networks; a batch of control steps and how the agent learns from it;
exploration; which tasks are drawn; cloning before the first step; the learner, which collects batches; and a run, with
its arguments and its loop. `run.py` has the evaluations and the files of a run.
"""

import collections
import concurrent.futures
import contextlib
import copy
import dataclasses
import functools
import itertools
import math
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, NamedTuple, Self, cast

import numpy as np
import torch
from dm_env import specs
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from msgspec import Meta
from numpy.typing import NDArray
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn
from tqdm import tqdm

from kitchen_suite import checks, files, suite
from kitchen_suite.episodes.play import BatchStep, Controller
from kitchen_suite.episodes.spec import EnvironmentSpec
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.policies import load_policy
from kitchen_suite.policies.chunks import ChunkMetadata, ChunkPolicy
from kitchen_suite.policies.networks import CLIP
from kitchen_suite.policies.perceptron import PerceptronPolicy
from kitchen_suite.tasks.requests import Requests
from kitchen_suite.tasks.task import SuiteTask
from kitchen_suite.training.bc import Network, as_numpy, residual_network
from kitchen_suite.training.demonstrations import OBSERVATION_OPTIONS, check_observed, check_same, load_to_clone
from kitchen_suite.training.recipes import (
    OFFSET_SCALE,
    PPO,
    Coefficient,
    Decay,
    Epsilon,
    Factor,
    Fraction,
    LearningRate,
    SamplesOrPasses,
    Schedule,
    Size,
    Units,
    checked,
    find_recipe,
)
from kitchen_suite.training.run import (
    POLICY_FILE,
    Learner,
    RunDescription,
    digest_of,
    episode_metrics,
    evaluation_environments,
    one_thread,
    seed_runs,
)
from kitchen_suite.vector_env.base import SuiteVectorEnv

_LEARNING_RATES = (1e-6, 1e-2)  # Bounds of adapted learning rates.
_RATE_FACTOR = 1.5  # Factor of an adaptation of the learning rates.
_TOLERANCE = 2.0  # Factor between divergence and target beyond which learning rates are adapted.

_EPSILON = 1e-8  # Added to the standard deviations of advantages and of returns.

# Metrics of a step of the optimiser, in order.
_STEP_METRICS = ("loss/policy loss", "loss/value loss", "loss/entropy loss", "learning/divergence")

_LEAST_WEIGHT = 0.05  # Weight of a task that always succeeds; that of one that never does is greater by 1.
_MEMORY = 50  # Number of episodes of a task over which its success is averaged.

# Bound of cloned actions, in units of the action scale. Beyond it, servos and gripper are saturated, and the
# squared error of a few large actions would dominate the loss.
_ACTION_LIMIT = 5.0

_CLONE_BATCH_SIZE = 512  # Minibatch size of cloning.
_CLONE_LEARNING_RATE = 1e-3  # Initial learning rate of cloning (AdamW); it falls to 0 like half a cosine.
_CLONE_WEIGHT_DECAY = 1e-4  # Weight decay of cloning.


@dataclasses.dataclass(frozen=True, kw_only=True)
class PPOHyperparameters:
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
    discount: Annotated[float, Meta(gt=0, le=1)] = 0.99
    gae_lambda: Fraction = 0.95
    ratio_clip: Annotated[float, Meta(gt=0, le=1)] = 0.2
    value_clip: Coefficient = 0.2
    value_scale: Factor = 1.0
    entropy_scale: Coefficient = 0.001
    gradient_norm: Coefficient = 1.0
    averaging: Decay = 0.0
    reward_scale: Factor = 0.1
    clone_epochs: SamplesOrPasses = 60
    value_batches: Annotated[int, Meta(ge=0, le=2**20)] = 10
    exploration: Factor = 1.0
    noise_correlation: Decay = 0.9
    standardisation_epsilon: Epsilon = 0.01
    action_scale: tuple[Factor, ...] = ()

    def __post_init__(self) -> None:
        """Raises a ValueError for values that do not go together."""
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
    def for_domain(
        cls, domain_name: str, changes: Mapping[str, Any] = MappingProxyType({}), *, cloning: bool = False
    ) -> "PPOHyperparameters":
        """Returns the defaults of a domain with some values changed; raises as `recipes.checked`.

        With `cloning` they are those of a policy that was, or is to be, cloned from demonstrations first.
        """
        recipe = find_recipe(domain_name)
        defaults = {**recipe.hyperparameters, **(recipe.cloning_hyperparameters if cloning else {})}
        return checked(cls, {**defaults, **changes}, "hyperparameter")


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

    def __init__(self, network: torch.nn.Module, scale: torch.Tensor, exploration: float) -> None:
        """Takes the network; `exploration` is the initial standard deviation."""
        super().__init__()
        self.network = network
        self.log_deviation = torch.nn.Parameter(torch.full(scale.shape, math.log(exploration)))
        self.register_buffer("scale", scale)

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


def build_policy_network(sizes: Sequence[int]) -> torch.nn.Sequential:
    """Returns a network as `build_network`, whose first actions are almost pure exploration noise."""
    network = build_network(sizes)
    last_layer = network[-1]
    assert isinstance(last_layer, torch.nn.Linear)
    with torch.no_grad():
        last_layer.weight.mul_(0.01)
        last_layer.bias.zero_()
    return network


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
        """Adds vectors `(n, m)` to the statistics; one alone has the variance 0."""
        count = vectors.shape[0]
        variance, mean = torch.var_mean(vectors.double(), dim=0, correction=min(1, count - 1))
        total = self.current_count + count
        delta = mean - self.running_mean
        squares = self.running_variance * self.current_count + variance * count
        squares += delta.square() * self.current_count * count / total
        self.running_mean += delta * count / total
        self.running_variance.copy_(squares / total)
        self.current_count.copy_(total)

    def freeze(self) -> None:
        """Fixes the statistics: vectors that are added later change them by nearly nothing."""
        self.current_count.fill_(1e15)

    def adopt(self, mean: NDArray[np.float32], deviation: NDArray[np.float32]) -> None:
        """Fixes means and divisors `(m,)` of the vectors, where the least divisor bounds the epsilon."""
        self.epsilon = min(self.epsilon, float(deviation.min()))
        self.running_mean.copy_(torch.as_tensor(mean))
        self.running_variance.copy_((torch.as_tensor(deviation) - self.epsilon).clamp(min=0.0).square())
        self.freeze()

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
    estimates = torch.empty_like(errors)
    last = torch.zeros_like(errors[0])
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

    def __init__(
        self,
        observation_size: int,
        action_space: spaces.Box,
        config: PPOHyperparameters,
        network: torch.nn.Module | None = None,
    ) -> None:
        """Builds networks, scalers and optimiser for flat observations and the actions of one environment.

        The network of the policy is new unless it is given.
        """
        if action_space.shape != (len(config.action_scale),):
            raise ValueError(f"action_scale must have {action_space.shape[0]} numbers, got {config.action_scale}")
        self._config = config
        if network is None:
            network = build_policy_network([observation_size, *config.hidden, len(config.action_scale)])
        self.policy = policy = GaussianPolicy(network, torch.tensor(config.action_scale), config.exploration)
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
        samples = self.samples(batch)
        passes = []
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
        # The outputs are in the scale of the batches before, and the returns that they are to be in that with this one.
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
        last = batch.last_observations[batch.truncated]
        rewards = batch.rewards.clone()
        following = self.value_scaler.inverse(self.value(self.observation_scaler(last))).squeeze(-1)
        rewards[batch.truncated] += self._config.discount * following
        return rewards

    def _step(self, samples: Samples) -> torch.Tensor:
        """Makes a step of the optimiser; returns the `_STEP_METRICS`."""
        config = self._config
        values = samples.values
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
        target = self._config.kl_target
        least, greatest = _LEARNING_RATES
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
        self._agent = agent
        self._correlation = correlation
        self._policy = copy.deepcopy(agent.policy)
        self._scaler = copy.deepcopy(agent.observation_scaler)
        self._generator = torch.Generator().manual_seed(seed)
        self._noise = torch.empty(0)

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


def export_policy(agent: Agent, metadata: Mapping[str, Any]) -> PerceptronPolicy:
    """Returns the agent's present policy, with averaged weights and without exploration, as numpy arrays."""
    policy = cast(GaussianPolicy, agent.average.module)
    layers = [layer for layer in cast(torch.nn.Sequential, policy.network) if isinstance(layer, torch.nn.Linear)]
    return PerceptronPolicy(
        mean=as_numpy(agent.observation_scaler.running_mean),
        deviation=as_numpy(agent.observation_scaler.deviation),
        clip=CLIP,
        weights=tuple(as_numpy(layer.weight) for layer in layers),
        biases=tuple(as_numpy(layer.bias) for layer in layers),
        action_scale=as_numpy(policy.scale),
        metadata=metadata,
    )


def export_clone(agent: Agent, initial: ChunkPolicy, metadata: Mapping[str, Any]) -> ChunkPolicy:
    """Returns the agent's present policy as `export_policy`, in the form of the clone that it started from."""
    policy = cast(GaussianPolicy, agent.average.module)
    scale = as_numpy(policy.scale)
    scales = initial.scales._replace(action_mean=np.zeros_like(scale), action_deviation=scale)
    names = ("algorithm", *(field.name for field in dataclasses.fields(ChunkMetadata)))
    own = {name: initial.metadata[name] for name in names if name in initial.metadata}
    return ChunkPolicy(scales=scales, network=residual_network(policy.network), metadata={**metadata, **own})


class TaskBalance:
    """Sets the weights with which tasks are drawn: 1.05 minus their recent success, `success` `(n,)` in their order."""

    def __init__(self, requests: Requests) -> None:
        """Starts without success of the tasks that the requests of the task that starts the episodes draw from."""
        self._requests = requests
        self._names = requests.drawn_tasks
        self.success = np.zeros(len(self._names))

    @classmethod
    def of(cls, task: SuiteTask) -> Self | None:
        """Returns the balance of a task; None if it does not draw tasks."""
        return cls(task.requests) if task.requests.drawn_tasks else None

    def add(self, infos: Mapping[str, Any], ended: NDArray[np.bool_]) -> dict[str, NDArray]:
        """Adds the `ended` ones `(n,)` of episodes, given last infos; returns successes of requested tasks by curve."""
        requested = infos["requested_tasks_mask"]
        completed = infos["episode_task_completions_mask"]
        # A task that is requested in turn counts only if it was attempted.
        requested = infos.get("attempted_tasks_mask", requested)
        for i in np.flatnonzero(ended).tolist():
            self.success += np.where(requested[i], completed[i] - self.success, 0.0) / _MEMORY
        self._set_weights()
        each = {name: completed[ended & requested[:, column], column] for column, name in enumerate(self._names)}
        return {f"episode/success/{name}": done.astype(np.float64) for name, done in each.items() if done.size}

    def state_dict(self) -> dict[str, torch.Tensor]:
        return {"success": torch.as_tensor(self.success)}

    def load_state_dict(self, state: Mapping[str, torch.Tensor]) -> None:
        """Restores the success of an interrupted run, and with it the weights."""
        self.success[:] = state["success"].numpy()
        self._set_weights()

    def _set_weights(self) -> None:
        self._requests.weights = 1.0 + _LEAST_WEIGHT - self.success


InitialPolicy = PerceptronPolicy | ChunkPolicy


def network_of(policy: InitialPolicy) -> torch.nn.Module:
    """Returns the network of a policy, whose outputs are in units of its action scale."""
    if isinstance(policy, ChunkPolicy):
        residual = Network.of(policy.network)
        with torch.no_grad():
            residual.output.bias += torch.as_tensor(policy.scales.action_mean / policy.scales.action_deviation)
        return residual
    perceptron = build_network(policy.layers)
    arrays = [array for layer in zip(policy.weights, policy.biases, strict=True) for array in layer]
    with torch.no_grad():
        for parameter, array in zip(perceptron.parameters(), arrays, strict=True):
            parameter.copy_(torch.as_tensor(array))
    return perceptron


def clone(agent: Agent, observations: NDArray, actions: NDArray, epochs: int) -> list[float]:
    """Fits the mean of a new agent's policy to observations `(m, n)` and actions `(m, k)`, by least squares.

    The demonstrations also fix the standardisation of observations. Returns the mean loss of each pass over them, in
    squared units of the action scale.
    """
    policy = agent.policy
    scaler = agent.observation_scaler
    inputs = torch.as_tensor(observations)
    scaler.update(inputs)
    # Every PPO update adds to the statistics, which would change what the cloned policy sees.
    scaler.freeze()
    inputs = scaler(inputs)
    targets = (torch.as_tensor(actions) / policy.scale).clamp(-_ACTION_LIMIT, _ACTION_LIMIT)
    optimizer = torch.optim.AdamW(
        policy.network.parameters(), lr=_CLONE_LEARNING_RATE, weight_decay=_CLONE_WEIGHT_DECAY
    )
    num_batches = -(-len(targets) // _CLONE_BATCH_SIZE)
    scheduler = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, epochs * num_batches)
    means = []
    for _ in tqdm(range(epochs), desc="cloning", unit="epoch", disable=None, leave=False):
        losses = []
        for batch in torch.randperm(len(targets)).split(_CLONE_BATCH_SIZE):
            loss = torch.nn.functional.mse_loss(policy.network(inputs[batch]), targets[batch])
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            scheduler.step()
            losses.append(loss.item())
        means.append(float(np.mean(losses)))
    agent.restart_average()
    return means


def _step_metrics(infos: Mapping[str, Any]) -> dict[str, NDArray]:
    """Returns the reward terms `(n,)` of a step, not of the reset after it; none if the task's reward has no terms."""
    ended = infos.get("_final_info", False)
    final_info = infos.get("final_info", infos)
    terms = [name for name in infos if name.startswith("reward/")]
    return {f"step/{name}": np.where(ended, final_info[name], infos[name]) for name in terms}


class NetworkController:
    """Acts by a policy of PPO in all environments at once."""

    is_batched = True

    labels: Mapping[str, NDArray] = MappingProxyType({})

    def __init__(self, policy: InitialPolicy, environments: SuiteVectorEnv) -> None:
        """Takes a policy and the environments that it acts in."""
        self._policy = policy
        self._task: SuiteTask = environments.composer_task

    def start(self, i: int, seed: int, options: Mapping[str, Any]) -> None:
        """Does nothing: a network has no state of an episode."""

    def act(self, step: BatchStep) -> NDArray:
        return self._policy(self._policy.inputs(step.observations, self._task))


class PPOLearner(Learner):
    """A PPO agent, the environments that it learns from, and the batch of control steps that is learned from next.

    While the agent learns from a batch, the next one is collected with the policy as it was before that update.
    """

    title = "PPO"
    unit = "control steps"

    _actor: Actor  # From `start` on, as the last observations.
    _observations: torch.Tensor

    def __init__(
        self,
        environments: SuiteVectorEnv,
        config: PPOHyperparameters,
        seed: int,
        initial_policy: InitialPolicy | None = None,
    ) -> None:
        """Builds the agent of `num_envs` environments of autoreset mode `SameStep`; the seed is also of exploration.

        With an initial policy, the next `value_batches` batches train the value network alone.
        """
        torch.manual_seed(seed)
        self.environments = environments
        self.config = config
        self._task: SuiteTask = environments.composer_task
        action_space = environments.single_action_space
        assert isinstance(action_space, spaces.Box)
        # Whether the standardisation of observations has been fitted.
        self._standardised = initial_policy is not None
        self._clone = initial_policy if isinstance(initial_policy, ChunkPolicy) else None
        if initial_policy:
            self._inputs = functools.partial(initial_policy.inputs, task=self._task)
            size = initial_policy.mean.size
            self.agent = Agent(size, action_space, config, network_of(initial_policy))
            self.agent.observation_scaler.adopt(initial_policy.mean, initial_policy.deviation)
            self.warmup_batches = config.value_batches
        else:
            self._inputs = self._task.policy_inputs.flatten
            size = spaces.flatdim(environments.single_observation_space)
            self.agent = Agent(size, action_space, config)
        sizes = config.rollouts, config.num_envs, size, len(config.action_scale)
        self.batch = Batch(*sizes)
        self._next_batch = Batch(*sizes)
        # Metrics of the batch that is learned from next; None before the first one.
        self._collected: dict[str, float] | None = None
        self._updates = concurrent.futures.ThreadPoolExecutor(1)
        self._balance = TaskBalance.of(self._task)

    @property
    def modules(self) -> Mapping[str, Any]:
        return self.agent.modules | ({"balance": self._balance} if self._balance else {})

    def imitate(self, observations: NDArray, actions: NDArray) -> list[float]:
        """Clones demonstrations, as `clone`; the next `value_batches` batches then train the value network alone."""
        losses = clone(self.agent, observations, actions, self.config.clone_epochs)
        self._standardised = True
        self.warmup_batches = self.config.value_batches
        return losses

    def start(self, seed: int) -> None:
        """Starts episodes at evenly spread times, so that a batch has steps from all parts of an episode.

        Environments have seeds from `seed` on. Observations made meanwhile fit the standardisation, unless it is set.
        """
        self._collected = None
        self._actor = Actor(self.agent, self.config.noise_correlation, seed)
        environments = self.environments
        count = environments.num_envs
        # Rewards may depend on the steps made before an interruption.
        environments.reset_statistics(total_steps=self.steps // count)
        observations, _ = environments.reset(seed=seed)
        self._observations = self._tensor(observations)
        length = environments.template_env.max_episode_steps
        assert length, "the spec has the domain's where none is asked for"
        start_steps = np.random.default_rng(seed).permutation(count) * length // count
        for step in range(length):
            observations, *_ = environments.step(self._applied(self._actor.explore(self._observations)))
            if (starting := start_steps == step).any():
                observations, _ = environments.reset(options={"reset_mask": starting})
            self._observations = self._tensor(observations)
            if not self._standardised:
                self.agent.observation_scaler.update(self._observations)
        self._standardised = True

    def export(self, metadata: Mapping[str, Any]) -> InitialPolicy:
        if self._clone:
            return export_clone(self.agent, self._clone, metadata)
        return export_policy(self.agent, metadata)

    def controller(self, policy: InitialPolicy, environments: SuiteVectorEnv) -> Controller:
        return NetworkController(policy, environments)

    def load_state(self, state: Mapping[str, Any]) -> None:
        super().load_state(state)
        self._standardised = True

    def learn(self) -> dict[str, float]:
        """Updates the networks with a batch and collects the next one at the same time.

        The first `value_batches` batches after cloning, or from a trained policy, train the value network alone (value
        warm-up): an untrained one would spoil the policy. Returns means by name: of the metrics of steps, of episodes
        that ended, and of the agent's own. A DivergedError means too high a learning rate, or too large rewards.
        """
        self._actor.refresh()
        if self._collected is None:
            self._collected = self._collect(self.batch)
        update = self._updates.submit(self._update)
        following = self._collect(self._next_batch)
        means = self._collected | update.result()
        self._collected, self.batch, self._next_batch = following, self._next_batch, self.batch
        self.warmup_batches = max(self.warmup_batches - 1, 0)
        self.steps += self.config.batch_size
        self.check_finite(self.agent.networks)
        return means

    def _update(self) -> dict[str, float]:
        """Learns from the batch; returns the agent's metrics by name."""
        started = time.perf_counter()
        metrics = self.agent.update(self.batch, values_only=self.warmup_batches > 0)
        return metrics | {"time/update_milliseconds": 1000 * (time.perf_counter() - started)}

    def _collect(self, batch: Batch) -> dict[str, float]:
        """Makes the control steps of a batch; returns the means of the metrics of steps and ended episodes, by name."""
        collected: dict[str, list[NDArray]] = collections.defaultdict(list)
        for step in range(self.config.rollouts):
            for name, values in self._step(batch, step).items():
                collected[name].append(values)
        batch.next_observations.copy_(self._observations)
        return {name: float(np.concatenate(parts).mean()) for name, parts in collected.items()}

    def _step(self, batch: Batch, step: int) -> dict[str, NDArray]:
        """Makes a control step in all environments and adds it to a batch; returns its metrics."""
        batch.observations[step] = self._observations
        batch.actions[step] = self._actor.explore(self._observations)
        applied = self._applied(batch.actions[step])
        observations, rewards, terminations, truncations, infos = self.environments.step(applied)
        batch.rewards[step] = torch.as_tensor(rewards * self.config.reward_scale)
        ended = terminations | truncations
        batch.ended[step] = torch.as_tensor(ended)
        batch.truncated[step] = torch.as_tensor(truncations & ~terminations)
        self._observations = self._tensor(observations)
        metrics = {"step/reward": rewards, **_step_metrics(infos)}
        if ended.any():
            for i in np.flatnonzero(truncations & ~terminations).tolist():
                batch.last_observations[step, i] = self._tensor(infos["final_obs"][i])
            of_episodes = episode_metrics(self._task, infos["final_info"])
            metrics |= {name: values[ended] for name, values in of_episodes.items()}
            metrics |= self._balance.add(infos["final_info"], ended) if self._balance else {}
        return metrics

    def _tensor(self, observations: Any) -> torch.Tensor:
        return torch.as_tensor(self._inputs(observations), dtype=torch.float32)

    def _applied(self, actions: torch.Tensor) -> NDArray[np.float32]:
        """Returns the actions `(n, k)` of the environments for those of the policy."""
        return (actions * self.agent.policy.scale).numpy()


def train(
    folder: Path,
    spec: EnvironmentSpec,
    schedule: Schedule,
    *,
    seed: int = 0,
    restarts: int = 3,
    hyperparameters: Mapping[str, Any] = MappingProxyType({}),
    training_kwargs: Mapping[str, Any] = MappingProxyType({}),
    demonstrations: Sequence[Path] = (),
    initial_policy: Path | None = None,
    num_threads: int | None = None,
    resume: bool = False,
    report: Callable[[str], None] = lambda line: None,
) -> Path:
    """Trains a policy; with more seeds where there is no progress.

    The folder gets a folder for each seed, with curves for TensorBoard and the last checkpoints, and the best policy.

    Args:
      folder: of the run.
      spec: of the environments that the policy is evaluated in.
      schedule: when the policy is evaluated, and when training stops; see `recipes.find_schedule`.
      seed: first seed.
      restarts: number of additional seeds to try where one is given up.
      hyperparameters: changes to those of the domain's recipe, by name.
      training_kwargs: arguments of the environments that are trained in; they replace the recipe's.
      demonstrations: folders of recordings that are cloned before the first step.
      initial_policy: file of a policy to start from.
      num_threads: number of threads that step the environments; one per processor when None.
      resume: whether to continue the run in the folder from its newest checkpoints.
      report: called with each line of a table of the evaluations.

    Returns the file of the best policy.

    Raises:
      DivergedError: learning diverged.
      OSError: a file cannot be read or written.
      ValueError: an argument is not valid, or the folder holds another run.
    """
    if initial_policy and demonstrations:
        raise ValueError("an initial policy and demonstrations both give a policy to start from: give one of them")
    if schedule.num_steps == 0 and not demonstrations:
        raise ValueError("num_steps 0 is for cloning alone, which needs demonstrations")
    check_observed(spec, PPO)
    initial = load_initial_policy(initial_policy, spec) if initial_policy else None
    is_cloned = bool(demonstrations) or isinstance(initial, ChunkPolicy)
    config = PPOHyperparameters.for_domain(spec.domain_name, hyperparameters, cloning=is_cloned)
    training_kwargs = _training_kwargs(spec, training_kwargs, is_cloned=is_cloned)
    trained_in = _training_spec(spec, training_kwargs)
    options = {"autoreset_mode": AutoresetMode.SAME_STEP, **spec.env_class.flat_options}
    with contextlib.ExitStack() as stack:
        environments = trained_in.make_vector_env(config.num_envs, num_threads, **options)
        stack.callback(environments.close)
        task = environments.composer_task
        config = config.for_actions(task.mdp.action_mode.spec(task.robot))
        if initial:
            config = _with_scale_of(initial, config, is_given="action_scale" in hyperparameters)
        demonstrated = _load_demonstrations(demonstrations, spec, environments) if demonstrations else ()
        evaluation = dataclasses.replace(spec, max_episode_steps=trained_in.max_episode_steps)
        evaluated = stack.enter_context(evaluation_environments(evaluation, schedule, num_threads))
        stack.enter_context(one_thread())
        description = RunDescription(
            domain_name=spec.domain_name,
            task_name=spec.task_name,
            task_kwargs=dict(spec.task_kwargs),
            training_kwargs=training_kwargs,
            hyperparameters=dataclasses.asdict(config),
            seed=seed,
            algorithm=PPO,
            data_sha256=digest_of([*demonstrated, *(initial.arrays.values() if initial else ())]),
        )

        def make_learner(seed: int) -> PPOLearner:
            return PPOLearner(environments, config, seed, initial)

        for run in seed_runs(
            folder, description, schedule, evaluated, make_learner, restarts=restarts, resume=resume, report=report
        ):
            learner = run.learner
            if demonstrated and not run.resumed:
                learner.imitate(*demonstrated)
            with run:
                if not run.stop_reason:
                    learner.start(run.episode_seed)
                run.begin()
                while not run.stop_reason:
                    run.record(learner.learn())
    return folder / POLICY_FILE


def load_initial_policy(path: Path, spec: EnvironmentSpec) -> InitialPolicy:
    """Returns the policy to start from; raises as `load_policy`, and as `check_same`.

    PPO learns a distribution of the next action given the state: a clone's chunks are cut to their first action, and
    one that applies several is refused.
    """
    policy = load_policy(path)
    domain, task_name, arguments = (policy.metadata[name] for name in ("domain_name", "task_name", "task_kwargs"))
    if domain != spec.domain_name:
        raise ValueError(f"{path} is a policy of the domain {domain}, not of {spec.domain_name}")
    suite.check_named(domain, arguments)
    recorded = EnvironmentSpec.make(domain, task_name, arguments)
    check_same(path, recorded, spec, (*OBSERVATION_OPTIONS, *suite.find_domain(domain).control_options))
    try:
        with spec.make_environment() as environment:
            policy.check_fits(suite_env(environment).composer_task)
        if isinstance(policy, ChunkPolicy):
            return policy.of_single_actions()
    except ValueError as error:
        raise ValueError(f"PPO cannot start from {path}: {error}") from error
    assert isinstance(policy, PerceptronPolicy)
    return policy


def _with_scale_of(policy: InitialPolicy, config: PPOHyperparameters, *, is_given: bool) -> PPOHyperparameters:
    """Returns the hyperparameters with the action scale of a policy; one that is given has to be the same."""
    if np.array_equal(np.array(config.action_scale, np.float32), policy.action_scale):
        return config
    scale = tuple(policy.action_scale.tolist())
    if is_given:
        raise ValueError(f"action_scale must be that of the initial policy, {scale}, got {config.action_scale}")
    return dataclasses.replace(config, action_scale=scale)


def _training_kwargs(spec: EnvironmentSpec, changes: Mapping[str, Any], *, is_cloned: bool) -> dict[str, Any]:
    """Returns the arguments of the environments that are trained in, which replace those of the task.

    The domain's are left out where the task's arguments have them, and where the policy is cloned.
    """
    own = {} if is_cloned else find_recipe(spec.domain_name).options
    given = {*spec.task_kwargs, *suite.task_arguments(spec.domain_name, spec.task_name)}
    defaults = {option: value for option, value in own.items() if option not in given}
    changes = suite.find_domain(spec.domain_name).with_contents(changes)
    arguments = {name: files.json_value(value, name) for name, value in {**defaults, **changes}.items()}
    options = (*spec.env_class.goal_options, *suite.find_domain(spec.domain_name).control_options)
    if shared := sorted({*OBSERVATION_OPTIONS, *options} & arguments.keys()):
        raise ValueError(f"training_kwargs cannot change {shared}, on which the policy depends: change the task_kwargs")
    return arguments


def _training_spec(spec: EnvironmentSpec, training_kwargs: Mapping[str, Any]) -> EnvironmentSpec:
    """Returns the specification of the environments that are trained in, of which one has been made."""
    arguments = {**spec.task_kwargs, **training_kwargs}
    if (steps := arguments.pop("max_episode_steps", None)) is not None:
        checks.integer(steps, "max_episode_steps", minimum=1)
    trained_in = EnvironmentSpec.make(spec.domain_name, spec.task_name, arguments, steps)
    trained_in.make_environment().close()
    return trained_in


def _load_demonstrations(
    folders: Sequence[Path], spec: EnvironmentSpec, environments: SuiteVectorEnv
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Returns the observations `(m, n)` and actions `(m, k)` to clone; raises as `load_to_clone`."""
    size = spaces.flatdim(environments.single_observation_space)
    expected = (size,), environments.single_action_space.shape
    loaded = [load_to_clone(folder, spec) for folder in folders]
    for folder, arrays in zip(folders, loaded, strict=True):
        if (found := tuple(each.shape[1:] for each in arrays)) != expected:
            problem = f"observations and actions of shapes {found}, but this task has {expected}"
            raise ValueError(f"{folder} holds {problem}")
    observations, actions = map(np.concatenate, zip(*loaded, strict=True))
    return observations, actions
