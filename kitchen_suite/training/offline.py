"""Losses of the algorithms of offline reinforcement learning, on standardised inputs and actions."""

import abc
import copy
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar, cast

import torch

from kitchen_suite.policies.imitated import RankedPolicy
from kitchen_suite.training.hyperparameters import (
    IDQLHyperparameters,
    IQLHyperparameters,
    OfflineHyperparameters,
    TD3BCHyperparameters,
    ValueHyperparameters,
)
from kitchen_suite.training.imitation import Flow, Method, TorchNetwork
from kitchen_suite.training.transitions import Batch

_MAX_WEIGHT = 100.0  # Greatest weight of an action in the policy's loss of IQL.
_POLICY_DELAY = 2  # Control steps of TD3 between updates of the policy.


class OfflineMethod(Method):
    """A method of offline reinforcement learning.

    Attributes:
      reaches_goals: whether it learns to reach goals, rather than from recorded rewards.
    """

    hyperparameters = OfflineHyperparameters
    reaches_goals: ClassVar[bool] = False

    @abc.abstractmethod
    def loss(self, batch: Batch, policy_batch: Batch, step: int) -> torch.Tensor:
        """Returns the loss `()` in a step of the optimiser, counted from 0.

        Values learn from `batch`, the policy from `policy_batch`: the same, but for the goals where there are any.
        """

    def further_networks(self) -> dict[str, TorchNetwork]:
        """Returns the policy's networks beside `network`, by name."""
        return {}


class Cloning(OfflineMethod):
    """Behaviour cloning of all recorded actions, those of failed episodes included."""

    title = "Behaviour cloning of all episodes"

    def loss(self, batch: Batch, policy_batch: Batch, step: int) -> torch.Tensor:
        return torch.nn.functional.l1_loss(self.network(policy_batch.inputs), policy_batch.chunks)


class Value(torch.nn.Module):
    """A network for the value of its inputs, to which noise is added in training."""

    def __init__(self, inputs: int, config: ValueHyperparameters) -> None:
        """Builds the network."""
        super().__init__()
        self._noise = config.value_noise
        self.network = TorchNetwork(inputs, 1, width=config.value_width, blocks=1)

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        """Returns values `(b,)` of inputs `(b, n)`."""
        return self.network(inputs + self._noise * torch.randn_like(inputs)).squeeze(1)


