"""Losses of the algorithms of offline reinforcement learning, on standardised inputs and actions."""

import abc
import copy
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar

import torch

from kitchen_suite.training.hyperparameters import IQLHyperparameters, OfflineHyperparameters, TD3BCHyperparameters
from kitchen_suite.training.imitation.methods import TorchNetwork
from kitchen_suite.training.offline.transitions import Batch

# Greatest weight of an action in the policy's loss of IQL.
_MAX_WEIGHT = 100.0

# Control steps of TD3 between updates of the policy.
_POLICY_DELAY = 2


class OfflineMethod(torch.nn.Module, abc.ABC):
    """Networks of an algorithm, and its loss.

    Attributes:
      title: name of the algorithm.
      hyperparameters: class of its hyperparameters.
      reaches_goals: whether it learns to reach goals, rather than from recorded rewards.
      policy: from inputs `(b, n)` to actions `(b, k)`.
    """

    title: ClassVar[str]
    hyperparameters: ClassVar[type[OfflineHyperparameters]]
    reaches_goals: ClassVar[bool] = False

    policy: TorchNetwork

    def __init__(self, inputs: int, actions: int, config: Any) -> None:
        """Builds the networks for `inputs` and `actions` values."""
        super().__init__()
        self.config = config
        self.policy = self._network(inputs, actions)

    def _network(self, inputs: int, outputs: int) -> TorchNetwork:
        return TorchNetwork(inputs, outputs, width=self.config.width, blocks=self.config.blocks)

    @abc.abstractmethod
    def loss(self, batch: Batch, step: int) -> torch.Tensor:
        """Returns the loss `()` of a batch in a step of the optimiser, counted from 0."""

    def follow(self) -> None:  # noqa: B027
        """Moves target networks towards those that learn, after a step of the optimiser."""


class Cloning(OfflineMethod):
    """Behaviour cloning of every action, whatever came of it."""

    title = "Behaviour cloning of all episodes"
    hyperparameters = OfflineHyperparameters

    def loss(self, batch: Batch, step: int) -> torch.Tensor:
        return torch.nn.functional.mse_loss(self.policy(batch.inputs), batch.actions)


