"""Flow matching: learns from demonstrations to carry noise to chunks of actions.

    kitchen-record --preset=fixed_order --variations=start --num_episodes=110 --output=demonstrations
    python docs/baselines/flow.py demonstrations --output=flow
    kitchen-replay flow/receipt.npz

Learns from the successful episodes of one or several recordings of states, and evaluates the policy after the last
step. Of each predicted chunk some actions are applied, then the next one is predicted. Needs the extra `train`.

Source: Lipman et al., Flow Matching for Generative Modeling, ICLR 2023. A residual network stands for the U-Net or
transformer of published policies; its weights are averaged, and its learning rate falls like half a cosine.
"""

import argparse
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


@dataclasses.dataclass(frozen=True, kw_only=True)
class Config:
    """Hyperparameters.

    Attributes:
      width: values between the blocks of the network.
      blocks: number of residual blocks.
      chunk: number of actions that are predicted at once.
      executed: number of these that are applied before the next prediction.
      flow_steps: steps of Euler's method in a prediction.
      batch_size: control steps of a step of the optimiser.
      learning_rate: of the optimiser (AdamW) at first; it falls to 0 like half a cosine.
      weight_decay: of the optimiser.
      averaging: decay of the moving average of the weights, which act.
    """

    width: int = 384
    blocks: int = 3
    chunk: int = 8
    executed: int = 4
    flow_steps: int = 8
    batch_size: int = 512
    learning_rate: float = 1e-3
    weight_decay: float = 1e-4
    averaging: float = 0.999


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
class Demonstrations:
    """Control steps of all episodes, one after the other.

    Attributes:
      inputs: `(m, n)`, float32: the state, and which tasks are requested.
      actions: `(m, k)`, float32.
      last: `(m,)`, index of the last step of each step's episode.
    """

    inputs: NDArray[np.float32]
    actions: NDArray[np.float32]
    last: NDArray[np.int64]


def read_demonstrations(folders: Sequence[Path], tasks: Sequence[str], count: int | None = None) -> Demonstrations:
    """Reads the successful episodes of recordings, at most `count` of each; requests of `tasks` are inputs."""
    inputs: list[NDArray[np.float32]] = []
    actions: list[NDArray[np.float32]] = []
    for folder in folders:
        spec = read_spec(folder)
        observed = policy_inputs(spec["domain_name"], spec["task_name"], spec["task_kwargs"])
        read = 0
        for path in sorted(folder.glob("episode_*.npz")):
            with np.load(path) as arrays:
                if read == count or not json.loads(str(arrays["metadata"]))["results"]["success"]:
                    continue
                observed_inputs = observed.state_and_requests(read_observation(arrays), tasks)
                inputs.append(observed_inputs[:-1].astype(np.float32))
                actions.append(arrays["action"].astype(np.float32))
            read += 1
        if not read:
            raise SystemExit(f"{folder} holds no successful episode")
    lengths = [len(each) for each in actions]
    last = np.repeat(np.cumsum(lengths) - 1, lengths)
    return Demonstrations(np.concatenate(inputs), np.concatenate(actions), last)


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


# Training.


def flow_loss(network: Network, inputs: torch.Tensor, chunks: torch.Tensor) -> torch.Tensor:
    """Returns the squared error `()` of the velocity from noise to chunks `(b, n)`, at times drawn from U(0, 1)."""
    noise = torch.randn_like(chunks)
    time = torch.rand(len(chunks), 1)
    between = torch.lerp(noise, chunks, time)
    features = torch.as_tensor(time_features(time.numpy()))
    velocity = network(torch.cat([inputs, between, features], dim=1))
    return torch.nn.functional.mse_loss(velocity, chunks - noise)