class Critics(torch.nn.Module):
    """Two networks for the value of chunks of actions, and slowly moving copies of them as targets."""

    def __init__(self, inputs: int, actions: int, config: ValueHyperparameters) -> None:
        """Builds the networks for `inputs` and `actions` values."""
        super().__init__()
        self._rate = config.target_rate
        self.networks = torch.nn.ModuleList(Value(inputs + actions, config) for _ in range(2))
        self.targets = copy.deepcopy(self.networks).requires_grad_(False)

    def forward(self, inputs: torch.Tensor, actions: torch.Tensor) -> list[torch.Tensor]:
        """Returns both values `(b,)` of chunks of actions `(b, c k)` on inputs `(b, n)`."""
        return [network(torch.cat([inputs, actions], dim=1)) for network in self.networks]

    @torch.no_grad()
    def target(self, inputs: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
        """Returns the smaller one of the targets' values `(b,)`."""
        values = [target(torch.cat([inputs, actions], dim=1)) for target in self.targets]
        return torch.minimum(*values)

    def loss(self, inputs: torch.Tensor, actions: torch.Tensor, returns: torch.Tensor) -> torch.Tensor:
        """Returns the squared error `()` of both values."""
        values = self(inputs, actions)
        return sum(((value - returns).square().mean() for value in values), start=torch.zeros(()))

    def update_targets(self) -> None:
        """Moves the targets towards the networks."""
        _move(self.targets, self.networks, self._rate)


@torch.no_grad()
def _move(target: torch.nn.Module, module: torch.nn.Module, rate: float) -> None:
    """Moves the parameters of a target by a share of the way to those of a module."""
    torch._foreach_lerp_([*target.parameters()], [*module.parameters()], rate)


class ImplicitQ(OfflineMethod):
    """Values by expectiles over the actions of the data, without any action of a policy.

    Source: Kostrikov, Nair and Levine, Offline Reinforcement Learning with Implicit Q-Learning, ICLR 2022.
    """

    def __init__(self, inputs: int, actions: int, config: Any) -> None:
        super().__init__(inputs, actions, config)
        self.value = Value(inputs, config)
        self.critics = Critics(inputs, actions, config)

    def _value_loss(self, batch: Batch) -> torch.Tensor:
        """Returns the loss `()` of all value networks."""
        with torch.no_grad():
            returns = batch.rewards + batch.discounts * self.value(batch.later_inputs)
        errors = self._advantages(batch)
        # The expectile of the values of actions, by the squared error with two weights.
        weights = torch.where(errors > 0, self.config.expectile, 1.0 - self.config.expectile)
        return (weights * errors.square()).mean() + self.critics.loss(batch.inputs, batch.chunks, returns)

    def _advantages(self, batch: Batch) -> torch.Tensor:
        """Returns the advantages `(b,)` of the chunks of a batch."""
        return self.critics.target(batch.inputs, batch.chunks) - self.value(batch.inputs)

    def update_targets(self) -> None:
        self.critics.update_targets()


class IQL(ImplicitQ):
    """Implicit Q-learning: actions of greater advantage weigh more in cloning."""

    title = "Implicit Q-learning"
    hyperparameters = IQLHyperparameters

    def loss(self, batch: Batch, policy_batch: Batch, step: int) -> torch.Tensor:
        with torch.no_grad():
            weights = (self.config.temperature * self._advantages(policy_batch)).exp().clamp(max=_MAX_WEIGHT)
        errors = (self.network(policy_batch.inputs) - policy_batch.chunks).abs().mean(dim=1)
        return self._value_loss(batch) + (weights * errors).mean()


class IDQL(ImplicitQ):
    """IQL with a policy of flow matching, which clones all actions; values choose among several chunks that it draws.

    Source: see `RankedPolicy`.
    """

    title = "IDQL"
    hyperparameters = IDQLHyperparameters
    policy_class = RankedPolicy

    def _make_network(self, inputs: int, outputs: int) -> TorchNetwork:
        self.flow = Flow(inputs, outputs, self.config)
        return self.flow.network

    def loss(self, batch: Batch, policy_batch: Batch, step: int) -> torch.Tensor:
        return self._value_loss(batch) + self.flow.loss(policy_batch.inputs, policy_batch.chunks, step)

    def further_networks(self) -> dict[str, TorchNetwork]:
        first, second = (cast(Value, target).network for target in self.critics.targets)
        return {"first_critic": first, "second_critic": second}

    def settings(self) -> dict[str, Any]:
        return {"flow_steps": self.config.flow_steps, "candidates": self.config.candidates}


class TD3BC(OfflineMethod):
    """TD3 with behaviour cloning: the policy takes actions of great value that are near those of the data.

    Source: Fujimoto and Gu, A Minimalist Approach to Offline Reinforcement Learning, NeurIPS 2021.
    """

    title = "TD3+BC"
    hyperparameters = TD3BCHyperparameters

    def __init__(self, inputs: int, actions: int, config: TD3BCHyperparameters) -> None:
        super().__init__(inputs, actions, config)
        self.critics = Critics(inputs, actions, config)
        self.policy_target = copy.deepcopy(self.network).requires_grad_(False)

    def loss(self, batch: Batch, policy_batch: Batch, step: int) -> torch.Tensor:
        config = self.config
        with torch.no_grad():
            noise = (config.target_noise * torch.randn_like(batch.chunks)).clamp(-config.noise_clip, config.noise_clip)
            actions = self.policy_target(batch.later_inputs) + noise
            returns = batch.rewards + batch.discounts * self.critics.target(batch.later_inputs, actions)
        loss = self.critics.loss(batch.inputs, batch.chunks, returns)
        return loss if step % _POLICY_DELAY else loss + self._policy_loss(policy_batch)

    def _policy_loss(self, policy_batch: Batch) -> torch.Tensor:
        chosen = self.network(policy_batch.inputs)
        first = self.critics.networks[0]
        # The policy's loss trains the policy alone.
        frozen = {name: parameter.detach() for name, parameter in first.named_parameters()}
        pairs = torch.cat([policy_batch.inputs, chosen], dim=1)
        values = torch.func.functional_call(first, frozen, (pairs,))
        scale = values.detach().abs().mean().clamp(min=1e-6)
        errors = (chosen - policy_batch.chunks).square().mean()
        return self.config.bc_weight * errors - values.mean() / scale

    def update_targets(self) -> None:
        self.critics.update_targets()
        _move(self.policy_target, self.network, self.config.target_rate)


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


OFFLINE_METHODS: Mapping[str, type[OfflineMethod]] = MappingProxyType(
    {"offline_bc": Cloning, "iql": IQL, "idql": IDQL, "td3bc": TD3BC, "gcbc": GoalCloning, "gciql": GoalIQL}
)
"""By the value of `--algorithm`."""
