"""Action chunking with transformers (ACT): learns from demonstrations to predict chunks of actions from states.

    kitchen-record --preset=fixed_order --variations=start --num_episodes=110 --output=demonstrations
    python docs/baselines/act.py demonstrations --output=act
    kitchen-replay act/receipt.npz

Learns from the successful episodes of one or several recordings of states, and evaluates the policy after the last
step. Of each predicted chunk some actions are applied, then the next one is predicted. Needs the extra `train`.

Source: Zhao et al., Learning Fine-Grained Bimanual Manipulation with Low-Cost Hardware, RSS 2023. It differs from the
paper in these: the state stands for the images, so that the networks are small; chunks are short and are not averaged
over time; the weights are averaged, and the learning rate falls like half a cosine.
"""

import dataclasses
import math
import time
from collections.abc import Iterator, Sequence

import baseline
import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from kitchen_suite.policies.networks import Scales
from kitchen_suite.tasks.policy_inputs import PolicyInputs
from kitchen_suite.training.bc import scales_of
from kitchen_suite.training.demonstrations import Demonstrations


@dataclasses.dataclass(frozen=True, kw_only=True)
class Config:
    """Hyperparameters.

    Attributes:
      width: values of a token.
      heads: number of heads of attention.
      layers: number of layers of each of the three transformers.
      latent: numbers that stand for the style of a chunk.
      divergence_weight: of the divergence of the latent from the standard normal in the loss.
      chunk: number of actions that are predicted at once.
      executed: number of these that are applied before the next prediction.
      batch_size: control steps of a step of the optimiser.
      learning_rate: of the optimiser (AdamW) at first; it falls to 0 like half a cosine.
      weight_decay: of the optimiser.
      averaging: decay of the moving average of the weights, which act.
    """

    width: int = 96
    heads: int = 4
    layers: int = 2
    latent: int = 8
    divergence_weight: float = 10.0
    chunk: int = 8
    executed: int = 4
    batch_size: int = 256
    learning_rate: float = 1e-3
    weight_decay: float = 1e-4
    averaging: float = 0.999


class ACT(nn.Module):
    """A conditional variational autoencoder of chunks of actions, whose parts are transformers."""

    def __init__(self, inputs: int, actions: int, config: Config) -> None:
        super().__init__()
        self._config = config
        sizes = {"nhead": config.heads, "dim_feedforward": 2 * config.width, "dropout": 0.0}
        shape = {"d_model": config.width, "batch_first": True, "norm_first": True, **sizes}
        options = {"num_layers": config.layers, "enable_nested_tensor": False}
        self.style_encoder = nn.TransformerEncoder(nn.TransformerEncoderLayer(**shape), **options)
        self.encoder = nn.TransformerEncoder(nn.TransformerEncoderLayer(**shape), **options)
        self.decoder = nn.TransformerDecoder(nn.TransformerDecoderLayer(**shape), config.layers)
        self.embed_inputs = nn.Linear(inputs, config.width)
        self.embed_actions = nn.Linear(actions, config.width)
        self.embed_latent = nn.Linear(config.latent, config.width)
        self.to_latent = nn.Linear(config.width, 2 * config.latent)
        self.to_actions = nn.Linear(config.width, actions)
        # Of the token of the style, of that of the state, and of those of the actions.
        self.places = nn.Parameter(0.02 * torch.randn(2 + config.chunk, config.width))
        self.queries = nn.Parameter(0.02 * torch.randn(config.chunk, config.width))

    def forward(self, inputs: torch.Tensor, latent: torch.Tensor) -> torch.Tensor:
        """Returns chunks of actions `(b, c, k)` for inputs `(b, n)` and a style `(b, l)`."""
        tokens = torch.stack([self.embed_latent(latent), self.embed_inputs(inputs)], dim=1) + self.places[:2]
        return self.to_actions(self.decoder(self.queries.expand(len(inputs), -1, -1), self.encoder(tokens)))

    def style(self, inputs: torch.Tensor, chunks: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Returns mean and logarithm of the variance `(b, l)` of the style of chunks `(b, c, k)`."""
        state = self.embed_inputs(inputs).unsqueeze(1)
        tokens = torch.cat([torch.zeros_like(state), state, self.embed_actions(chunks)], dim=1) + self.places
        mean, log_variance = self.to_latent(self.style_encoder(tokens)[:, 0]).chunk(2, dim=1)
        return mean, log_variance

    def loss(self, inputs: torch.Tensor, chunks: torch.Tensor) -> torch.Tensor:
        """Returns the absolute error `()` of chunks `(b, c, k)`, and the weighted divergence of their styles."""
        mean, log_variance = self.style(inputs, chunks)
        latent = mean + (0.5 * log_variance).exp() * torch.randn_like(mean)
        divergence = 0.5 * (mean.square() + log_variance.exp() - log_variance - 1.0).sum(dim=1).mean()
        error = torch.nn.functional.l1_loss(self(inputs, latent), chunks)
        return error + self._config.divergence_weight * divergence


def train(demonstrations: Demonstrations, config: Config, *, num_steps: int, seed: int) -> tuple[ACT, Scales]:
    """Returns the averaged network after a number of steps of the optimiser, and its standardisation."""
    # The matrices are small: with a second thread, training is slower.
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    scales = scales_of(demonstrations.inputs, demonstrations.actions, baseline.INPUT_EPSILON)
    inputs = torch.as_tensor(scales.inputs(demonstrations.inputs))
    actions = torch.as_tensor((demonstrations.actions - scales.action_mean) / scales.action_deviation)
    following = torch.as_tensor(demonstrations.chunks(config.chunk))

    network = ACT(inputs.shape[1], actions.shape[1], config)
    average = AveragedModel(network, multi_avg_fn=get_ema_multi_avg_fn(config.averaging))
    optimizer = torch.optim.AdamW(network.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay)
    for step in range(num_steps):
        for group in optimizer.param_groups:
            group["lr"] = config.learning_rate * (0.5 * (1 + math.cos(math.pi * (step / num_steps))))
        rows = torch.randint(len(inputs), (config.batch_size,))
        loss = network.loss(inputs[rows], actions[following[rows]])
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        average.update_parameters(network)
        if step % 1000 == 0:
            print(f"step {step:6,}  loss {loss.item():.4f}", flush=True)
    return average.module.eval(), scales


class ACTPolicy(baseline.ChunkPolicy):
    """Predicts chunks of actions of the mean style."""

    def __init__(
        self,
        network: ACT,
        scales: Scales,
        observed: PolicyInputs,
        config: Config,
        generators: Iterator[np.random.Generator],
    ) -> None:
        """Prepares to act by a network, which needs no random numbers."""
        super().__init__(observed, config.executed, generators)
        self._network = network
        self._scales = scales
        self._config = config

    @torch.no_grad()
    def predict(self, inputs: NDArray, generator: np.random.Generator) -> NDArray[np.float32]:
        """Returns a chunk of actions `(c, k)` for inputs `(n,)`."""
        standardised = torch.as_tensor(self._scales.inputs(inputs)).unsqueeze(0)
        chunks = self._network(standardised, torch.zeros(1, self._config.latent))
        return self._scales.actions(chunks[0].numpy())


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
    policy = ACTPolicy(network, scales, observed, config, baseline.generators(given.eval_seed))
    baseline.evaluate(policy, spec, given)


if __name__ == "__main__":
    main()