def train(
    demonstrations: Demonstrations, config: Config, *, num_steps: int, seed: int
) -> tuple[ResidualNetwork, Scales]:
    """Returns the averaged network after a number of steps of the optimiser, and its standardisation."""
    # The matrices are small: with a second thread, training is slower.
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    scales = scales_of(demonstrations.inputs, demonstrations.actions)
    inputs = torch.as_tensor(scales.inputs(demonstrations.inputs))
    actions = torch.as_tensor((demonstrations.actions - scales.action_mean) / scales.action_deviation)
    # The actions of each chunk; at the end of an episode the last one repeats.
    ahead = np.arange(len(actions))[:, np.newaxis] + np.arange(config.chunk)
    following = torch.as_tensor(np.minimum(ahead, demonstrations.last[:, np.newaxis]))

    size = config.chunk * actions.shape[1]
    network = Network(inputs.shape[1] + size + TIME_FEATURES, size, width=config.width, blocks=config.blocks)
    average = AveragedModel(network, multi_avg_fn=get_ema_multi_avg_fn(config.averaging))
    optimizer = torch.optim.AdamW(network.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay)
    for step in range(num_steps):
        for group in optimizer.param_groups:
            group["lr"] = config.learning_rate * (0.5 * (1 + math.cos(math.pi * (step / num_steps))))
        rows = torch.randint(len(inputs), (config.batch_size,))
        loss = flow_loss(network, inputs[rows], actions[following[rows]].flatten(1))
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        average.update_parameters(network)
        if step % 1000 == 0:
            print(f"step {step:6,}  loss {loss.item():.4f}", flush=True)
    return average.module.in_numpy(), scales


# Acting.


class FlowPolicy:
    """Predicts a chunk of actions, and applies the first ones before it predicts the next chunk."""

    _generator: np.random.Generator

    def __init__(
        self,
        network: ResidualNetwork,
        scales: Scales,
        observed: PolicyInputs,
        config: Config,
        generators: Iterator[np.random.Generator],
    ) -> None:
        """Prepares to act by a network; `generators` are those of the noise of each episode in turn."""
        self._network = network
        self._scales = scales
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
            tasks = requested_tasks(self._observed)
            inputs = self._observed.state_and_requests(timestep.observation, tasks).ravel()
            self._waiting = [*self.predict(inputs)[: self._config.executed]]
        return self._waiting.pop(0)

    def predict(self, inputs: NDArray) -> NDArray[np.float32]:
        """Returns a chunk of actions `(c, k)` for inputs `(n,)`."""
        standardised = self._scales.inputs(inputs)
        values = self._generator.standard_normal(self._network.outputs, np.float32)
        for step in range(self._config.flow_steps):
            time = time_features(np.array([step / self._config.flow_steps], np.float32))
            velocity = self._network(np.concatenate([standardised, values, time]))
            values = values + velocity / np.float32(self._config.flow_steps)
        return self._scales.actions(values.reshape(self._config.chunk, -1))


def main(arguments: Sequence[str] | None = None) -> None:
    """Trains and evaluates."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recordings", type=Path, nargs="+", help="folders of kitchen-record")
    parser.add_argument("--output", type=Path, required=True, help="new folder of settings, scores and receipt")
    parser.add_argument("--num_demonstrations", type=int, help="episodes of each recording; all without it")
    parser.add_argument("--num_steps", type=int, default=12_000, help="steps of the optimiser (%(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of the training (%(default)s)")
    parser.add_argument("--task_name", help="to evaluate on; that of the recording without it")
    parser.add_argument("--task_kwargs", type=json.loads, help="of that task, as JSON; the recording's without it")
    parser.add_argument("--eval_episodes", type=int, default=100, help="(%(default)s)")
    parser.add_argument("--eval_seed", type=int, default=400_000_000, help="of the first episode (%(default)s)")
    for field in dataclasses.fields(Config):
        parser.add_argument(f"--{field.name}", type=type(field.default), default=field.default, help="(%(default)s)")
    given = parser.parse_args(arguments)

    given.output.mkdir(parents=True)
    config = Config(**{field.name: getattr(given, field.name) for field in dataclasses.fields(Config)})
    recorded = read_spec(given.recordings[0])
    task = {
        "domain_name": recorded["domain_name"],
        "task_name": given.task_name or recorded["task_name"],
        "task_kwargs": recorded["task_kwargs"] if given.task_kwargs is None else given.task_kwargs,
    }
    observed = policy_inputs(**task)
    demonstrations = read_demonstrations(given.recordings, requested_tasks(observed), given.num_demonstrations)
    started = time.process_time()
    network, scales = train(demonstrations, config, num_steps=given.num_steps, seed=given.seed)
    minutes = (time.process_time() - started) / 60
    trained = {"num_steps": given.num_steps, "seed": given.seed, "processor_minutes": minutes, **vars(config)}
    (given.output / "training.json").write_text(json.dumps(trained, indent=1) + "\n", encoding="utf-8")

    # The noise of an episode depends on its seed alone; the 1 tells its stream from that of the environment.
    generators = (np.random.default_rng((seed, 1)) for seed in itertools.count(given.eval_seed))
    policy = FlowPolicy(network, scales, observed, config, generators)
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
