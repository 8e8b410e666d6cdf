"""Losses of the algorithms of offline reinforcement learning, on standardised inputs and actions."""

import abc
import copy
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar

import torch

from kitchen_suite.training.hyperparameters import (
    IQLHyperparameters,
    IVLHyperparameters,
    OfflineHyperparameters,
    TD3BCHyperparameters,
)
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
      policy: from inputs `(b, n)` to chunks of actions `(b, c k)`.
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
    def loss(self, batch: Batch, shown: Batch, step: int) -> torch.Tensor:
        """Returns the loss `()` in a step of the optimiser, counted from 0, of batches for values and for the policy."""

    def follow(self) -> None:  # noqa: B027
        """Moves target networks towards those that learn, after a step of the optimiser."""


class Cloning(OfflineMethod):
    """Behaviour cloning of every action, whatever came of it."""

    title = "Behaviour cloning of all episodes"
    hyperparameters = OfflineHyperparameters

    def loss(self, batch: Batch, shown: Batch, step: int) -> torch.Tensor:
        return torch.nn.functional.l1_loss(self.policy(shown.inputs), shown.chunks)


class Critics(torch.nn.Module):
    """Two networks for the value of an action, and slowly moving copies of them as targets."""

    def __init__(self, networks: list[TorchNetwork], rate: float) -> None:
        """Takes the two networks, and the share by which targets move in a step."""
        super().__init__()
        self._rate = rate
        self.networks = torch.nn.ModuleList(networks)
        self.targets = copy.deepcopy(self.networks).requires_grad_(False)

    def forward(self, inputs: torch.Tensor, actions: torch.Tensor) -> list[torch.Tensor]:
        """Returns both values `(b,)` of chunks of actions `(b, c k)` on inputs `(b, n)`."""
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

    def follow(self) -> None:
        """Moves the targets."""
        _move(self.targets, self.networks, self._rate)


@torch.no_grad()
def _move(target: torch.nn.Module, module: torch.nn.Module, rate: float) -> None:
    """Moves the parameters of a target by a share of the way to those of a module."""
    torch._foreach_lerp_([*target.parameters()], [*module.parameters()], rate)


class WeightedCloning(OfflineMethod):
    """Behaviour cloning in which actions weigh the more the greater their advantage is."""

    def _policy_loss(self, shown: Batch, advantages: torch.Tensor) -> torch.Tensor:
        """Returns the loss `()` of actions with advantages `(b,)`."""
        weights = (self.config.temperature * advantages).exp().clamp(max=_MAX_WEIGHT)
        return (weights * (self.policy(shown.inputs) - shown.chunks).abs().mean(dim=1)).mean()

    def _expectile_loss(self, errors: torch.Tensor) -> torch.Tensor:
        """Returns the loss `()` of a value function whose errors are `(b,)`."""
        return (torch.where(errors > 0, self.config.expectile, 1.0 - self.config.expectile) * errors.square()).mean()


class IQL(WeightedCloning):
    """Implicit Q-learning: values are expectiles over the data's actions, of which the better ones are cloned.

    Source: Kostrikov, Nair and Levine, Offline Reinforcement Learning with Implicit Q-Learning, ICLR 2022.
    """

    title = "Implicit Q-learning"
    hyperparameters = IQLHyperparameters

    def __init__(self, inputs: int, actions: int, config: IQLHyperparameters) -> None:
        super().__init__(inputs, actions, config)
        self.value = self._network(inputs, 1)
        self.critics = Critics([self._network(inputs + actions, 1) for _ in range(2)], config.target_rate)

    def loss(self, batch: Batch, shown: Batch, step: int) -> torch.Tensor:
        with torch.no_grad():
            returns = batch.rewards + batch.discounts * self.value(batch.later_inputs).squeeze(1)
        errors = self._advantages(batch)
        chosen = (errors if shown is batch else self._advantages(shown)).detach()
        critic_loss = self.critics.loss(batch.inputs, batch.chunks, returns)
        return self._expectile_loss(errors) + critic_loss + self._policy_loss(shown, chosen)

    def _advantages(self, batch: Batch) -> torch.Tensor:
        return self.critics.target(batch.inputs, batch.chunks) - self.value(batch.inputs).squeeze(1)

    def follow(self) -> None:
        self.critics.follow()


