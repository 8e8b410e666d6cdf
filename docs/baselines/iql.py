"""Implicit Q-learning (IQL): learns from all episodes of a recording, by the rewards that they have.

    kitchen-record --preset=mixed --variations=start --output=mixed
    python docs/baselines/iql.py mixed --output=iql
    kitchen-replay iql/receipt.npz

A value function learns an expectile of the values of recorded actions, without any action of the policy. The policy is
extracted from them in one of two ways:

    --extraction=weights    recorded chunks of actions are cloned, those of greater advantage with a greater weight
    --extraction=flow       flow matching clones all chunks, and of some that it draws the most valuable is taken (IDQL)

The policy after the last step is evaluated, on the task of the recording unless `--task_name` names another one. Needs
the extra `train`.

Sources: Kostrikov, Nair and Levine, Offline Reinforcement Learning with Implicit Q-Learning, ICLR 2022;
Hansen-Estruch et al., IDQL: Implicit Q-Learning as an Actor-Critic Method with Diffusion Policies, 2023. With
`--chunk=1 --executed=1 --n_step=1` single actions are valued after single steps, as in the papers. What differs from
them: chunks of actions; residual networks, whose policy has averaged weights and a falling learning rate; noise on the
inputs of value networks; absolute errors of a deterministic policy in place of likelihoods.
"""

import copy
import dataclasses
import math
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import baseline
import numpy as np
import torch
from flow import TIME_FEATURES, carry, flow_loss
from numpy.typing import NDArray
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from kitchen_suite import Recording
from kitchen_suite.episodes.transitions import Transitions
from kitchen_suite.policies.networks import ResidualNetwork, Scales
from kitchen_suite.tasks.policy_inputs import PolicyInputs
from kitchen_suite.training.bc import Network, scales_of

MAX_WEIGHT = 100.0  # Greatest weight of a chunk in the policy's loss.
ROWS = 4  # Rows of a product of matrices: for more, linear algebra starts threads, on whose number rounding depends.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Config:
    """Hyperparameters.

    Attributes:
      extraction: of the policy, `weights` or `flow`.
      width: values between the blocks of the policy's network.
      blocks: number of its residual blocks.
      chunk: number of actions that are predicted and valued at once.
      executed: number of these that are applied before the next prediction.
      batch_size: control steps of a step of the optimiser.
      learning_rate: of the optimiser (Adam) at first; it falls to 0 like half a cosine.
      averaging: decay of the moving average of the policy's weights, which act.
      n_step: control steps of an n-step return, before the value of the state after them.
      discount: discount factor.
      value_width: values between the blocks of value networks. A greater network without noise learns the outcome of
        each recorded episode by heart, and then sees no advantage.
      value_noise: standard deviation of normal noise on the inputs of value networks in training, standardised.
      target_rate: rate at which target networks move in a step of the optimiser.
      expectile: of the values of actions that the value function learns.
      temperature: inverse temperature: factor of an advantage in the logarithm of its weight; of `weights` alone.
      flow_steps: steps of Euler's method in a prediction; of `flow` alone, as `candidates`.
      candidates: number of chunks that are drawn, of which the most valuable one is taken.
    """

    extraction: str = "weights"
    width: int = 256
    blocks: int = 2
    chunk: int = 8
    executed: int = 1
    batch_size: int = 256
    learning_rate: float = 1e-3
    averaging: float = 0.999
    n_step: int = 8
    discount: float = 0.99
    value_width: int = 64
    value_noise: float = 0.3
    target_rate: float = 0.01
    expectile: float = 0.7
    temperature: float = 5.0
    flow_steps: int = 8
    candidates: int = 32

    def __post_init__(self) -> None:
        """Raises a ValueError for an extraction that there is not."""
        if self.extraction not in ("weights", "flow"):
            raise ValueError(f"extraction must be weights or flow, got {self.extraction!r}")


# Defaults of `--extraction=flow` that are others.
FLOW_DEFAULTS = {"executed": 4, "n_step": 30}


@dataclasses.dataclass(frozen=True)
class Batch:
    """Control steps that a step of the optimiser learns from; inputs and actions are standardised.

    Attributes:
      inputs: `(b, n)`, before the steps.
      chunks: `(b, c k)`, the actions of the chunks that follow; at the end of an episode the last one repeats.
      later_inputs: `(b, n)`, `n_step` steps later or at the end of the episode.
      rewards: `(b,)`, discounted, of the steps up to then.
      discounts: `(b,)`, discount factor of the value from then on; 0 after a success.
    """

    inputs: torch.Tensor
    chunks: torch.Tensor
    later_inputs: torch.Tensor
    rewards: torch.Tensor
    discounts: torch.Tensor


