"""Policies learned by imitation, which act with numpy alone, in chunks: several control steps are predicted at once.

The input of a policy is the state that it observes, without goals, and which of its tasks are requested. It therefore
acts in every task that asks for some of them, whatever goals the observation has. A policy that sees has the robot's
part of the state alone, and the pictures of some cameras.
"""

import abc
import dataclasses
import functools
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self

import dm_env
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from kitchen_suite import checks, files
from kitchen_suite.policies.networks import PictureEncoder, ResidualNetwork, Scales, checked
from kitchen_suite.policies.stored import EpisodePolicy, StoredPolicy

if TYPE_CHECKING:
    from kitchen_suite.tasks.task import SuiteTask


_ROWS = 4  # Rows of a product of matrices: for more, linear algebra starts threads, on whose number rounding depends.


_Count = Annotated[int, Meta(ge=1)]


@dataclasses.dataclass(frozen=True, kw_only=True)
class ImitatedMetadata:
    """The metadata of an `ImitatedPolicy` on its inputs and chunks.

    Attributes:
      chunk: number of actions that are predicted at once.
      executed: how many of them are applied before the next prediction.
      state_size: number of elements of the state among the inputs.
      tasks: those whose request is an input; empty if none is.
      state_elements: indices of the elements of the state among the inputs, increasing; None for all.
      goal_size: number of elements of the last goal state, that are the last inputs; 0 for a policy without goals.
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
    goal_size: Annotated[int, Meta(ge=0)] = 0
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
class ImitatedPolicy(StoredPolicy):
    """A policy that predicts chunks of actions.

    Attributes:
      scales: of inputs and actions.
      networks: by name.
      tables: further arrays by name.
      encoders: of the pictures of its cameras, whose features are further inputs of the first network.
      metadata: JSON-compatible; beside what every stored policy has, `algorithm` and the attributes of
        `ImitatedMetadata`. The last elements of the state are of extra observables.
    """

    network_names: ClassVar[tuple[str, ...]]
    table_names: ClassVar[tuple[str, ...]] = ()

    scales: Scales
    networks: Mapping[str, ResidualNetwork]
    tables: Mapping[str, NDArray[np.float32]] = dataclasses.field(default_factory=dict)
    encoders: tuple[PictureEncoder, ...] = ()
    metadata: Mapping[str, Any]

    def __post_init__(self) -> None:
        """Checks that all parts fit together."""
        given = self.given
        size = given.state_size + len(given.tasks) + given.goal_size
        if self.scales.input_mean.size != size:
            raise ValueError(f"there are {self.scales.input_mean.size} inputs, but state, tasks and goal have {size}")
        if len(given.cameras) != len(self.encoders):
            raise ValueError(f"there are {len(self.encoders)} encoders for the cameras {given.cameras}")
        for encoder in self.encoders:
            encoder.check_takes(*given.image_size)
        self._check_sizes()

    @abc.abstractmethod
    def _check_sizes(self) -> None:
        """Raises a ValueError unless networks and tables have the sizes that `_predict` needs."""

    @abc.abstractmethod
    def _predict(self, inputs: NDArray[np.float32], generator: np.random.Generator) -> NDArray[np.float32]:
        """Returns the standardised actions `(chunk * k,)` of a chunk for standardised inputs and features `(m,)`."""

    @property
    def num_inputs(self) -> int:
        """Number of the inputs and features that the first network takes."""
        return self.scales.input_mean.size + sum(encoder.features for encoder in self.encoders)

    @functools.cached_property
    def given(self) -> ImitatedMetadata:
        """The entries of the metadata on inputs and chunks; raises a ValueError for others than these may be."""
        return files.parse(self.metadata, ImitatedMetadata, "metadata")

    def missing_observables(self, task: "SuiteTask") -> list[str]:
        known = {*task.extra_slices, *(() if task.variations.layout else self.given.layout)}
        return [name for name in self.given.extra_observables or {} if name not in known]

    def select(self, inputs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the inputs `(m,)` of the networks, given the whole state and which of `tasks` are requested."""
        given = self.given
        if given.state_elements is None:
            return inputs
        state, requests = np.split(inputs, [inputs.size - len(given.tasks)])
        return np.concatenate([state[given.state_elements], requests])

    def _with_extras(self, inputs: NDArray[np.float64], task: "SuiteTask") -> NDArray[np.float64]:
        """Returns the inputs that `select` takes, given a task's state, which may have other extra observables."""
        given, size, parts = self.given, task.policy_inputs.state_size, task.extra_slices
        if given.extra_observables is None:
            return inputs
        own, extras, requests = np.split(inputs, [size - task.extra_size, size])
        chosen = [extras[parts[name]] if name in parts else given.layout[name] for name in given.extra_observables]
        return np.concatenate([own, *chosen, requests])

    @property
    def action_size(self) -> int:
        return self.scales.action_mean.size

    @property
    def layers(self) -> list[int]:
        main = self.networks[self.network_names[0]]
        return [main.inputs, *(block.first.bias.size for block in main.blocks), main.outputs]

    def predict(
        self, inputs: NDArray, generator: np.random.Generator, pictures: Sequence[NDArray[np.uint8]] = ()
    ) -> NDArray[np.float32]:
        """Returns the actions `(chunk, k)` that follow inputs `(m,)` and its cameras' pictures `(h, w, 3)`."""
        features = [encoder(picture) for encoder, picture in zip(self.encoders, pictures, strict=True)]
        values = self._predict(np.concatenate([self.scales.inputs(inputs), *features]), generator)
        return self.scales.actions(values.reshape(self.given.chunk, self.action_size))

    def _acting(self, task: "SuiteTask", generator: np.random.Generator) -> EpisodePolicy:
        inputs = task.policy_inputs
        waiting: list[NDArray[np.float32]] = []

        def act(timestep: dm_env.TimeStep) -> NDArray[np.float32]:
            if timestep.first() or not waiting:
                observed = inputs.state_and_requests(timestep.observation, self.given.tasks).ravel()
                chosen = self.select(self._with_extras(observed, task))
                if self.given.goal_size:
                    chosen = np.concatenate([chosen, inputs.wanted(timestep.observation).ravel()])
                pictures = [timestep.observation[camera] for camera in self.given.cameras]
                waiting[:] = self.predict(chosen, generator, pictures)[: self.given.executed]
            return waiting.pop(0)

        return act

    def check_fits(self, task: "SuiteTask") -> None:
        if missing := self.missing_observables(task):
            raise ValueError(f"the policy needs extra_observables {missing}: {self._trained_for}")
        given, inputs = self.given, task.policy_inputs
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
        if given.goal_size and (inputs.goal_place is None or given.goal_size != len(inputs.goal_elements)):
            raise ValueError(f"the policy needs a goal state in the observation: {self._trained_for}")
        if given.tasks and (others := sorted({*inputs.tasks} - {*given.tasks})):
            raise ValueError(f"the policy cannot be asked for {', '.join(others)}: {self._trained_for}")

    @property
    def arrays(self) -> dict[str, NDArray]:
        encoders = {f"encoders.{number}": encoder for number, encoder in enumerate(self.encoders)}
        networks, encodings = (
            {f"{name}.{key}": array for name, each in parts.items() for key, array in each.arrays.items()}
            for parts in (self.networks, encoders)
        )
        return {**self.scales._asdict(), **networks, **self.tables, **encodings}

    @classmethod
    def from_arrays(cls, arrays: dict[str, NDArray], metadata: Mapping[str, Any]) -> Self:
        if missing := sorted({*Scales._fields, *cls.table_names} - arrays.keys()):
            raise ValueError(f"missing arrays {missing}")
        scales = Scales.take(arrays)
        networks = {name: ResidualNetwork.take(arrays, name) for name in cls.network_names}
        tables = {name: checked(arrays.pop(name), name) for name in cls.table_names}
        count = len(files.parse(metadata, ImitatedMetadata, "metadata").cameras)
        encoders = tuple(PictureEncoder.take(arrays, f"encoders.{number}") for number in range(count))
        if arrays:
            raise ValueError(f"unknown arrays {sorted(arrays)}")
        return cls(scales=scales, networks=networks, tables=tables, encoders=encoders, metadata=metadata)


