"""Networks of PyTorch as policies that act with numpy alone."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from kitchen_suite.policies import networks
from kitchen_suite.policies.perceptron import PerceptronPolicy


def perceptron(
    network: torch.nn.Sequential,
    *,
    mean: torch.Tensor,
    deviation: torch.Tensor,
    clip: float,
    action_scale: torch.Tensor,
    metadata: Mapping[str, Any],
) -> PerceptronPolicy:
    """Returns the policy of a multilayer perceptron on standardised observations; see the attributes of the policy."""
    layers = linear_layers(network)
    return PerceptronPolicy(
        mean=array(mean),
        deviation=array(deviation),
        clip=clip,
        weights=tuple(array(layer.weight) for layer in layers),
        biases=tuple(array(layer.bias) for layer in layers),
        action_scale=array(action_scale),
        metadata=metadata,
    )


def linear_layers(network: torch.nn.Sequential) -> list[torch.nn.Linear]:
    """Returns the affine layers of a network, in order."""
    return [layer for layer in network if isinstance(layer, torch.nn.Linear)]


def residual_network(module: torch.nn.Module) -> networks.ResidualNetwork:
    """Returns a network whose arrays have the names of `networks.ResidualNetwork`."""
    return networks.ResidualNetwork.take(_named(module, "network"), "network")


def picture_encoder(module: torch.nn.Module) -> networks.PictureEncoder:
    """Returns an encoder whose arrays have the names of `networks.PictureEncoder`."""
    return networks.PictureEncoder.take(_named(module, "encoder"), "encoder")


def array(tensor: torch.Tensor) -> NDArray[np.float32]:
    """Returns a copy of a tensor, which goes on changing in training."""
    return np.array(tensor.detach().numpy(), np.float32)


def _named(module: torch.nn.Module, name: str) -> dict[str, NDArray]:
    return {f"{name}.{key}": tensor.detach().clone().numpy() for key, tensor in module.state_dict().items()}
