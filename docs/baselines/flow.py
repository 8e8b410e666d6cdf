"""Flow matching: learns from demonstrations to carry noise to chunks of actions.

    kitchen-record --preset=fixed_order --variations=start --num_episodes=110 --output=demonstrations
    python docs/baselines/flow.py demonstrations --output=flow
    kitchen-replay flow/receipt.npz

Learns from the successful episodes of one or several recordings of states, and evaluates the policy after the last
step. Of each predicted chunk some actions are applied, then the next one is predicted. Needs the extra `train`.

Source: Lipman et al., Flow Matching for Generative Modeling, ICLR 2023. A residual network stands for the U-Net or
transformer of published policies; its weights are averaged, and its learning rate falls like half a cosine.
"""

import dataclasses
import math
import time
from collections.abc import Iterator, Sequence

import baseline
import numpy as np
import torch
from numpy.typing import NDArray
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from kitchen_suite.policies.networks import ResidualNetwork, Scales
from kitchen_suite.tasks.policy_inputs import PolicyInputs
from kitchen_suite.training.bc import Network, scales_of
from kitchen_suite.training.demonstrations import Demonstrations


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


def time_features(time: NDArray[np.float32]) -> NDArray[np.float32]:
    """Returns features `(..., 8)` of times `(..., 1)` in [0, 1]: sines and cosines of four frequencies."""
    angles = time * (np.pi * 2.0 ** np.arange(4, dtype=np.float32)).astype(np.float32)
    return np.concatenate([np.sin(angles), np.cos(angles)], axis=-1)


TIME_FEATURES = 8


def flow_loss(network: Network, inputs: torch.Tensor, chunks: torch.Tensor) -> torch.Tensor:
    """Returns the squared error `()` of the velocity from noise to chunks `(b, n)`, at times drawn from U(0, 1)."""
    noise = torch.randn_like(chunks)
    time = torch.rand(len(chunks), 1)
    between = torch.lerp(noise, chunks, time)
    features = torch.as_tensor(time_features(time.numpy()))
    velocity = network(torch.cat([inputs, between, features], dim=1))
    return torch.nn.functional.mse_loss(velocity, chunks - noise)


def carry(network: ResidualNetwork, inputs: NDArray, noise: NDArray, steps: int) -> NDArray[np.float32]:
    """Returns the chunks `(..., c k)` that noise of that shape becomes for inputs `(n,)`, by Euler's method."""
    leading = noise.shape[:-1]
    inputs = np.broadcast_to(inputs, (*leading, inputs.size))
    chunks = noise
    for step in range(steps):
        features = time_features(np.array([step / steps], np.float32))
        features = np.broadcast_to(features, (*leading, features.size))
        velocity = network(np.concatenate([inputs, chunks, features], axis=-1))
        chunks = chunks + velocity / np.float32(steps)
    return chunks


def train(
    demonstrations: Demonstrations, config: Config, *, num_steps: int, seed: int
) -> tuple[ResidualNetwork, Scales]:
    """Returns the averaged network after a number of steps of the optimiser, and its standardisation."""
    # The matrices are small: with a second thread, training is slower.
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    scales = scales_of(demonstrations.inputs, demonstrations.actions, baseline.INPUT_EPSILON)
    inputs = torch.as_tensor(scales.inputs(demonstrations.inputs))
    actions = torch.as_tensor((demonstrations.actions - scales.action_mean) / scales.action_deviation)
    following = torch.as_tensor(demonstrations.chunks(config.chunk))

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


class FlowPolicy(baseline.ChunkPolicy):
    """Draws chunks of actions."""

    def __init__(
        self,
        network: ResidualNetwork,
        scales: Scales,
        observed: PolicyInputs,
        config: Config,
        generators: Iterator[np.random.Generator],
    ) -> None:
        """Prepares to act by a network; `generators` are those of the noise of each episode in turn."""
        super().__init__(observed, config.executed, generators)
        self._network = network
        self._scales = scales
        self._config = config

    def predict(self, inputs: NDArray, generator: np.random.Generator) -> NDArray[np.float32]:
        """Returns a chunk of actions `(c, k)` for inputs `(n,)`."""
        noise = generator.standard_normal(self._network.outputs, np.float32)
        values = carry(self._network, self._scales.inputs(inputs), noise, self._config.flow_steps)
        return self._scales.actions(values.reshape(self._config.chunk, -1))


def main(arguments: Sequence[str] | None = None) -> None:
    """Trains and evaluates."""
    parser = baseline.make_parser(__doc__, Config, num_steps=12_000)
    baseline.add_demonstrations(parser)
    given = parser.parse_args(arguments)

    given.output.mkdir(parents=True)
    config = Config(**baseline.changes(Config, given))
    spec, observed, demonstrations = baseline.load_demonstrations(given)
    started = time.process_time()
    network, scales = train(demonstrations, config, num_steps=given.num_steps, seed=given.seed)
    baseline.write_training(given, config, time.process_time() - started)
    policy = FlowPolicy(network, scales, observed, config, baseline.generators(given.eval_seed))
    baseline.evaluate(policy, spec, given)


if __name__ == "__main__":
    main()