@dataclasses.dataclass(frozen=True, kw_only=True, repr=False)
class ClonedPolicy(ImitatedPolicy):
    """Behaviour cloning with action chunks: a network from inputs to a chunk."""

    algorithm = "bc"
    network_names = ("network",)

    def _check_sizes(self) -> None:
        _check_network(self.networks["network"], self.num_inputs, self.given.chunk * self.action_size)

    def _predict(self, inputs: NDArray[np.float32], generator: np.random.Generator) -> NDArray[np.float32]:
        return self.networks["network"](inputs)


@dataclasses.dataclass(frozen=True, kw_only=True, repr=False)
class FlowPolicy(ImitatedPolicy):
    """Flow matching: a network for the velocity that carries normal noise to chunks, integrated by Euler's method.

    Source: Lipman et al., Flow Matching for Generative Modeling, ICLR 2023.
    """

    algorithm = "flow"
    network_names: ClassVar[tuple[str, ...]] = ("network",)

    def _check_sizes(self) -> None:
        checks.integer(self.metadata.get("flow_steps"), "flow_steps", minimum=1)
        size = self.given.chunk * self.action_size
        _check_network(self.networks["network"], self.num_inputs + size + len(time_features(0.0)), size)

    def _predict(self, inputs: NDArray[np.float32], generator: np.random.Generator) -> NDArray[np.float32]:
        return self._carried(inputs, generator.standard_normal(self.given.chunk * self.action_size, np.float32))

    def _carried(self, inputs: NDArray[np.float32], values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Returns the chunks `(..., n)` that noise `(..., n)` becomes on inputs `(m,)`."""
        count: int = self.metadata["flow_steps"]
        leading = values.shape[:-1]
        given = np.broadcast_to(inputs, (*leading, inputs.size))
        for step in range(count):
            time = time_features(step / count)
            features = np.concatenate([given, values, np.broadcast_to(time, (*leading, time.size))], axis=-1)
            values = values + self.networks["network"](features) / np.float32(count)
        return values


@dataclasses.dataclass(frozen=True, kw_only=True, repr=False)
class RankedPolicy(FlowPolicy):
    """IDQL: some chunks are drawn by flow matching, and the one that two value networks rate highest is taken.

    Source: Hansen-Estruch et al., IDQL: Implicit Q-Learning as an Actor-Critic Method with Diffusion Policies, 2023.
    """

    algorithm = "idql"
    network_names = ("network", "first_critic", "second_critic")

    def _check_sizes(self) -> None:
        super()._check_sizes()
        checks.integer(self.metadata.get("candidates"), "candidates", minimum=1)
        for name in self.network_names[1:]:
            _check_network(self.networks[name], self.num_inputs + self.given.chunk * self.action_size, 1)

    def _predict(self, inputs: NDArray[np.float32], generator: np.random.Generator) -> NDArray[np.float32]:
        count = self.metadata["candidates"]
        noise = generator.standard_normal((count, self.given.chunk * self.action_size), np.float32)
        groups = [self._carried(inputs, group) for group in np.split(noise, range(_ROWS, count, _ROWS))]
        values = np.concatenate([self._values(inputs, group) for group in groups])
        best: NDArray[np.float32] = np.concatenate(groups)[values.argmax()]
        return best

    def _values(self, inputs: NDArray[np.float32], chunks: NDArray[np.float32]) -> NDArray[np.float32]:
        """Returns the smaller one of both values `(b,)` of chunks `(b, n)` on inputs `(m,)`."""
        pairs = np.concatenate([np.broadcast_to(inputs, (len(chunks), inputs.size)), chunks], axis=1)
        first, second = (self.networks[name](pairs)[:, 0] for name in self.network_names[1:])
        return np.minimum(first, second)


@dataclasses.dataclass(frozen=True, kw_only=True, repr=False)
class TokenPolicy(ImitatedPolicy):
    """VQ-BeT without a history: chunks are sums of code vectors, whose codes are drawn as a network predicts.

    Source: Lee et al., Behavior Generation with Latent Actions, ICML 2024; a residual network of the present input
    stands for the transformer of past ones.
    """

    algorithm = "vqbet"
    network_names = ("network", "decoder")
    table_names = ("codebooks",)

    def _check_sizes(self) -> None:
        books, size = self.tables["codebooks"], self.given.chunk * self.action_size
        if books.ndim != 3:
            raise ValueError(f"codebooks must have three axes, not shape {books.shape}")
        count, codes, latent = books.shape
        _check_network(self.networks["decoder"], latent, size)
        _check_network(self.networks["network"], self.num_inputs, count * codes * (1 + size))

    def _predict(self, inputs: NDArray[np.float32], generator: np.random.Generator) -> NDArray[np.float32]:
        books, size = self.tables["codebooks"], self.given.chunk * self.action_size
        count, codes, _ = books.shape
        network = self.networks["network"]
        features = network.features(inputs)
        logits = network.output.rows(0, count * codes)(features)
        # The greatest of logits with Gumbel noise is a draw from their softmax.
        noisy = logits.reshape(count, codes) + generator.gumbel(size=(count, codes))
        chosen = noisy.argmax(axis=1) + codes * np.arange(count)
        # The offsets of the chosen codes alone: a sixteenth of the outputs, and BLAS starts threads for more.
        starts = count * codes + size * chosen
        offset = sum(network.output.rows(start, start + size)(features) for start in starts)
        latent = books.reshape(count * codes, -1)[chosen].sum(axis=0)
        return self.networks["decoder"](latent) + offset


POLICIES: tuple[type[ImitatedPolicy], ...] = (ClonedPolicy, FlowPolicy, RankedPolicy, TokenPolicy)
"""The classes of policies that files may hold."""


def time_features(time: Any) -> NDArray[np.float32]:
    """Returns features `(..., 8)` of times in [0, 1], a number or `(..., 1)`: sines and cosines of four frequencies."""
    angles = np.asarray(time, np.float32) * (np.pi * 2.0 ** np.arange(4, dtype=np.float32)).astype(np.float32)
    return np.concatenate([np.sin(angles), np.cos(angles)], axis=-1)


def _check_network(network: ResidualNetwork, inputs: int, outputs: int) -> None:
    if (network.inputs, network.outputs) != (inputs, outputs):
        raise ValueError(f"a network maps {network.inputs} values to {network.outputs}, not {inputs} to {outputs}")
