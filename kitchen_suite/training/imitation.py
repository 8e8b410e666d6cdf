"""Losses of the algorithms of imitation, on standardised inputs `(b, m)` and chunks `(b, n)`."""

import abc
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from vector_quantize_pytorch import ResidualVQ

from kitchen_suite.policies import networks
from kitchen_suite.policies.imitated import ClonedPolicy, FlowPolicy, ImitatedPolicy, TokenPolicy, time_features
from kitchen_suite.training.hyperparameters import FlowHyperparameters, ImitationHyperparameters, TokenHyperparameters

# Encoder and decoder of chunks are small beside the network that predicts codes.
_CODER_WIDTH, _CODER_BLOCKS = 128, 1

_CODE_DECAY = 0.99  # Decay of the exponential moving averages of code vectors.
_COMMITMENT = 0.25  # Factor of the distance of encoded chunks from their codes.


class TorchBlock(torch.nn.Module):
    """A residual block: normalisation of the layer, and two affine maps with SiLU units between them."""

    def __init__(self, width: int) -> None:
        """Builds a block of `width` values."""
        super().__init__()
        self.norm = torch.nn.LayerNorm(width)
        self.first = torch.nn.Linear(width, width)
        self.second = torch.nn.Linear(width, width)

    def forward(self, values: torch.Tensor) -> torch.Tensor:
        """Returns `(b, w)` for values `(b, w)`."""
        return values + self.second(torch.nn.functional.silu(self.first(self.norm(values))))


class TorchNetwork(torch.nn.Module):
    """An affine map, residual blocks, and another affine map."""

    def __init__(self, inputs: int, outputs: int, *, width: int, blocks: int) -> None:
        """Builds the network from `inputs` to `outputs` values, with blocks of `width` values between them."""
        super().__init__()
        self.input = torch.nn.Linear(inputs, width)
        self.blocks = torch.nn.Sequential(*(TorchBlock(width) for _ in range(blocks)))
        self.output = torch.nn.Linear(width, outputs)

    def forward(self, values: torch.Tensor) -> torch.Tensor:
        """Returns `(b, n)` for values `(b, m)`."""
        return self.output(self.blocks(self.input(values)))

    def export(self) -> networks.ResidualNetwork:
        """Returns the network as it is now, in numpy."""
        arrays = {f"network.{name}": tensor.detach().clone().numpy() for name, tensor in self.state_dict().items()}
        return networks.ResidualNetwork.take(arrays, "network")


_CONVOLUTIONS = ((5, 16), (3, 32), (3, 32))  # Sizes and channels of the convolutions of pictures.


