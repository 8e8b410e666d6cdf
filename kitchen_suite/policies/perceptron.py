"""Policies whose network is a multilayer perceptron, which PPO trains."""

import dataclasses
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.policies.files import EpisodePolicy, StoredPolicy

if TYPE_CHECKING:
    from kitchen_suite.tasks.task import SuiteTask


@dataclasses.dataclass(frozen=True, kw_only=True, repr=False)
class PerceptronPolicy(StoredPolicy):
    """A multilayer perceptron with ELU activations on standardised observations.

    Attributes:
      mean: `(m,)`, means of the observations.
      deviation: `(m,)`, standard deviations of the observations; positive.
      clip: bound of the standardised observations.
      weights: `(outputs, inputs)` for each layer.
      biases: `(outputs,)` for each layer.
      action_scale: `(k,)`, action at a network output of one.
      metadata: JSON-compatible; `domain_name`, `task_name`, `task_kwargs` and a record of the training.
    """

    algorithm = "ppo"

    mean: NDArray[np.float32]
    deviation: NDArray[np.float32]
    clip: float
    weights: tuple[NDArray[np.float32], ...]
    biases: tuple[NDArray[np.float32], ...]
    action_scale: NDArray[np.float32]
    metadata: Mapping[str, Any]

    def __post_init__(self) -> None:
        """Checks the arrays."""
        if not self.weights or len(self.weights) != len(self.biases):
            raise ValueError(f"there are {len(self.weights)} layers of weights and {len(self.biases)} of biases")
        sizes = [self.mean.size, *(bias.size for bias in self.biases)]
        expected = [
            ("mean", self.mean, (sizes[0],)),
            ("deviation", self.deviation, (sizes[0],)),
            ("action_scale", self.action_scale, (sizes[-1],)),
            *((f"weight_{i}", weight, (sizes[i + 1], sizes[i])) for i, weight in enumerate(self.weights)),
            *((f"bias_{i}", bias, (sizes[i + 1],)) for i, bias in enumerate(self.biases)),
        ]
        for name, array, shape in expected:
            if array.shape != shape or array.dtype != np.float32:
                raise ValueError(f"{name} must be float32 of shape {shape}, not {array.dtype} of shape {array.shape}")
            if not np.isfinite(array).all():
                raise ValueError(f"{name} must be finite")
        if not (self.deviation > 0).all() or not self.clip > 0:
            raise ValueError("deviation and clip must be positive")

    @property
    def layers(self) -> list[int]:
        return [self.observation_size, *(bias.size for bias in self.biases)]

    @property
    def observation_size(self) -> int:
        """Number of elements of the observation."""
        return self.mean.size

    @property
    def action_size(self) -> int:
        return self.action_scale.size

    def inputs(self, observation: NDArray | Mapping[str, Any], task: "SuiteTask") -> NDArray:
        """Returns the inputs `(..., m)`, given observations of a task as `PolicyInputs.flatten`."""
        return task.policy_inputs.flatten(observation)

    def __call__(self, observations: NDArray) -> NDArray[np.float32]:
        """Returns the actions `(..., k)` for observations `(..., m)`, without exploration noise."""
        values = ((observations - self.mean) / self.deviation).astype(np.float32)
        values = np.clip(values, -self.clip, self.clip)
        *hidden, (last_weight, last_bias) = zip(self.weights, self.biases, strict=True)
        for weight, bias in hidden:
            values = values @ weight.T + bias
            values = np.where(values > 0, values, np.expm1(np.minimum(values, 0)))
        return (values @ last_weight.T + last_bias) * self.action_scale

    @property
    def arrays(self) -> dict[str, NDArray]:
        return {
            "mean": self.mean,
            "deviation": self.deviation,
            "clip": np.array(self.clip, np.float32),
            "action_scale": self.action_scale,
            **{f"weight_{i}": weight for i, weight in enumerate(self.weights)},
            **{f"bias_{i}": bias for i, bias in enumerate(self.biases)},
        }

    @classmethod
    def from_arrays(cls, arrays: dict[str, NDArray], metadata: Mapping[str, Any]) -> Self:
        layers = range(sum(name.startswith("weight_") for name in arrays))
        of_layers = [f"{kind}_{i}" for kind in ("weight", "bias") for i in layers]
        if odd := sorted(arrays.keys() ^ {"mean", "deviation", "clip", "action_scale", *of_layers}):
            raise ValueError(f"missing or unknown arrays {odd}")
        clip = arrays["clip"]
        if clip.shape != () or clip.dtype.kind not in "fiu":
            raise ValueError(f"clip must be a number, not {clip.dtype} of shape {clip.shape}")
        own: dict[str, Any] = {name: arrays[name] for name in ("mean", "deviation", "action_scale")}
        weights, biases = (tuple(arrays[f"{kind}_{i}"] for i in layers) for kind in ("weight", "bias"))
        return cls(**own, clip=float(clip), weights=weights, biases=biases, metadata=metadata)

    def check_fits(self, task: "SuiteTask") -> None:
        self._check_sizes_and_mode(task, observed=self.observation_size, expected=task.policy_inputs.size)

    def _acting(self, task: "SuiteTask") -> EpisodePolicy:
        return lambda timestep: self(self.inputs(timestep.observation, task).ravel())
