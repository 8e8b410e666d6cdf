"""Implicit Q-learning (IQL): learns from all episodes of a recording, by the rewards that they have.

    kitchen-record --preset=mixed --variations=start --output=mixed
    python docs/baselines/iql.py mixed --output=iql
    kitchen-replay iql/receipt.npz

A value function learns an expectile of the values of recorded actions, without any action of the policy. The policy is
extracted from them in one of two ways:

    --extraction=weights    recorded chunks of actions are cloned, those of greater advantage with a greater weight
    --extraction=flow       flow matching clones all chunks, and of some that it draws the most valuable is taken (IDQL)

The policy after the last step is evaluated on the task of the recording. Needs the extra `train`.

Sources: Kostrikov, Nair and Levine, Offline Reinforcement Learning with Implicit Q-Learning, ICLR 2022;
Hansen-Estruch et al., IDQL: Implicit Q-Learning as an Actor-Critic Method with Diffusion Policies, 2023. With
`--chunk=1 --executed=1 --n_step=1` single actions are valued after single steps, as in the papers. What differs from
them: chunks of actions; residual networks, whose policy has averaged weights and a falling learning rate; noise on the
inputs of value networks; absolute errors of a deterministic policy in place of likelihoods.
"""

import argparse
import copy
import dataclasses
import itertools
import json
import math
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import dm_env
import numpy as np
import torch
from numpy.typing import NDArray
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

import kitchen_suite
from kitchen_suite.policies.networks import ResidualNetwork, Scales
from kitchen_suite.tasks.policy_inputs import PolicyInputs

INPUT_EPSILON = 0.01  # Added to the standard deviations of inputs.
ACTION_EPSILON = 1e-3  # Added to the standard deviations of actions.
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


# Defaults of `--extraction=flow` that are others.
FLOW_DEFAULTS = {"executed": 4, "n_step": 30}


# The recordings.


def read_spec(folder: Path) -> dict[str, Any]:
    """Returns the specification of a recording."""
    return json.loads((folder / "recording.json").read_text(encoding="utf-8"))


def policy_inputs(domain_name: str, task_name: str, task_kwargs: dict[str, Any]) -> PolicyInputs:
    """Returns what policies take of the observations of a task."""
    with kitchen_suite.EnvironmentSpec.make(domain_name, task_name, task_kwargs).make_environment() as environment:
        return environment.unwrapped.environment.task.policy_inputs


def requested_tasks(inputs: PolicyInputs) -> tuple[str, ...]:
    """Returns the tasks whose request a policy observes; none where every episode requests the same ones."""
    return inputs.tasks if inputs.observes_requests else ()


def read_observation(arrays: Any) -> Any:
    """Returns the observations of an episode as the environment returns them: an array, or arrays by key."""
    if "observation" in arrays:
        return arrays["observation"]
    prefix = "observation/"
    return {name.removeprefix(prefix): arrays[name] for name in arrays.files if name.startswith(prefix)}


@dataclasses.dataclass(frozen=True)
class Transitions:
    """The control steps of all episodes, one after the other.

    Attributes:
      inputs: `(r, n)`, float32: the state, and which tasks are requested, at resets and after steps.
      actions: `(m, k)`, float32.
      rows: `(m,)`, index of the inputs before each step; the next one is after it.
      last: `(m,)`, index of the last inputs of its episode.
      rewards: `(m,)`, float32, of each step.
      terminations: `(m,)`, whether the step ended the episode by success.
    """

    inputs: NDArray[np.float32]
    actions: NDArray[np.float32]
    rows: NDArray[np.int64]
    last: NDArray[np.int64]
    rewards: NDArray[np.float32]
    terminations: NDArray[np.bool_]


def read_transitions(folder: Path) -> Transitions:
    """Reads all episodes of a recording, successful or not."""
    spec = read_spec(folder)
    observed = policy_inputs(spec["domain_name"], spec["task_name"], spec["task_kwargs"])
    found: list[tuple[NDArray, ...]] = []
    start = 0
    for path in sorted(folder.glob("episode_*.npz")):
        with np.load(path) as arrays:
            inputs = observed.state_and_requests(read_observation(arrays), requested_tasks(observed))
            steps = len(arrays["reward"])
            found.append(
                (
                    inputs.astype(np.float32),
                    arrays["action"].astype(np.float32),
                    start + np.arange(steps),
                    np.full(steps, start + steps),
                    arrays["reward"].astype(np.float32),
                    arrays["termination"],
                )
            )
        start += steps + 1
    if not found:
        raise SystemExit(f"{folder} holds no episodes")
    return Transitions(*map(np.concatenate, zip(*found, strict=True)))


def scales_of(inputs: NDArray, actions: NDArray) -> Scales:
    """Returns the standardisation of inputs and actions."""
    inputs = inputs.astype(np.float64)
    actions = actions.astype(np.float64)
    return Scales(
        input_mean=inputs.mean(axis=0).astype(np.float32),
        input_deviation=(inputs.std(axis=0) + INPUT_EPSILON).astype(np.float32),
        action_mean=actions.mean(axis=0).astype(np.float32),
        action_deviation=(actions.std(axis=0) + ACTION_EPSILON).astype(np.float32),
    )


