"""Training by imitation: the demonstrations, and the learners from them."""

import dataclasses
import math
import time
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, Protocol, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.policies.imitated import ImitatedPolicy
from kitchen_suite.policies.networks import CLIP, Scales
from kitchen_suite.policies.stored import StoredPolicy
from kitchen_suite.rollouts.rollout import Controller, PolicyController
from kitchen_suite.rollouts.spec import EnvironmentSpec, SeededPolicies
from kitchen_suite.settings import TrainSettings
from kitchen_suite.training.hyperparameters import ImitationHyperparameters, checked_changes
from kitchen_suite.training.imitation.demonstrations import Demonstrations, load_demonstrations
from kitchen_suite.training.imitation.methods import METHODS, Method, TorchEncoder, augmented
from kitchen_suite.training.learner import Learner, Training
from kitchen_suite.vector_env.base import SuiteVectorEnv

# Steps of the optimiser between points of the curves.
_STEPS = 100

# Added to the standard deviations of actions.
_ACTION_EPSILON = 1e-3


class ImitationLearner(Learner):
    """Fits the networks of a method to demonstrations."""

    def __init__(
        self,
        demonstrations: Demonstrations,
        method: type[Method],
        config: ImitationHyperparameters,
        *,
        num_steps: int,
        seed: int,
        tasks: Sequence[str] = (),
        extras: Mapping[str, Any] = MappingProxyType({}),
    ) -> None:
        """Builds the networks.

        Args:
          demonstrations: to learn from.
          method: class of the method.
          config: its hyperparameters.
          num_steps: steps of the optimiser in the whole run, over which the learning rate falls.
          seed: of networks and batches.
          tasks: names of the tasks whose request is an input.
          extras: metadata of the policy on extra observables.
        """
        torch.manual_seed(seed)
        self._config, self._num_steps, self._tasks, self._extras = config, num_steps, tuple(tasks), extras
        self._state_elements = demonstrations.state_elements
        self._scales = scales_of(demonstrations, config.standardisation_epsilon)
        self._inputs = torch.as_tensor(self._scales.inputs(demonstrations.inputs))
        actions = (demonstrations.actions - self._scales.action_mean) / self._scales.action_deviation
        self._actions = torch.as_tensor(actions)
        self._chunks = torch.as_tensor(demonstrations.chunks(config.chunk))
        self._pictures = {camera: torch.as_tensor(each) for camera, each in demonstrations.pictures.items()}
        size = self._inputs.shape[1] + config.features * len(self._pictures)
        self._method = method(size, config.chunk * self._actions.shape[1], config)
        if self._pictures:
            shapes = [each.shape for each in self._pictures.values()]
            self._method.encoders = torch.nn.ModuleList(
                TorchEncoder(height, width, config.features) for _, height, width, _ in shapes
            )
        self._average = AveragedModel(self._method, multi_avg_fn=get_ema_multi_avg_fn(config.averaging))
        self._optimizer = torch.optim.AdamW(
            self._method.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay
        )

    @property
    def modules(self) -> dict[str, Any]:
        return {"method": self._method, "average": self._average, "optimizer": self._optimizer}

    @property
    def averaged(self) -> Method:
        """The networks with the averaged weights, which act."""
        return cast(Method, self._average.module)

    def learn(self) -> dict[str, float]:
        started, losses = time.perf_counter(), []
        for _ in range(min(_STEPS, self._num_steps - self.steps)):
            losses.append(self._step())
        seconds = time.perf_counter() - started
        return {"loss/imitation loss": float(np.mean(losses)), "time/update_milliseconds": 1000 * seconds / len(losses)}

    def _step(self) -> float:
        """Makes a step of the optimiser; returns its loss."""
        for group in self._optimizer.param_groups:
            group["lr"] = self._config.learning_rate * cosine(self.steps / self._num_steps)
        indices = torch.randint(len(self._inputs), (self._config.batch_size,))
        inputs, chunks = self._inputs[indices], self._actions[self._chunks[indices]].flatten(1)
        if self._config.input_noise:
            inputs = (inputs + self._config.input_noise * torch.randn_like(inputs)).clamp(-CLIP, CLIP)
        pictures = [augmented(each[indices], self._config) for each in self._pictures.values()]
        loss = self._method.loss(self._method.see(inputs, pictures), chunks, self.steps)
        self._optimizer.zero_grad()
        loss.backward()
        self._optimizer.step()
        self._average.update_parameters(self._method)
        self.steps += 1
        return loss.item()

    def export(self, metadata: Mapping[str, Any]) -> ImitatedPolicy:
        method = self.averaged
        policy_class = method.policy_class
        config = self._config
        own = {
            "algorithm": policy_class.algorithm,
            "chunk": config.chunk,
            "executed": config.executed,
            "state_size": self._inputs.shape[1] - len(self._tasks),
            "tasks": [*self._tasks],
            **({} if self._state_elements is None else {"state_elements": [*self._state_elements]}),
            **self._sight,
            **self._extras,
            **method.settings(),
        }
        return policy_class(
            scales=self._scales,
            networks={name: getattr(method, name).export() for name in policy_class.network_names},
            tables=method.tables(),
            encoders=tuple(cast(TorchEncoder, each).export() for each in method.encoders) if self._pictures else (),
            metadata={**metadata, **own},
        )

    @property
    def _sight(self) -> dict[str, Any]:
        """The metadata that only policies that see have."""
        if not self._pictures:
            return {}
        first = next(iter(self._pictures.values()))
        return {"cameras": [*self._pictures], "image_size": [*first.shape[1:3]]}

    def controller(self, policy: StoredPolicy, environments: SuiteVectorEnv) -> Controller:
        return policy_controller(policy, environments)


