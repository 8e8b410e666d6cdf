"""Policies that predict the actions of several control steps at once, a chunk, and act with numpy alone.

Behaviour cloning trains them, and PPO trains on those that apply one action of each chunk.

The input of a policy is the state that it observes, without goals, and which of its tasks are requested. It therefore
acts in every task that asks for some of them, whatever goals the observation has. A policy that sees has the robot's
part of the state alone, and the pictures of some cameras.
"""

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Self

import dm_env
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from kitchen_suite import checks, files
from kitchen_suite.policies.files import EpisodePolicy, StoredPolicy
from kitchen_suite.policies.networks import Linear, PictureEncoder, ResidualNetwork, Scales

if TYPE_CHECKING:
    from kitchen_suite.tasks.task import SuiteTask


_Count = Annotated[int, Meta(ge=1)]


@dataclasses.dataclass(frozen=True, kw_only=True)
class ChunkMetadata:
    """The metadata of a `ChunkPolicy` on its inputs and chunks.

    Attributes:
      chunk: number of actions that are predicted at once.
      executed: how many of them are applied before the next prediction.
      state_size: number of elements of the state among the inputs.
      tasks: those whose request is an input; empty if none is.
      state_elements: indices of the elements of the state among the inputs, increasing; None for all.
      extra_observables: number of elements of each extra observable among the inputs, by name; None in files of earlier
        versions, whose policies take all that a task has.
      layout: values of extra observables that are always the same in the default layout, where tasks may lack them.
      cameras: names of the cameras whose pictures it takes.
      image_size: height and width of these pictures.
    """

    chunk: _Count
    executed: _Count
    state_size: _Count
    tasks: list[str]
    state_elements: list[int] | None = None
    extra_observables: dict[str, int] | None = None
    layout: dict[str, list[float]] = dataclasses.field(default_factory=dict)
    cameras: list[str] = dataclasses.field(default_factory=list)
    image_size: tuple[int, int] = (0, 0)

    def __post_init__(self) -> None:
        """Checks that the entries fit together."""
        if self.executed > self.chunk:
            raise ValueError(f"executed is {self.executed}, but a chunk has {self.chunk} actions")
        elements = self.state_elements
        if elements is not None and (len(elements) != self.state_size or (np.diff([-1, *elements]) <= 0).any()):
            shown = checks.shown(elements)
            raise ValueError(f"state_elements must be {self.state_size} increasing indices, got {shown}")
        sizes = self.extra_observables or {}
        if wrong := [name for name, values in self.layout.items() if sizes.get(name) != len(values)]:
            raise ValueError(f"layout has values of {wrong} that do not fit the extra_observables {sizes}")