# The network.


class Block(torch.nn.Module):
    """A residual block: normalisation of the layer, and two affine maps with SiLU units between them."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.norm = torch.nn.LayerNorm(width)
        self.first = torch.nn.Linear(width, width)
        self.second = torch.nn.Linear(width, width)

    def forward(self, values: torch.Tensor) -> torch.Tensor:
        return values + self.second(torch.nn.functional.silu(self.first(self.norm(values))))


class Network(torch.nn.Module):
    """An affine map, residual blocks, and another affine map."""

    def __init__(self, inputs: int, outputs: int, *, width: int, blocks: int) -> None:
        super().__init__()
        self.input = torch.nn.Linear(inputs, width)
        self.blocks = torch.nn.Sequential(*(Block(width) for _ in range(blocks)))
        self.output = torch.nn.Linear(width, outputs)

    def forward(self, values: torch.Tensor) -> torch.Tensor:
        return self.output(self.blocks(self.input(values)))

    def in_numpy(self) -> ResidualNetwork:
        """Returns the network as it is now, for a policy that acts with numpy alone."""
        arrays = {f"network.{name}": tensor.detach().clone().numpy() for name, tensor in self.state_dict().items()}
        return ResidualNetwork.take(arrays, "network")


def time_features(time: NDArray[np.float32]) -> NDArray[np.float32]:
    """Returns features `(..., 8)` of times `(..., 1)` in [0, 1]: sines and cosines of four frequencies."""
    angles = time * (np.pi * 2.0 ** np.arange(4, dtype=np.float32)).astype(np.float32)
    return np.concatenate([np.sin(angles), np.cos(angles)], axis=-1)


TIME_FEATURES = 8


# What is learned from.


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
    """Draws batches of recorded control steps."""

    def __init__(self, transitions: Transitions, scales: Scales, config: Config) -> None:
        self._transitions = transitions
        self._config = config
        self._inputs = torch.as_tensor(scales.inputs(transitions.inputs))
        self._actions = torch.as_tensor((transitions.actions - scales.action_mean) / scales.action_deviation)
        self._left = transitions.last - transitions.rows
        self._returns, self._succeeds = self._outcomes()

    def _outcomes(self) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Returns the discounted rewards `(m,)` of the next `n_step` steps, and whether success ended them."""
        count = len(self._transitions.rows)
        total = np.zeros(count)
        succeeds = np.zeros(count, np.bool_)
        for ahead in range(self._config.n_step):
            steps = np.minimum(np.arange(count) + ahead, count - 1)
            inside = ahead < self._left
            total += np.where(inside, self._config.discount**ahead * self._transitions.rewards[steps], 0.0)
            succeeds |= inside & self._transitions.terminations[steps]
        return total.astype(np.float32), succeeds

    def draw(self) -> Batch:
        """Draws a batch, with random numbers of PyTorch."""
        steps = torch.randint(len(self._transitions.rows), (self._config.batch_size,)).numpy()
        rows = self._transitions.rows[steps]
        ahead = np.minimum(self._left[steps], self._config.n_step)
        of_chunk = np.minimum(np.arange(self._config.chunk), self._left[steps][:, np.newaxis] - 1)
        return Batch(
            inputs=self._inputs[rows],
            chunks=self._actions[steps[:, np.newaxis] + of_chunk].flatten(1),
            later_inputs=self._inputs[rows + ahead],
            rewards=torch.as_tensor(self._returns[steps]),
            discounts=torch.as_tensor(~self._succeeds[steps] * self._config.discount**ahead).float(),
        )


# Values.


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


def flow_loss(network: Network, inputs: torch.Tensor, chunks: torch.Tensor) -> torch.Tensor:
    """Returns the squared error `()` of the velocity from noise to chunks `(b, n)`, at times drawn from U(0, 1)."""
    noise = torch.randn_like(chunks)
    time = torch.rand(len(chunks), 1)
    between = torch.lerp(noise, chunks, time)
    features = torch.as_tensor(time_features(time.numpy()))
    velocity = network(torch.cat([inputs, between, features], dim=1))
    return torch.nn.functional.mse_loss(velocity, chunks - noise)


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


def train(transitions: Transitions, config: Config, *, num_steps: int, seed: int) -> Learned:
    """Returns the networks after a number of steps of the optimiser."""
    # The matrices are small: with a second thread, training is slower.
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    scales = scales_of(transitions.inputs, transitions.actions)
    sampler = Sampler(transitions, scales, config)
    learner = Learner(transitions.inputs.shape[1], config.chunk * transitions.actions.shape[1], config)
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


# Acting.