class TorchEncoder(torch.nn.Module):
    """Convolutions of a picture that halve its height and width, and an affine map to features."""

    def __init__(self, height: int, width: int, features: int) -> None:
        """Builds the encoder of pictures of a size [pixels]."""
        super().__init__()
        self.convolutions = torch.nn.ModuleList()
        channels = 3
        for size, outputs in _CONVOLUTIONS:
            self.convolutions.append(torch.nn.Conv2d(channels, outputs, size, stride=2, padding=size // 2))
            channels, height, width = outputs, (height + 1) // 2, (width + 1) // 2
        self.output = torch.nn.Linear(channels * height * width, features)

    def forward(self, pictures: torch.Tensor) -> torch.Tensor:
        """Returns features `(b, n)` of pictures `(b, h, w, 3)`, float32 in [0, 1]."""
        values = pictures.permute(0, 3, 1, 2) - 0.5
        for convolution in self.convolutions:
            values = torch.nn.functional.relu(convolution(values))
        return self.output(values.flatten(1))

    def export(self) -> networks.PictureEncoder:
        """Returns the encoder as it is now, in numpy."""
        arrays = {f"encoder.{name}": tensor.detach().clone().numpy() for name, tensor in self.state_dict().items()}
        return networks.PictureEncoder.take(arrays, "encoder")


def augmented(pictures: torch.Tensor, config: ImitationHyperparameters) -> torch.Tensor:
    """Returns pictures `(b, h, w, 3)`, uint8, displaced and tinted at random, as float32 in [0, 1]."""
    (count, h, w, _), shift = pictures.shape, config.shift
    # Beyond the edge a picture goes on as at the edge. Slices of a wider copy take a fraction of the time of indices.
    wider = np.pad(pictures.numpy(), ((0, 0), (shift, shift), (shift, shift), (0, 0)), mode="edge")
    places = torch.randint(0, 2 * shift + 1, (count, 2)).tolist()
    moved = np.stack([each[top : top + h, left : left + w] for each, (top, left) in zip(wider, places, strict=True)])
    gain, offset = (config.tint * (2 * torch.rand(count, 1, 1, 3) - 1) for _ in range(2))
    # (value - 0.5) (1 + gain) + 0.5 + offset / 2, of values in [0, 1].
    return torch.from_numpy(moved).float().div_(255).mul_(1 + gain).add_((offset - gain) / 2).clamp_(0, 1)


class Method(torch.nn.Module, abc.ABC):
    """Networks of an algorithm, and its loss.

    Attributes:
      title: name of the algorithm.
      policy_class: class of the policies that it exports.
      hyperparameters: class of its hyperparameters, a `ChunkHyperparameters`.
      network: that acts, from inputs `(b, m)` to chunks of actions `(b, n)` or to numbers that determine them.
    """

    title: ClassVar[str]
    policy_class: ClassVar[type[ImitatedPolicy]] = ClonedPolicy
    hyperparameters: ClassVar[type[Any]]

    def __init__(self, inputs: int, outputs: int, config: Any) -> None:
        """Builds the networks for `inputs` and `outputs` values."""
        super().__init__()
        self.config = config
        self.network = self._make_network(inputs, outputs)

    def _make_network(self, inputs: int, outputs: int) -> TorchNetwork:
        return TorchNetwork(inputs, outputs, width=self.config.width, blocks=self.config.blocks)

    def update_targets(self) -> None:
        """Moves target networks, if it has some, towards those that learn, after a step of the optimiser."""

    def settings(self) -> dict[str, Any]:
        """Returns the metadata that only policies of this algorithm have."""
        return {}


class ImitationMethod(Method):
    """A method of imitation.

    Attributes:
      encoders: of the pictures of each camera, whose features are the last inputs; set by the learner where it sees.
    """

    hyperparameters = ImitationHyperparameters

    encoders: torch.nn.ModuleList

    def see(self, inputs: torch.Tensor, pictures: Sequence[torch.Tensor]) -> torch.Tensor:
        """Returns inputs `(b, m)` with the features of pictures `(b, h, w, 3)` of each camera, in [0, 1]."""
        if not pictures:
            return inputs
        features = [encoder(each) for encoder, each in zip(self.encoders, pictures, strict=True)]
        return torch.cat([inputs, *features], dim=1)

    @abc.abstractmethod
    def loss(self, inputs: torch.Tensor, chunks: torch.Tensor, step: int) -> torch.Tensor:
        """Returns the loss `()` of inputs `(b, m)` and chunks `(b, n)` in a step of the optimiser, counted from 0."""

    def tables(self) -> dict[str, NDArray[np.float32]]:
        """Returns the policy's arrays beside those of networks."""
        return {}


class Cloning(ImitationMethod):
    """Behaviour cloning: the mean absolute error of chunks."""

    title = "Behaviour cloning"

    def loss(self, inputs: torch.Tensor, chunks: torch.Tensor, step: int) -> torch.Tensor:
        return torch.nn.functional.l1_loss(self.network(inputs), chunks)


class Flow(ImitationMethod):
    """Flow matching: the velocity of straight lines from noise to chunks, at times drawn from U(0, 1)."""

    title = "Flow matching"
    policy_class = FlowPolicy
    hyperparameters = FlowHyperparameters

    def _make_network(self, inputs: int, outputs: int) -> TorchNetwork:
        return super()._make_network(inputs + outputs + len(time_features(0.0)), outputs)

    def loss(self, inputs: torch.Tensor, chunks: torch.Tensor, step: int) -> torch.Tensor:
        noise, time = torch.randn_like(chunks), torch.rand(len(chunks), 1)
        between = torch.lerp(noise, chunks, time)
        features = torch.as_tensor(time_features(time.numpy()))
        velocity = self.network(torch.cat([inputs, between, features], dim=1))
        return torch.nn.functional.mse_loss(velocity, chunks - noise)

    def settings(self) -> dict[str, Any]:
        return {"flow_steps": self.config.flow_steps}


class Tokens(ImitationMethod):
    """VQ-BeT: first an autoencoder of chunks with residual codes, then a classifier of codes with offsets of chunks."""

    title = "VQ-BeT"
    policy_class = TokenPolicy
    hyperparameters = TokenHyperparameters

    def _make_network(self, inputs: int, outputs: int) -> TorchNetwork:
        config, coder = self.config, {"width": _CODER_WIDTH, "blocks": _CODER_BLOCKS}
        self.encoder = TorchNetwork(outputs, config.latent, **coder)
        self.decoder = TorchNetwork(config.latent, outputs, **coder)
        sizes = {"dim": config.latent, "num_quantizers": config.codebooks, "codebook_size": config.codes}
        fitting = {"decay": _CODE_DECAY, "commitment_weight": _COMMITMENT, "threshold_ema_dead_code": 2}
        self.quantizer = ResidualVQ(**sizes, **fitting, kmeans_init=True)
        return super()._make_network(inputs, config.codebooks * config.codes * (1 + outputs))

    def loss(self, inputs: torch.Tensor, chunks: torch.Tensor, step: int) -> torch.Tensor:
        config, size = self.config, chunks.shape[1]
        if step < config.quantizer_steps:
            self.quantizer.train()
            latent, _, commitment = self.quantizer(self.encoder(chunks))
            return torch.nn.functional.l1_loss(self.decoder(latent), chunks) + commitment.sum()
        with torch.no_grad():
            self.quantizer.eval()
            latent, codes, _ = self.quantizer(self.encoder(chunks))
            decoded = self.decoder(latent)
        count = config.codebooks * config.codes
        logits, offsets = self.network(inputs).split([count, count * size], dim=1)
        logits = logits.reshape(-1, config.codebooks, config.codes)
        likelihood = torch.nn.functional.cross_entropy(logits.flatten(0, 1), codes.flatten())
        offsets = offsets.reshape(-1, config.codebooks, config.codes, size)
        chosen = offsets.gather(2, codes[..., None, None].expand(-1, -1, 1, size)).sum(dim=(1, 2))
        return likelihood + config.offset_scale * torch.nn.functional.l1_loss(decoded + chosen, chunks)

    def tables(self) -> dict[str, NDArray[np.float32]]:
        return {"codebooks": self.quantizer.codebooks.detach().clone().numpy()}


METHODS: Mapping[str, Any] = MappingProxyType({each.policy_class.algorithm: each for each in (Cloning, Flow, Tokens)})