def cosine(share: float) -> float:
    """Returns half a cosine, which falls from 1 to 0 over shares from 0 to 1."""
    return 0.5 * (1 + math.cos(math.pi * share))


def policy_controller(policy: StoredPolicy, environments: SuiteVectorEnv) -> Controller:
    """Returns a controller that acts by a policy as it does in single environments."""
    return PolicyController(
        environments, SeededPolicies(lambda environment, generator: policy.episode(environment.task, generator))
    )


class Recorded(Protocol):
    """Control steps that have been recorded."""

    @property
    def inputs(self) -> NDArray[np.float32]:
        """Inputs `(r, n)` of a policy."""

    @property
    def actions(self) -> NDArray[np.float32]:
        """Actions `(m, k)`."""


def scales_of(recorded: Recorded, epsilon: float) -> Scales:
    """Returns the standardisation of recorded inputs and actions; `epsilon` is added to deviations of inputs."""
    inputs, actions = recorded.inputs.astype(np.float64), recorded.actions.astype(np.float64)
    parts = {
        "input_mean": inputs.mean(axis=0),
        "input_deviation": inputs.std(axis=0) + epsilon,
        "action_mean": actions.mean(axis=0),
        "action_deviation": actions.std(axis=0) + _ACTION_EPSILON,
    }
    return Scales(**{name: part.astype(np.float32) for name, part in parts.items()})


class RecordingTraining(Training):
    """The settings of a run that learns from recordings alone.

    Attributes:
      num_steps: steps of the optimiser for each seed.
      tasks: names of the tasks of which each episode draws some.
      extras: metadata of policies on extra observables.
    """

    steps = "steps of the optimiser"

    def __init__(self, settings: TrainSettings, spec: EnvironmentSpec, method: Any) -> None:
        """Checks the settings; `spec` is that of the environments that are evaluated in, `method` a class."""
        if not settings.demonstrations:
            raise ValueError(
                f"algorithm {settings.algorithm!r} needs --demonstrations, a folder written by kitchen-record"
            )
        for flag in ("initial_policy", "training_kwargs"):
            if getattr(settings, flag):
                raise ValueError(f"--{flag} is for the algorithm 'ppo', not for {settings.algorithm!r}")
        self.title = method.title
        self.config: Any = checked_changes(method.hyperparameters(), settings.hyperparameters)
        if self.config.executed > self.config.chunk:
            raise ValueError(f"executed must be at most chunk, {self.config.chunk}, got {self.config.executed}")
        self.training_kwargs: dict[str, Any] = {}
        self.max_episode_steps = spec.max_episode_steps
        self.num_steps = settings.schedule.num_steps
        with spec.make_environment() as environment:
            self.tasks = suite_env(environment).composer_task.requests.drawn_tasks
        self.extras = _extras(spec)


class ImitationTraining(RecordingTraining):
    """The demonstrations and hyperparameters of a run by imitation."""

    def __init__(self, settings: TrainSettings, spec: EnvironmentSpec) -> None:
        """Reads the demonstrations; `spec` is that of the environments that are evaluated in."""
        self._method = METHODS[settings.algorithm]
        super().__init__(settings, spec, self._method)
        self._demonstrations = load_demonstrations(
            settings.demonstrations, spec, self.tasks, settings.num_demonstrations
        )

    def make_learner(self, seed: int) -> ImitationLearner:
        return ImitationLearner(
            self._demonstrations,
            self._method,
            self.config,
            num_steps=self.num_steps,
            seed=seed,
            tasks=self.tasks,
            extras=self.extras,
        )


def _extras(spec: EnvironmentSpec) -> dict[str, Any]:
    """Returns the metadata of a policy on the extra observables of environments; see `ImitatedPolicy`."""
    arguments = {name: value for name, value in spec.task_kwargs.items() if name != "variations"}
    with dataclasses.replace(spec, task_kwargs=arguments).make_environment() as environment:
        environment.reset(seed=0)
        task = suite_env(environment).composer_task
        values, fixed = (task.extras.values, task.extras.of_layout) if task.extras else ([], [])
        layout = {name: values[task.extra_slices[name]].tolist() for name in fixed}
    sizes = {name: part.stop - part.start for name, part in task.extra_slices.items()}
    return {"extra_observables": sizes, "layout": layout}
