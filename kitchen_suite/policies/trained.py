"""Trained policies as plain arrays: a network that needs nothing but numpy, in a file that is read without pickle."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import dm_env
import numpy as np
from dm_control import composer
from numpy.typing import NDArray

import kitchen_suite
from kitchen_suite import checks, files
from kitchen_suite.tasks import OpenCabinetTask

# Version of the file's layout; it grows when old readers would misread new files.
FORMAT = 1

# What the metadata must tell for a policy to be played.
_TASK = {"domain_name": str, "task_name": str, "task_kwargs": dict}

# Files that come with the package.
SHIPPED = Path(__file__).parent / "trained_policies"


@dataclasses.dataclass(frozen=True, kw_only=True)
class TrainedPolicy:
    """A multilayer perceptron with ELU units, on standardised observations.

    Attributes:
      mean: `(m,)`, of the observations.
      deviation: `(m,)`, what they are divided by; positive.
      clip: bound of the standardised observations.
      weights: of each layer, `(outputs, inputs)`.
      biases: of each layer, `(outputs,)`.
      action_scale: `(k,)`, action for an output of one.
      metadata: what JSON can hold: `domain_name`, `task_name`, `task_kwargs` and how the policy came about.
    """

    mean: NDArray[np.float32]
    deviation: NDArray[np.float32]
    clip: float
    weights: tuple[NDArray[np.float32], ...]
    biases: tuple[NDArray[np.float32], ...]
    action_scale: NDArray[np.float32]
    metadata: Mapping[str, Any]

    def __post_init__(self) -> None:
        """Checks that the parts fit.

        Raises:
          ValueError: they do not, or some of the numbers are not finite.
        """
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
    def observation_size(self) -> int:
        """How many numbers it observes."""
        return self.mean.size

    @property
    def action_size(self) -> int:
        """How many numbers it returns."""
        return self.action_scale.size

    def __call__(self, observations: NDArray) -> NDArray[np.float32]:
        """Actions `(..., k)` for observations `(..., m)`, without exploration."""
        values = ((observations - self.mean) / self.deviation).astype(np.float32)
        values = np.clip(values, -self.clip, self.clip)
        *hidden, last = zip(self.weights, self.biases, strict=True)
        for weight, bias in hidden:
            values = _elu(values @ weight.T + bias)
        weight, bias = last
        return (values @ weight.T + bias) * self.action_scale

    def save(self, path: Path) -> None:
        """Writes the policy to an npz file, whole or not at all."""
        arrays = {
            "mean": self.mean,
            "deviation": self.deviation,
            "clip": np.array(self.clip, np.float32),
            "action_scale": self.action_scale,
            **{f"weight_{i}": weight for i, weight in enumerate(self.weights)},
            **{f"bias_{i}": bias for i, bias in enumerate(self.biases)},
        }
        metadata = {**self.metadata, "format": FORMAT, "kitchen_suite": kitchen_suite.__version__}
        files.save_arrays(path, arrays, metadata)

    @classmethod
    def load(cls, path: Path) -> "TrainedPolicy":
        """Reads a policy.

        Raises:
          OSError: there is no such file, or it holds nothing of the kind.
          ValueError: its layout is of another version, or its parts do not fit together.
        """
        arrays, metadata = files.load_arrays(path, "a trained policy")
        _check_metadata(path, metadata)
        layers = range(sum(name.startswith("weight_") for name in arrays))
        try:
            return cls(
                mean=arrays["mean"],
                deviation=arrays["deviation"],
                clip=float(arrays["clip"]),
                weights=tuple(arrays[f"weight_{i}"] for i in layers),
                biases=tuple(arrays[f"bias_{i}"] for i in layers),
                action_scale=arrays["action_scale"],
                metadata=metadata,
            )
        except KeyError as error:
            raise ValueError(f"{path} holds no trained policy: {error} is missing") from error
        except (TypeError, ValueError) as error:
            raise ValueError(f"{path} holds no trained policy: {error}") from error

    def check_fits(self, observation_size: int, action_size: int) -> None:
        """Sees to it that the policy can act where observations and actions have these sizes.

        Raises:
          ValueError: it cannot.
        """
        own, asked = (self.observation_size, self.action_size), (observation_size, action_size)
        if own != asked:
            raise ValueError(
                f"the policy takes {own[0]} numbers and returns {own[1]}, but this task shows {asked[0]} and takes "
                f"{asked[1]}: it was trained for {self.metadata.get('domain_name')} {self.metadata.get('task_name')}"
            )


def _check_metadata(path: Path, metadata: Any) -> None:
    """Sees to it that a file says what it is.

    Raises:
      ValueError: it does not, or its layout is of another version.
    """
    if not isinstance(metadata, dict) or "format" not in metadata:
        raise ValueError(f"{path} holds no trained policy: it has no format version")
    if metadata["format"] != FORMAT:
        raise ValueError(f"{path} has format {metadata['format']!r}; this version reads {FORMAT}")
    for name, kind in _TASK.items():
        if not isinstance(metadata.get(name), kind):
            raise ValueError(f"{path} holds no trained policy: its {name} is {metadata.get(name)!r}")


def flat(observations: Any) -> NDArray:
    """Observations of a Gymnasium environment as a trained policy takes them, `(..., m)`.

    They are laid end to end in the order of the suite's own observation: the state, achieved goals, desired goals.

    Args:
      observations: `(..., m)`; or a dict as of the kitchen with `goal_format="flat"`.
    """
    if not isinstance(observations, Mapping):
        return observations
    keys = ("observation", "achieved_goal", "desired_goal")
    return np.concatenate([observations[key] for key in keys], axis=-1)


def flat_timestep(timestep: dm_env.TimeStep) -> NDArray:
    """The observation of one of the suite's own environments as a trained policy takes it, `(m,)`."""
    return np.concatenate([*timestep.observation.values()])


def shipped(task: composer.Task) -> Path:
    """Path of the policy that comes with the package for a task and its reward.

    Raises:
      ValueError: there is none.
    """
    if not isinstance(task, OpenCabinetTask):
        return shipped_as("_".join(task.goals).replace(" ", "_"))
    return shipped_as(f"{task.drawer}_drawer" + (f"_{task.reward_name}" if task.reward_name != "original" else ""))


def shipped_as(name: str) -> Path:
    """Path of a policy that comes with the package.

    Args:
      name: of the task, such as `top_drawer`; with `_grasp` for one that was trained for the reward of that name.

    Raises:
      ValueError: there is none.
    """
    there = sorted(path.stem for path in SHIPPED.glob("*.npz"))
    return SHIPPED / f"{checks.choice(name, there, 'trained policy that comes with the package')}.npz"


def _elu(values: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.where(values > 0, values, np.expm1(np.minimum(values, 0)))