class Critics(torch.nn.Module):
    """Two networks for the value of an action, and slowly moving copies of them as targets."""

    def __init__(self, networks: list[TorchNetwork], rate: float) -> None:
        """Takes the two networks, and the share by which targets move in a step."""
        super().__init__()
        self._rate = rate
        self.networks = torch.nn.ModuleList(networks)
        self.targets = copy.deepcopy(self.networks).requires_grad_(False)

    def forward(self, inputs: torch.Tensor, actions: torch.Tensor) -> list[torch.Tensor]:
        """Returns both values `(b,)` of actions `(b, k)` on inputs `(b, n)`."""
        return [network(torch.cat([inputs, actions], dim=1)).squeeze(1) for network in self.networks]

    @torch.no_grad()
    def target(self, inputs: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
        """Returns the smaller one of the targets' values `(b,)`."""
        values = [target(torch.cat([inputs, actions], dim=1)).squeeze(1) for target in self.targets]
        return torch.minimum(*values)

    def loss(self, inputs: torch.Tensor, actions: torch.Tensor, returns: torch.Tensor) -> torch.Tensor:
        """Returns the squared error `()` of both values."""
        values = self(inputs, actions)
        return sum(((value - returns).square().mean() for value in values), start=torch.zeros(()))

    @torch.no_grad()
    def follow(self) -> None:
        """Moves the targets."""
        for target, parameter in zip(self.targets.parameters(), self.networks.parameters(), strict=True):
            target.lerp_(parameter, self._rate)


class IQL(OfflineMethod):
    """Implicit Q-learning: values are expectiles over the data's actions, of which the better ones are cloned.

    Source: Kostrikov, Nair and Levine, Offline Reinforcement Learning with Implicit Q-Learning, ICLR 2022.
    """

    title = "Implicit Q-learning"
    hyperparameters = IQLHyperparameters

    def __init__(self, inputs: int, actions: int, config: IQLHyperparameters) -> None:
        super().__init__(inputs, actions, config)
        self.value = self._network(inputs, 1)
        self.critics = Critics([self._network(inputs + actions, 1) for _ in range(2)], config.target_rate)

    def loss(self, batch: Batch, step: int) -> torch.Tensor:
        config, value_inputs = self.config, batch.value_inputs
        value = self.value(value_inputs).squeeze(1)
        error = self.critics.target(value_inputs, batch.actions) - value
        value_loss = (torch.where(error > 0, config.expectile, 1.0 - config.expectile) * error.square()).mean()
        with torch.no_grad():
            after = self.value(batch.next_value_inputs).squeeze(1)
            returns = batch.rewards + config.discount * batch.continues * after
            advantage = self._advantage(batch, error)
            weight = (config.temperature * advantage).exp().clamp(max=_MAX_WEIGHT)
        critic_loss = self.critics.loss(value_inputs, batch.actions, returns)
        mistakes = (self.policy(batch.inputs) - batch.actions).square().mean(dim=1)
        return value_loss + critic_loss + (weight * mistakes).mean()

    def _advantage(self, batch: Batch, error: torch.Tensor) -> torch.Tensor:
        """Returns how much better than the value the actions `(b,)` are on the policy's inputs."""
        return error

    def follow(self) -> None:
        self.critics.follow()


class TD3BC(OfflineMethod):
    """TD3 with behaviour cloning: the policy takes actions of great value that are near those of the data.

    Source: Fujimoto and Gu, A Minimalist Approach to Offline Reinforcement Learning, NeurIPS 2021.
    """

    title = "TD3+BC"
    hyperparameters = TD3BCHyperparameters

    def __init__(self, inputs: int, actions: int, config: TD3BCHyperparameters) -> None:
        super().__init__(inputs, actions, config)
        self.critics = Critics([self._network(inputs + actions, 1) for _ in range(2)], config.target_rate)
        self.policy_target = copy.deepcopy(self.policy).requires_grad_(False)

    def loss(self, batch: Batch, step: int) -> torch.Tensor:
        config, inputs = self.config, batch.value_inputs
        with torch.no_grad():
            noise = (config.target_noise * torch.randn_like(batch.actions)).clamp(-config.noise_clip, config.noise_clip)
            actions = self.policy_target(batch.next_value_inputs) + noise
            after = self.critics.target(batch.next_value_inputs, actions)
            returns = batch.rewards + config.discount * batch.continues * after
        loss = self.critics.loss(inputs, batch.actions, returns)
        return loss if step % _POLICY_DELAY else loss + self._policy_loss(batch)

    def _policy_loss(self, batch: Batch) -> torch.Tensor:
        chosen = self.policy(batch.inputs)
        first = self.critics.networks[0]
        # The policy's loss trains the policy alone.
        frozen = {name: parameter.detach() for name, parameter in first.named_parameters()}
        pairs = torch.cat([batch.inputs, chosen], dim=1)
        values = torch.func.functional_call(first, frozen, (pairs,)).squeeze(1)
        scale = values.detach().abs().mean().clamp(min=1e-6)
        mistakes = (chosen - batch.actions).square().mean()
        return self.config.cloning * mistakes - values.mean() / scale

    @torch.no_grad()
    def follow(self) -> None:
        self.critics.follow()
        for target, parameter in zip(self.policy_target.parameters(), self.policy.parameters(), strict=True):
            target.lerp_(parameter, self.config.target_rate)


class GoalCloning(Cloning):
    """Behaviour cloning on goals that were reached later in the same episode (GCBC)."""

    title = "Goal-conditioned behaviour cloning"
    reaches_goals = True


class GoalIQL(IQL):
    """Implicit Q-learning on goals (GCIQL), whose policy imitates on goals that were reached later.

    Source: Park et al., OGBench: Benchmarking Offline Goal-Conditioned RL, ICLR 2025.
    """

    title = "Goal-conditioned implicit Q-learning"
    reaches_goals = True

    def _advantage(self, batch: Batch, error: torch.Tensor) -> torch.Tensor:
        return self.critics.target(batch.inputs, batch.actions) - self.value(batch.inputs).squeeze(1)


OFFLINE_METHODS: Mapping[str, type[OfflineMethod]] = MappingProxyType(
    {"offline_bc": Cloning, "iql": IQL, "td3bc": TD3BC, "gcbc": GoalCloning, "gciql": GoalIQL}
)
"""By the value of `--algorithm`."""
