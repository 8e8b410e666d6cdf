"""Behaviour cloning in chunks: a network learns the actions that follow each observation of demonstrations.

From top to bottom: the hyperparameters; the networks; the learner, which draws batches and exports policies; and a run,
with its arguments and its loop. `run.py` has the evaluations and the files of a run.

Policies take the state, and which tasks are requested; or pictures and the robot's part of the state.
"""

import dataclasses
import math
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Self, cast

import numpy as np
import torch
from msgspec import Meta
from numpy.typing import NDArray
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from kitchen_suite.episodes.play import Controller, PolicyController
from kitchen_suite.episodes.spec import EnvironmentSpec
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.policies.chunks import ChunkPolicy
from kitchen_suite.policies.networks import CLIP, PictureEncoder, ResidualNetwork, Scales
from kitchen_suite.training.demonstrations import Demonstrations, check_observed, load_demonstrations
from kitchen_suite.training.recipes import (
    BC,
    Coefficient,
    Decay,
    Epsilon,
    Fraction,
    LearningRate,
    SamplesOrPasses,
    Schedule,
    Units,
    checked,
)
from kitchen_suite.training.run import (
    POLICY_FILE,
    Learner,
    RunDescription,
    digest_of,
    evaluation_environments,
    one_thread,
    seed_runs,
)
from kitchen_suite.vector_env.base import SuiteVectorEnv

_CONVOLUTIONS = ((5, 16), (3, 32), (3, 32))  # Sizes and channels of the convolutions of pictures.
_STEPS = 100  # Steps of the optimiser between points of the curves.
_ACTION_EPSILON = 1e-3  # Added to the standard deviations of actions.


@dataclasses.dataclass(frozen=True, kw_only=True)
class BCHyperparameters:
    """Hyperparameters of behaviour cloning in chunks of actions.

    The network is residual: blocks with normalisation and SiLU units.

    Attributes:
      width: values between the blocks.
      blocks: number of blocks.
      chunk: number of actions that are predicted at once.
      executed: number of these that are applied before the next prediction.
      batch_size: control steps of a step of the optimiser.
      learning_rate: of the optimiser (AdamW) at first; it falls to 0 like half a cosine.
      weight_decay: of the optimiser.
      averaging: decay of the moving average of the policy's weights, which is evaluated and exported.
      standardisation_epsilon: added to the standard deviations by which inputs are divided.
      input_noise: standard deviation of normal noise on the inputs in training, in units of their standard deviations.
      features: number of features of each camera's picture; from pictures alone, as `shift` and `tint`.
      shift: greatest displacement of pictures in training [pixels].
      tint: greatest change of contrast, and twice that of brightness, of each colour of pictures in training.
    """

    width: Units = 384
    blocks: Annotated[int, Meta(ge=0, le=2**10)] = 3
    chunk: Annotated[int, Meta(ge=1, le=2**10)] = 8
    executed: Annotated[int, Meta(ge=1, le=2**10)] = 1
    batch_size: SamplesOrPasses = 512
    learning_rate: LearningRate = 1e-3
    weight_decay: Coefficient = 1e-4
    averaging: Decay = 0.999
    standardisation_epsilon: Epsilon = 0.01
    input_noise: Coefficient = 0.0
    features: Units = 128
    shift: Annotated[int, Meta(ge=0, le=2**10)] = 1
    tint: Fraction = 0.2

    def __post_init__(self) -> None:
        """Raises a ValueError for values that do not go together."""
        if self.executed > self.chunk:
            raise ValueError(f"executed must be at most chunk, {self.chunk}, got {self.executed}")


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


class Network(torch.nn.Module):
    """An affine map, residual blocks, and another affine map."""

    def __init__(self, inputs: int, outputs: int, *, width: int, blocks: int) -> None:
        """Builds the network from `inputs` to `outputs` values, with blocks of `width` values between them."""
        super().__init__()
        self.input = torch.nn.Linear(inputs, width)
        self.blocks = torch.nn.Sequential(*(Block(width) for _ in range(blocks)))
        self.output = torch.nn.Linear(width, outputs)

    def forward(self, values: torch.Tensor) -> torch.Tensor:
        """Returns `(b, n)` for values `(b, m)`."""
        return self.output(self.blocks(self.input(values)))

    def in_numpy(self) -> ResidualNetwork:
        """Returns a copy of the network that acts with numpy alone."""
        return residual_network(self)

    @classmethod
    def of(cls, network: ResidualNetwork) -> Self:
        """Returns the network with the arrays of one that acts with numpy."""
        made = cls(network.inputs, network.outputs, width=network.input.bias.size, blocks=len(network.blocks))
        made.load_state_dict({name: torch.as_tensor(array) for name, array in network.arrays.items()})
        return made


