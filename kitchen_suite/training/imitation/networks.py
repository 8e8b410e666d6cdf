"""Residual networks in PyTorch, with the arrays of `policies.residual_network` under the same names."""

import torch

from kitchen_suite.policies import residual_network


class Block(torch.nn.Module):
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


class ResidualNetwork(torch.nn.Module):
    """An affine map, residual blocks, and another affine map."""

    def __init__(self, inputs: int, outputs: int, *, width: int, blocks: int) -> None:
        """Builds the network.

        Args:
          inputs: number of values that it takes.
          outputs: number of values that it returns.
          width: number of values between the blocks.
          blocks: number of blocks.
        """
        super().__init__()
        self.input = torch.nn.Linear(inputs, width)
        self.blocks = torch.nn.Sequential(*(Block(width) for _ in range(blocks)))
        self.output = torch.nn.Linear(width, outputs)

    def forward(self, values: torch.Tensor) -> torch.Tensor:
        """Returns `(b, n)` for values `(b, m)`."""
        return self.output(self.blocks(self.input(values)))

    def export(self) -> residual_network.ResidualNetwork:
        """Returns the network as it is now, in numpy."""
        arrays = {f"network.{name}": tensor.detach().clone().numpy() for name, tensor in self.state_dict().items()}
        return residual_network.ResidualNetwork.take(arrays, "network")