class IVL(WeightedCloning):
    """Implicit V-learning: IQL without values of actions, whose advantages are those of what came of them.

    The value function is an expectile of the returns of some steps and the value after them. Where what comes of an
    action is its own doing, as in this suite, its advantage needs no other network.
    Source: GCIVL in Park et al., OGBench: Benchmarking Offline Goal-Conditioned RL, ICLR 2025, there for one step.
    """

    title = "Implicit V-learning"
    hyperparameters = IVLHyperparameters

    def __init__(self, inputs: int, actions: int, config: IVLHyperparameters) -> None:
        super().__init__(inputs, actions, config)
        self.value = self._network(inputs, 1)
        self.target = copy.deepcopy(self.value).requires_grad_(False)

    def loss(self, batch: Batch, shown: Batch, step: int) -> torch.Tensor:
        errors = self._advantages(batch)
        chosen = (errors if shown is batch else self._advantages(shown)).detach()
        return self._expectile_loss(errors) + self._policy_loss(shown, chosen)

    def _advantages(self, batch: Batch) -> torch.Tensor:
        with torch.no_grad():
            returns = batch.rewards + batch.discounts * self.target(batch.later_inputs).squeeze(1)
        return returns - self.value(batch.inputs).squeeze(1)

    def follow(self) -> None:
        _move(self.target, self.value, self.config.target_rate)


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

    def loss(self, batch: Batch, shown: Batch, step: int) -> torch.Tensor:
        config = self.config
        with torch.no_grad():
            noise = (config.target_noise * torch.randn_like(batch.chunks)).clamp(-config.noise_clip, config.noise_clip)
            actions = self.policy_target(batch.later_inputs) + noise
            returns = batch.rewards + batch.discounts * self.critics.target(batch.later_inputs, actions)
        loss = self.critics.loss(batch.inputs, batch.chunks, returns)
        return loss if step % _POLICY_DELAY else loss + self._policy_loss(shown)

    def _policy_loss(self, shown: Batch) -> torch.Tensor:
        chosen = self.policy(shown.inputs)
        first = self.critics.networks[0]
        # The policy's loss trains the policy alone.
        frozen = {name: parameter.detach() for name, parameter in first.named_parameters()}
        pairs = torch.cat([shown.inputs, chosen], dim=1)
        values = torch.func.functional_call(first, frozen, (pairs,)).squeeze(1)
        scale = values.detach().abs().mean().clamp(min=1e-6)
        mistakes = (chosen - shown.chunks).square().mean()
        return self.config.cloning * mistakes - values.mean() / scale

    def follow(self) -> None:
        self.critics.follow()
        _move(self.policy_target, self.policy, self.config.target_rate)


class GoalCloning(Cloning):
    """Behaviour cloning on goals that were reached later in the same episode (GCBC)."""

    title = "Goal-conditioned behaviour cloning"
    reaches_goals = True


class GoalIQL(IQL):
    """Implicit Q-learning on goals (GCIQL), whose policy imitates on goals that were reached later.

    Source: as of `IVL`.
    """

    title = "Goal-conditioned implicit Q-learning"
    reaches_goals = True


class GoalIVL(IVL):
    """Implicit V-learning on goals (GCIVL)."""

    title = "Goal-conditioned implicit V-learning"
    reaches_goals = True


OFFLINE_METHODS: Mapping[str, type[OfflineMethod]] = MappingProxyType(
    {
        "offline_bc": Cloning,
        "iql": IQL,
        "ivl": IVL,
        "td3bc": TD3BC,
        "gcbc": GoalCloning,
        "gciql": GoalIQL,
        "gcivl": GoalIVL,
    }
)
"""By the value of `--algorithm`."""