class Sampler:
    """Draws batches of recorded control steps; `inputs` `(r, n)` are of all rows of the transitions."""

    def __init__(self, inputs: NDArray[np.float32], transitions: Transitions, scales: Scales, config: Config) -> None:
        self._config = config
        self._transitions = transitions
        self._rows = transitions.rows
        # Control steps until the end of the episode.
        self._left = transitions.last + 1 - np.arange(len(self._rows))
        self._inputs = torch.as_tensor(scales.inputs(inputs))
        self._actions = torch.as_tensor((transitions.actions - scales.action_mean) / scales.action_deviation)
        self._returns, self._succeeds = self._outcomes()

    def _outcomes(self) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Returns the discounted rewards `(m,)` of the next `n_step` steps, and whether success ended them."""
        count = len(self._rows)
        rewards = self._transitions.rewards.astype(np.float32)
        total = np.zeros(count)
        succeeds = np.zeros(count, np.bool_)
        for ahead in range(self._config.n_step):
            steps = np.minimum(np.arange(count) + ahead, count - 1)
            inside = ahead < self._left
            total += np.where(inside, self._config.discount**ahead * rewards[steps], 0.0)
            succeeds |= inside & self._transitions.terminations[steps]
        return total.astype(np.float32), succeeds

    def draw(self) -> Batch:
        """Draws a batch, with random numbers of PyTorch."""
        steps = torch.randint(len(self._rows), (self._config.batch_size,)).numpy()
        rows = self._rows[steps]
        ahead = np.minimum(self._left[steps], self._config.n_step)
        of_chunk = np.minimum(np.arange(self._config.chunk), self._left[steps][:, np.newaxis] - 1)
        return Batch(
            inputs=self._inputs[rows],
            chunks=self._actions[steps[:, np.newaxis] + of_chunk].flatten(1),
            later_inputs=self._inputs[rows + ahead],
            rewards=torch.as_tensor(self._returns[steps]),
            discounts=torch.as_tensor(~self._succeeds[steps] * self._config.discount**ahead).float(),
        )


class Value(torch.nn.Module):
    """A network for the value of its inputs, to which noise is added in training."""

    def __init__(self, inputs: int, config: Config) -> None:
        super().__init__()
        self._noise = config.value_noise
        self.network = Network(inputs, 1, width=config.value_width, blocks=1)

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        """Returns values `(b,)` of inputs `(b, n)`."""
        return self.network(inputs + self._noise * torch.randn_like(inputs)).squeeze(1)


class Critics(torch.nn.Module):
    """Two networks for the value of chunks of actions, and slowly moving copies of them as targets."""

    def __init__(self, inputs: int, actions: int, config: Config) -> None:
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
        return torch.minimum(*(target(torch.cat([inputs, actions], dim=1)) for target in self.targets))

    @torch.no_grad()
    def update_targets(self) -> None:
        """Moves the targets towards the networks."""
        torch._foreach_lerp_([*self.targets.parameters()], [*self.networks.parameters()], self._rate)


class Learner(torch.nn.Module):
    """The networks of the policy and of the values, and their loss."""

    def __init__(self, inputs: int, actions: int, config: Config) -> None:
        super().__init__()
        self._config = config
        further = actions + TIME_FEATURES if config.extraction == "flow" else 0
        self.policy = Network(inputs + further, actions, width=config.width, blocks=config.blocks)
        self.value = Value(inputs, config)
        self.critics = Critics(inputs, actions, config)

    def loss(self, batch: Batch) -> torch.Tensor:
        """Returns the loss `()` of policy and values."""
        if self._config.extraction == "flow":
            return self._value_loss(batch) + flow_loss(self.policy, batch.inputs, batch.chunks)
        with torch.no_grad():
            weights = (self._config.temperature * self._advantages(batch)).exp().clamp(max=MAX_WEIGHT)
        errors = (self.policy(batch.inputs) - batch.chunks).abs().mean(dim=1)
        return self._value_loss(batch) + (weights * errors).mean()

    def _value_loss(self, batch: Batch) -> torch.Tensor:
        """Returns the loss `()` of all value networks."""
        with torch.no_grad():
            returns = batch.rewards + batch.discounts * self.value(batch.later_inputs)
        errors = self._advantages(batch)
        # The expectile of the values of actions, by the squared error with two weights.
        weights = torch.where(errors > 0, self._config.expectile, 1.0 - self._config.expectile)
        first, second = self.critics(batch.inputs, batch.chunks)
        of_critics = (first - returns).square().mean() + (second - returns).square().mean()
        return (weights * errors.square()).mean() + of_critics

    def _advantages(self, batch: Batch) -> torch.Tensor:
        """Returns the advantages `(b,)` of the chunks of a batch."""
        return self.critics.target(batch.inputs, batch.chunks) - self.value(batch.inputs)


@dataclasses.dataclass(frozen=True)
class Learned:
    """Networks that act, and the standardisation of their inputs and actions.

    Attributes:
      policy: with averaged weights.
      critics: the targets of both.
      scales: of inputs and actions.
    """

    policy: ResidualNetwork
    critics: tuple[ResidualNetwork, ...]
    scales: Scales


def train(
    inputs: NDArray[np.float32], transitions: Transitions, config: Config, *, num_steps: int, seed: int
) -> Learned:
    """Returns the networks after a number of steps of the optimiser; `inputs` are of all rows of the transitions."""
    # The matrices are small: with a second thread, training is slower.
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    scales = scales_of(inputs, transitions.actions, baseline.INPUT_EPSILON)
    sampler = Sampler(inputs, transitions, scales, config)
    learner = Learner(inputs.shape[1], config.chunk * transitions.actions.shape[1], config)
    average = AveragedModel(learner.policy, multi_avg_fn=get_ema_multi_avg_fn(config.averaging))
    learning = [parameter for parameter in learner.parameters() if parameter.requires_grad]
    optimizer = torch.optim.Adam(learning, lr=config.learning_rate, fused=True)
    for step in range(num_steps):
        for group in optimizer.param_groups:
            group["lr"] = config.learning_rate * (0.5 * (1 + math.cos(math.pi * (step / num_steps))))
        loss = learner.loss(sampler.draw())
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        learner.critics.update_targets()
        average.update_parameters(learner.policy)
        if step % 1000 == 0:
            print(f"step {step:6,}  loss {loss.item():.4f}", flush=True)
    critics = tuple(target.network.in_numpy() for target in learner.critics.targets)
    return Learned(average.module.in_numpy(), critics, scales)


class IQLPolicy(baseline.ChunkPolicy):
    """Predicts chunks of actions, or takes the most valuable one of some that flow matching draws."""

    def __init__(
        self, learned: Learned, observed: PolicyInputs, config: Config, generators: Iterator[np.random.Generator]
    ) -> None:
        """Prepares to act by networks; `generators` are those of the noise of each episode in turn."""
        super().__init__(observed, config.executed, generators)
        self._learned = learned
        self._config = config

    def predict(self, inputs: NDArray, generator: np.random.Generator) -> NDArray[np.float32]:
        """Returns a chunk of actions `(c, k)` for inputs `(n,)`."""
        standardised = self._learned.scales.inputs(inputs)
        draws = self._config.extraction == "flow"
        values = self._best(standardised, generator) if draws else self._learned.policy(standardised)
        return self._learned.scales.actions(values.reshape(self._config.chunk, -1))

    def _best(self, inputs: NDArray[np.float32], generator: np.random.Generator) -> NDArray[np.float32]:
        """Returns the most valuable one of some chunks `(c k,)` that flow matching draws."""
        noise = generator.standard_normal((self._config.candidates, self._learned.policy.outputs), np.float32)
        groups = np.split(noise, range(ROWS, len(noise), ROWS))
        drawn = [carry(self._learned.policy, inputs, group, self._config.flow_steps) for group in groups]
        values = np.concatenate([self._values(inputs, group) for group in drawn])
        return np.concatenate(drawn)[values.argmax()]

    def _values(self, inputs: NDArray[np.float32], chunks: NDArray[np.float32]) -> NDArray[np.float32]:
        """Returns the smaller one of both values `(b,)` of chunks `(b, c k)`."""
        pairs = np.concatenate([np.broadcast_to(inputs, (len(chunks), inputs.size)), chunks], axis=1)
        first, second = (critic(pairs)[:, 0] for critic in self._learned.critics)
        return np.minimum(first, second)


def main(arguments: Sequence[str] | None = None) -> None:
    """Trains and evaluates."""
    parser = baseline.make_parser(__doc__, Config, num_steps=40_000)
    parser.add_argument("recording", type=Path, help="folder of kitchen-record")
    baseline.add_task(parser)
    given = parser.parse_args(arguments)

    given.output.mkdir(parents=True)
    changes = baseline.changes(Config, given)
    config = Config(**{**(FLOW_DEFAULTS if changes.get("extraction") == "flow" else {}), **changes})
    recording = Recording.open(given.recording)
    transitions = recording.load_transitions()
    spec = baseline.task(given, recording.spec)
    observed, recorded = baseline.policy_inputs(spec), baseline.policy_inputs(recording.spec)
    inputs = recorded.state_and_requests(transitions.observations, baseline.requested_tasks(observed))
    started = time.process_time()
    learned = train(inputs.astype(np.float32), transitions, config, num_steps=given.num_steps, seed=given.seed)
    baseline.write_training(given, config, time.process_time() - started)
    policy = IQLPolicy(learned, observed, config, baseline.generators(given.eval_seed))
    baseline.evaluate(policy, spec, given)


if __name__ == "__main__":
    main()