class Encoder(torch.nn.Module):
    """Convolutions of a picture that halve its height and width, and an affine map to features."""

    def __init__(self, height: int, width: int, features: int) -> None:
        """Builds the encoder of pictures of a size [pixels]."""
        super().__init__()
        self.convolutions = torch.nn.ModuleList()
        channels = 3
        for size, outputs in _CONVOLUTIONS:
            self.convolutions.append(torch.nn.Conv2d(channels, outputs, size, stride=2, padding=size // 2))
            channels = outputs
            height = (height + 1) // 2
            width = (width + 1) // 2
        self.output = torch.nn.Linear(channels * height * width, features)

    def forward(self, pictures: torch.Tensor) -> torch.Tensor:
        """Returns features `(b, n)` of pictures `(b, h, w, 3)`, float32 in [0, 1]."""
        values = pictures.permute(0, 3, 1, 2) - 0.5
        for convolution in self.convolutions:
            values = torch.nn.functional.relu(convolution(values))
        return self.output(values.flatten(1))


def residual_network(module: torch.nn.Module) -> ResidualNetwork:
    """Returns a `Network` as one that acts with numpy."""
    return ResidualNetwork.take(_named(module, "network"), "network")


def picture_encoder(module: torch.nn.Module) -> PictureEncoder:
    """Returns an `Encoder` as one that acts with numpy."""
    return PictureEncoder.take(_named(module, "encoder"), "encoder")


def as_numpy(tensor: torch.Tensor) -> NDArray[np.float32]:
    """Returns a copy of a tensor, which goes on changing in training."""
    return np.array(tensor.detach().numpy(), np.float32)


def _named(module: torch.nn.Module, name: str) -> dict[str, NDArray]:
    return {f"{name}.{key}": as_numpy(tensor) for key, tensor in module.state_dict().items()}


def augmented(pictures: torch.Tensor, config: BCHyperparameters) -> torch.Tensor:
    """Returns pictures `(b, h, w, 3)`, uint8, displaced and tinted at random, as float32 in [0, 1]."""
    count, h, w, _ = pictures.shape
    shift = config.shift
    # Beyond the edge a picture goes on as at the edge. Slices of a wider copy take a fraction of the time of indices.
    wider = np.pad(pictures.numpy(), ((0, 0), (shift, shift), (shift, shift), (0, 0)), mode="edge")
    places = torch.randint(0, 2 * shift + 1, (count, 2)).tolist()
    moved = np.stack([each[top : top + h, left : left + w] for each, (top, left) in zip(wider, places, strict=True)])
    gain, offset = (config.tint * (2 * torch.rand(count, 1, 1, 3) - 1) for _ in range(2))
    # (value - 0.5) (1 + gain) + 0.5 + offset / 2, of values in [0, 1].
    return torch.from_numpy(moved).float().div_(255).mul_(1 + gain).add_((offset - gain) / 2).clamp_(0, 1)


class PolicyNetwork(torch.nn.Module):
    """A network from inputs and the features of pictures to chunks of actions.

    Attributes:
      network: from inputs and features `(b, m)` to standardised chunks `(b, n)`.
      encoders: of the pictures of each camera.
    """

    def __init__(self, inputs: int, outputs: int, sizes: Sequence[tuple[int, int]], config: BCHyperparameters) -> None:
        """Builds the networks; `sizes` are height and width of the pictures of each camera."""
        super().__init__()
        size = inputs + config.features * len(sizes)
        self.network = Network(size, outputs, width=config.width, blocks=config.blocks)
        self.encoders = torch.nn.ModuleList(Encoder(height, width, config.features) for height, width in sizes)

    def forward(self, inputs: torch.Tensor, pictures: Sequence[torch.Tensor]) -> torch.Tensor:
        """Returns chunks `(b, n)` for inputs `(b, m)` and pictures `(b, h, w, 3)` of each camera, in [0, 1]."""
        features = [encoder(each) for encoder, each in zip(self.encoders, pictures, strict=True)]
        return self.network(torch.cat([inputs, *features], dim=1))


class BCLearner(Learner):
    """Fits a network to demonstrations, by steps of an optimiser whose learning rate falls to 0."""

    title = "Behaviour cloning"
    unit = "steps of the optimiser"

    def __init__(
        self,
        demonstrations: Demonstrations,
        config: BCHyperparameters,
        *,
        num_steps: int,
        seed: int,
        tasks: Sequence[str] = (),
        extras: Mapping[str, Any] = MappingProxyType({}),
    ) -> None:
        """Builds the network; the seed is also that of the batches.

        The learning rate falls over `num_steps` steps. Requests of `tasks` are inputs; `extras` is as in `_extras`.
        """
        torch.manual_seed(seed)
        self._config = config
        self._num_steps = num_steps
        self._scales = scales = scales_of(demonstrations.inputs, demonstrations.actions, config.standardisation_epsilon)
        self._inputs = torch.as_tensor(scales.inputs(demonstrations.inputs))
        self._actions = torch.as_tensor((demonstrations.actions - scales.action_mean) / scales.action_deviation)
        self._chunks = torch.as_tensor(demonstrations.chunks(config.chunk))
        self._pictures = {camera: torch.as_tensor(each) for camera, each in demonstrations.pictures.items()}
        sizes = [(each.shape[1], each.shape[2]) for each in self._pictures.values()]
        own_size = self._inputs.shape[1]
        self._policy = PolicyNetwork(own_size, config.chunk * self._actions.shape[1], sizes, config)
        self._average = AveragedModel(self._policy, multi_avg_fn=get_ema_multi_avg_fn(config.averaging))
        self._optimizer = torch.optim.AdamW(
            self._policy.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay
        )
        # Of policies, on their inputs.
        self._metadata: dict[str, Any] = {"state_size": own_size - len(tasks), "tasks": [*tasks]}
        if demonstrations.state_elements is not None:
            self._metadata["state_elements"] = [*demonstrations.state_elements]
        if self._pictures:
            self._metadata |= {"cameras": [*self._pictures], "image_size": [*sizes[0]]}
        self._metadata |= extras

    @property
    def modules(self) -> dict[str, Any]:
        return {"policy": self._policy, "average": self._average, "optimizer": self._optimizer}

    @property
    def averaged(self) -> PolicyNetwork:
        """The network with the averaged weights, which act."""
        return cast(PolicyNetwork, self._average.module)

    def learn(self) -> dict[str, float]:
        """Makes some steps of the optimiser; returns metrics by name."""
        started = time.perf_counter()
        losses = [self._step() for _ in range(min(_STEPS, self._num_steps - self.steps))]
        seconds = time.perf_counter() - started
        self.check_finite({"learned": self._policy, "averaged": self._average})
        return {"loss/imitation loss": float(np.mean(losses)), "time/update_milliseconds": 1000 * seconds / len(losses)}

    def _step(self) -> float:
        """Makes a step of the optimiser on a batch that it draws; returns the mean absolute error of chunks."""
        config = self._config
        for group in self._optimizer.param_groups:
            group["lr"] = config.learning_rate * (0.5 * (1 + math.cos(math.pi * (self.steps / self._num_steps))))
        rows = torch.randint(len(self._inputs), (config.batch_size,))
        inputs = self._inputs[rows]
        chunks = self._actions[self._chunks[rows]].flatten(1)
        if config.input_noise:
            inputs = (inputs + config.input_noise * torch.randn_like(inputs)).clamp(-CLIP, CLIP)
        pictures = [augmented(each[rows], config) for each in self._pictures.values()]
        loss = torch.nn.functional.l1_loss(self._policy(inputs, pictures), chunks)
        self._optimizer.zero_grad()
        loss.backward()
        self._optimizer.step()
        self._average.update_parameters(self._policy)
        self.steps += 1
        return loss.item()

    def export(self, metadata: Mapping[str, Any]) -> ChunkPolicy:
        acting = {"algorithm": ChunkPolicy.algorithm, "chunk": self._config.chunk, "executed": self._config.executed}
        return ChunkPolicy(
            scales=self._scales,
            network=self.averaged.network.in_numpy(),
            encoders=tuple(picture_encoder(encoder) for encoder in self.averaged.encoders),
            metadata={**metadata, **acting, **self._metadata},
        )

    def controller(self, policy: ChunkPolicy, environments: SuiteVectorEnv) -> Controller:
        return PolicyController(environments, lambda environment, generator, row: policy.episode(environment.task))


def scales_of(inputs: NDArray, actions: NDArray, epsilon: float) -> Scales:
    """Returns the standardisation of inputs and actions; `epsilon` is added to deviations of inputs."""
    inputs = inputs.astype(np.float64)
    actions = actions.astype(np.float64)
    return Scales(
        input_mean=inputs.mean(axis=0).astype(np.float32),
        input_deviation=(inputs.std(axis=0) + epsilon).astype(np.float32),
        action_mean=actions.mean(axis=0).astype(np.float32),
        action_deviation=(actions.std(axis=0) + _ACTION_EPSILON).astype(np.float32),
    )


def train(
    folder: Path,
    spec: EnvironmentSpec,
    schedule: Schedule,
    demonstrations: Sequence[Path],
    *,
    seed: int = 0,
    restarts: int = 3,
    hyperparameters: Mapping[str, Any] = MappingProxyType({}),
    num_demonstrations: Sequence[int] = (),
    num_threads: int | None = None,
    resume: bool = False,
    report: Callable[[str], None] = lambda line: None,
) -> Path:
    """Trains a policy on demonstrations.

    The folder gets a folder for each seed, with curves for TensorBoard and the last checkpoints, and the best policy.

    Args:
      folder: of the run.
      spec: of the environments that the policy is evaluated in.
      schedule: when the policy is evaluated, and when training stops; see `recipes.find_schedule`.
      demonstrations: folders of recordings.
      seed: first seed.
      restarts: number of additional seeds to try where one is given up.
      hyperparameters: changes to the defaults, by name.
      num_demonstrations: episodes of each recording, or one number for all; empty for all episodes.
      num_threads: number of threads that step the environments of evaluations; one per processor when None.
      resume: whether to continue the run in the folder from its newest checkpoints.
      report: called with each line of a table of the evaluations.

    Returns the file of the best policy. Raises as `ppo.train`.
    """
    check_observed(spec, BC, others=("pixels_agent_pos",))
    if not demonstrations:
        raise ValueError(f"algorithm {BC!r} needs demonstrations: a recording of kitchen-record")
    if schedule.num_steps < 1:
        raise ValueError(f"num_steps must be above 0, got {schedule.num_steps}")
    config = checked(BCHyperparameters, hyperparameters, "hyperparameter")
    with spec.make_environment() as environment:
        # Of the tasks that can be requested, each episode draws some.
        tasks = suite_env(environment).composer_task.requests.drawn_tasks
    extras = _extras(spec)
    shown = load_demonstrations(demonstrations, spec, tasks, num_demonstrations)
    description = RunDescription(
        domain_name=spec.domain_name,
        task_name=spec.task_name,
        task_kwargs=dict(spec.task_kwargs),
        training_kwargs={},
        hyperparameters=dataclasses.asdict(config),
        seed=seed,
        algorithm=BC,
        data_sha256=digest_of([shown.inputs, shown.actions, shown.last, *shown.pictures.values()]),
    )

    def make_learner(seed: int) -> BCLearner:
        return BCLearner(shown, config, num_steps=schedule.num_steps, seed=seed, tasks=tasks, extras=extras)

    with evaluation_environments(spec, schedule, num_threads) as evaluated, one_thread():
        for run in seed_runs(
            folder, description, schedule, evaluated, make_learner, restarts=restarts, resume=resume, report=report
        ):
            with run:
                run.begin()
                while not run.stop_reason:
                    run.record(run.learner.learn())
    return folder / POLICY_FILE


def _extras(spec: EnvironmentSpec) -> dict[str, Any]:
    """Returns the metadata of a policy on the extra observables of environments; see `ChunkMetadata`."""
    arguments = {name: value for name, value in spec.task_kwargs.items() if name != "variations"}
    with dataclasses.replace(spec, task_kwargs=arguments).make_environment() as environment:
        environment.reset(seed=0)
        task = suite_env(environment).composer_task
        layout = {}
        if task.quantities.size:
            values = task.quantities.values
            layout = {name: values[task.extra_slices[name]].tolist() for name in task.quantities.of_layout}
    sizes = {name: part.stop - part.start for name, part in task.extra_slices.items()}
    return {"extra_observables": sizes, "layout": layout}