@dataclasses.dataclass(frozen=True, kw_only=True, repr=False)
class ChunkPolicy(StoredPolicy):
    """A network that predicts chunks of actions.

    Attributes:
      scales: of inputs and actions.
      network: from standardised inputs and features of pictures to the standardised actions of a chunk.
      encoders: of the pictures of its cameras, whose features are the last inputs of the network.
      metadata: JSON-compatible; beside what every stored policy has, `algorithm` and the attributes of
        `ChunkMetadata`. The last elements of the state are of extra observables.
    """

    algorithm = "bc"

    scales: Scales
    network: ResidualNetwork
    encoders: tuple[PictureEncoder, ...] = ()
    metadata: Mapping[str, Any]

    def __post_init__(self) -> None:
        """Checks that all parts fit together."""
        given = self.given
        size = given.state_size + len(given.tasks)
        if self.scales.input_mean.size != size:
            raise ValueError(f"there are {self.scales.input_mean.size} inputs, but state and tasks have {size}")
        if len(given.cameras) != len(self.encoders):
            raise ValueError(f"there are {len(self.encoders)} encoders for the cameras {given.cameras}")
        for encoder in self.encoders:
            encoder.check_takes(*given.image_size)
        found = (self.network.inputs, self.network.outputs)
        expected = (size + sum(encoder.features for encoder in self.encoders), given.chunk * self.action_size)
        if found != expected:
            raise ValueError(f"the network maps {found[0]} values to {found[1]}, not {expected[0]} to {expected[1]}")

    @functools.cached_property
    def given(self) -> ChunkMetadata:
        """The entries of the metadata on inputs and chunks; raises a ValueError for others than these may be."""
        return files.parse(self.metadata, ChunkMetadata, "metadata")

    def missing_observables(self, task: "SuiteTask") -> list[str]:
        known = {*task.extra_slices, *(() if task.variations.layout else self.given.layout)}
        return [name for name in self.given.extra_observables or {} if name not in known]

    def inputs(self, observation: NDArray | Mapping[str, Any], task: "SuiteTask") -> NDArray[np.float64]:
        """Returns the inputs `(..., m)` of the networks, given observations of a task as `PolicyInputs.flatten`."""
        observed = task.policy_inputs.state_and_requests(observation, self.given.tasks)
        return self.select(self._with_extras(observed, task))

    def select(self, inputs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the inputs `(..., m)` of the networks, given the whole state and which of `tasks` are requested."""
        given = self.given
        if given.state_elements is None:
            return inputs
        state, requests = np.split(inputs, [inputs.shape[-1] - len(given.tasks)], axis=-1)
        return np.concatenate([state[..., given.state_elements], requests], axis=-1)

    def _with_extras(self, inputs: NDArray[np.float64], task: "SuiteTask") -> NDArray[np.float64]:
        """Returns the inputs that `select` takes, given a task's state, which may have other extra observables."""
        given = self.given
        size = task.policy_inputs.state_size
        parts = task.extra_slices
        if given.extra_observables is None:
            return inputs
        own, extras, requests = np.split(inputs, [size - task.extra_size, size], axis=-1)
        shape = inputs.shape[:-1]
        chosen = [
            extras[..., parts[name]] if name in parts else np.broadcast_to(given.layout[name], (*shape, count))
            for name, count in given.extra_observables.items()
        ]
        return np.concatenate([own, *chosen, requests], axis=-1)

    def of_single_actions(self) -> Self:
        """Returns the policy that predicts the first action of each chunk alone, and so acts as this one.

        Raises a ValueError if this one applies several actions of a chunk.
        """
        if self.given.executed > 1:
            raise ValueError(f"it applies {self.given.executed} actions of each chunk: clone again with executed 1")
        weight, bias = self.network.output
        first = Linear(weight[: self.action_size], bias[: self.action_size])
        network = self.network._replace(output=first)
        return dataclasses.replace(self, network=network, metadata={**self.metadata, "chunk": 1})

    @property
    def action_size(self) -> int:
        return self.scales.action_mean.size

    @property
    def mean(self) -> NDArray[np.float32]:
        """`(m,)`, means of the inputs."""
        return self.scales.input_mean

    @property
    def deviation(self) -> NDArray[np.float32]:
        """`(m,)`, standard deviations of the inputs."""
        return self.scales.input_deviation

    @property
    def action_scale(self) -> NDArray[np.float32]:
        """`(k,)`, standard deviations of the actions, in units of which the network predicts them."""
        return self.scales.action_deviation

    @property
    def layers(self) -> list[int]:
        network = self.network
        return [network.inputs, *(block.first.bias.size for block in network.blocks), network.outputs]

    def __call__(self, inputs: NDArray) -> NDArray[np.float32]:
        """Returns the first actions `(..., k)` of the chunks that follow inputs `(..., m)`, without pictures."""
        values = self.network(self.scales.inputs(inputs))
        return self.scales.actions(values[..., : self.action_size])

    def predict(self, inputs: NDArray, pictures: Sequence[NDArray[np.uint8]] = ()) -> NDArray[np.float32]:
        """Returns the actions `(chunk, k)` that follow inputs `(m,)` and its cameras' pictures `(h, w, 3)`."""
        features = [encoder(picture) for encoder, picture in zip(self.encoders, pictures, strict=True)]
        values = self.network(np.concatenate([self.scales.inputs(inputs), *features]))
        return self.scales.actions(values.reshape(self.given.chunk, self.action_size))

    def _acting(self, task: "SuiteTask") -> EpisodePolicy:
        waiting: list[NDArray[np.float32]] = []

        def act(timestep: dm_env.TimeStep) -> NDArray[np.float32]:
            if timestep.first() or not waiting:
                chosen = self.inputs(timestep.observation, task).ravel()
                pictures = [timestep.observation[camera] for camera in self.given.cameras]
                waiting[:] = self.predict(chosen, pictures)[: self.given.executed]
            return waiting.pop(0)

        return act

    def check_fits(self, task: "SuiteTask") -> None:
        if missing := self.missing_observables(task):
            raise ValueError(f"the policy needs extra_observables {missing}: {self._trained_for}")
        given = self.given
        inputs = task.policy_inputs
        size = inputs.state_size
        if given.extra_observables is not None:
            size += sum(given.extra_observables.values()) - task.extra_size
        observed = max(given.state_elements[-1] + 1, size) if given.state_elements else given.state_size
        self._check_sizes_and_mode(task, observed=observed, expected=size)
        height, width = given.image_size
        for camera in given.cameras:
            taken = task.pictures.by_name.get(camera)
            if taken is None or (taken.height, taken.width) != (height, width):
                raise ValueError(f"the policy needs pictures of {camera}, {width}x{height}: {self._trained_for}")
        if given.tasks and (others := sorted({*inputs.tasks} - {*given.tasks})):
            raise ValueError(f"the policy cannot be asked for {', '.join(others)}: {self._trained_for}")

    @property
    def arrays(self) -> dict[str, NDArray]:
        parts: dict[str, ResidualNetwork | PictureEncoder] = {"network": self.network}
        parts |= {f"encoders.{i}": encoder for i, encoder in enumerate(self.encoders)}
        named = {f"{name}.{key}": array for name, part in parts.items() for key, array in part.arrays.items()}
        return {**self.scales._asdict(), **named}

    @classmethod
    def from_arrays(cls, arrays: dict[str, NDArray], metadata: Mapping[str, Any]) -> Self:
        if missing := sorted({*Scales._fields} - arrays.keys()):
            raise ValueError(f"missing arrays {missing}")
        scales = Scales.take(arrays)
        network = ResidualNetwork.take(arrays, "network")
        count = len(files.parse(metadata, ChunkMetadata, "metadata").cameras)
        encoders = tuple(PictureEncoder.take(arrays, f"encoders.{number}") for number in range(count))
        if arrays:
            raise ValueError(f"unknown arrays {sorted(arrays)}")
        return cls(scales=scales, network=network, encoders=encoders, metadata=metadata)