class ChunkPolicy:
    """Predicts a chunk of actions, and applies the first ones before it predicts the next chunk."""

    _generator: np.random.Generator

    def __init__(
        self, learned: Learned, observed: PolicyInputs, config: Config, generators: Iterator[np.random.Generator]
    ) -> None:
        """Prepares to act by networks; `generators` are those of the noise of each episode in turn."""
        self._learned = learned
        self._observed = observed
        self._config = config
        self._generators = generators
        self._waiting: list[NDArray[np.float32]] = []

    def __call__(self, timestep: dm_env.TimeStep) -> NDArray[np.float32]:
        """Returns the action for a time step of an episode."""
        if timestep.first():
            self._generator = next(self._generators)
            self._waiting = []
        if not self._waiting:
            requested = requested_tasks(self._observed)
            inputs = self._observed.state_and_requests(timestep.observation, requested).ravel()
            self._waiting = [*self.predict(inputs)[: self._config.executed]]
        return self._waiting.pop(0)

    def predict(self, inputs: NDArray) -> NDArray[np.float32]:
        """Returns a chunk of actions `(c, k)` for inputs `(n,)`."""
        standardised = self._learned.scales.inputs(inputs)
        draws = self._config.extraction == "flow"
        values = self._best(standardised) if draws else self._learned.policy(standardised)
        return self._learned.scales.actions(values.reshape(self._config.chunk, -1))

    def _best(self, inputs: NDArray[np.float32]) -> NDArray[np.float32]:
        """Returns the most valuable one of some chunks `(c k,)` that flow matching draws."""
        size = self._learned.policy.outputs
        noise = self._generator.standard_normal((self._config.candidates, size), np.float32)
        groups = [self._carried(inputs, group) for group in np.split(noise, range(ROWS, len(noise), ROWS))]
        values = np.concatenate([self._values(inputs, group) for group in groups])
        return np.concatenate(groups)[values.argmax()]

    def _carried(self, inputs: NDArray[np.float32], chunks: NDArray[np.float32]) -> NDArray[np.float32]:
        """Returns the chunks `(b, c k)` that noise becomes, by Euler's method."""
        repeated = np.broadcast_to(inputs, (len(chunks), inputs.size))
        for step in range(self._config.flow_steps):
            time = time_features(np.array([step / self._config.flow_steps], np.float32))
            features = [repeated, chunks, np.broadcast_to(time, (len(chunks), time.size))]
            velocity = self._learned.policy(np.concatenate(features, axis=1))
            chunks = chunks + velocity / np.float32(self._config.flow_steps)
        return chunks

    def _values(self, inputs: NDArray[np.float32], chunks: NDArray[np.float32]) -> NDArray[np.float32]:
        """Returns the smaller one of both values `(b,)` of chunks `(b, c k)`."""
        pairs = np.concatenate([np.broadcast_to(inputs, (len(chunks), inputs.size)), chunks], axis=1)
        first, second = (critic(pairs)[:, 0] for critic in self._learned.critics)
        return np.minimum(first, second)


def main(arguments: Sequence[str] | None = None) -> None:
    """Trains and evaluates."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path, help="folder of kitchen-record")
    parser.add_argument("--output", type=Path, required=True, help="new folder of settings, scores and receipt")
    parser.add_argument("--num_steps", type=int, default=40_000, help="steps of the optimiser (%(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of the training (%(default)s)")
    parser.add_argument("--eval_episodes", type=int, default=100, help="(%(default)s)")
    parser.add_argument("--eval_seed", type=int, default=400_000_000, help="of the first episode (%(default)s)")
    for field in dataclasses.fields(Config):
        others = FLOW_DEFAULTS.get(field.name)
        shown = f"({field.default}" + (f"; by flow {others})" if others else ")")
        choices = ("weights", "flow") if field.name == "extraction" else None
        parser.add_argument(f"--{field.name}", type=type(field.default), choices=choices, help=shown)
    given = parser.parse_args(arguments)

    given.output.mkdir(parents=True)
    names = [field.name for field in dataclasses.fields(Config)]
    changes = {name: value for name in names if (value := getattr(given, name)) is not None}
    config = Config(**{**(FLOW_DEFAULTS if given.extraction == "flow" else {}), **changes})
    transitions = read_transitions(given.recording)
    started = time.process_time()
    learned = train(transitions, config, num_steps=given.num_steps, seed=given.seed)
    minutes = (time.process_time() - started) / 60
    trained = {"num_steps": given.num_steps, "seed": given.seed, "processor_minutes": minutes, **vars(config)}
    (given.output / "training.json").write_text(json.dumps(trained, indent=1) + "\n", encoding="utf-8")

    spec = read_spec(given.recording)
    task = {name: spec[name] for name in ("domain_name", "task_name", "task_kwargs")}
    # The noise of an episode depends on its seed alone; the 1 tells its stream from that of the environment.
    generators = (np.random.default_rng((seed, 1)) for seed in itertools.count(given.eval_seed))
    policy = ChunkPolicy(learned, policy_inputs(**task), config, generators)
    # One episode after the other, by time steps: the policy keeps a chunk of actions between control steps, and drops
    # it at the first time step of an episode.
    evaluation = kitchen_suite.evaluate(
        policy,
        takes="timestep",
        protocol="default",
        **task,
        num_episodes=given.eval_episodes,
        seed=given.eval_seed,
        num_envs=1,
        receipt=given.output / "receipt.npz",
        verbose=True,
    )
    (given.output / "evaluation.json").write_text(json.dumps(evaluation.as_json(), indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
