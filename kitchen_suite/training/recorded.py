"""Training from recordings alone, by imitation or offline reinforcement learning: settings of a run, and learners."""

import abc
import dataclasses
import functools
import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, ClassVar, cast

import numpy as np
import torch
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from kitchen_suite.episodes.play import Controller, PolicyController
from kitchen_suite.episodes.spec import EnvironmentSpec, seeded_policies
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.policies.imitated import ImitatedPolicy
from kitchen_suite.policies.networks import CLIP, Scales
from kitchen_suite.policies.stored import StoredPolicy
from kitchen_suite.settings import TrainSettings
from kitchen_suite.training.demonstrations import Demonstrations, load_demonstrations
from kitchen_suite.training.hyperparameters import ImitationHyperparameters, OfflineHyperparameters, checked_changes
from kitchen_suite.training.imitation import METHODS, ImitationMethod, TorchEncoder, TorchNetwork, augmented
from kitchen_suite.training.learner import Learner, Training
from kitchen_suite.training.offline import OFFLINE_METHODS, OfflineMethod
from kitchen_suite.training.transitions import GoalSampler, Sampler, Transitions, load_transitions
from kitchen_suite.vector_env.base import SuiteVectorEnv

_STEPS = 100  # Steps of the optimiser between points of the curves.
_ACTION_EPSILON = 1e-3  # Added to the standard deviations of actions.


class RecordingLearner(Learner):
    """Fits the networks of a method to recordings, by steps of an optimiser whose learning rate falls to 0."""

    _loss_name: ClassVar[str]
    _scales: Scales
    _metadata: dict[str, Any]  # Of policies, on their inputs.

    def __init__(
        self, method: Any, averaged: torch.nn.Module, optimizer: torch.optim.Optimizer, config: Any, num_steps: int
    ) -> None:
        """Takes a method, its networks whose weights are averaged, and the steps of the optimiser in the whole run."""
        self._method, self._optimizer, self._config, self._num_steps = method, optimizer, config, num_steps
        self._learning = averaged
        self._average = AveragedModel(averaged, multi_avg_fn=get_ema_multi_avg_fn(config.averaging))

    @property
    def modules(self) -> dict[str, Any]:
        return {"method": self._method, "average": self._average, "optimizer": self._optimizer}

    def learn(self) -> dict[str, float]:
        started = time.perf_counter()
        losses = [self._step() for _ in range(min(_STEPS, self._num_steps - self.steps))]
        seconds = time.perf_counter() - started
        self.check_finite({"learned": self._method, "averaged": self._average})
        return {self._loss_name: float(np.mean(losses)), "time/update_milliseconds": 1000 * seconds / len(losses)}

    def _step(self) -> float:
        share = self.steps / self._num_steps
        for group in self._optimizer.param_groups:
            group["lr"] = self._config.learning_rate * (0.5 * (1 + math.cos(math.pi * share)))
        loss = self._draw_loss()
        self._optimizer.zero_grad()
        loss.backward()
        self._optimizer.step()
        self._method.update_targets()
        self._average.update_parameters(self._learning)
        self.steps += 1
        return loss.item()

    @abc.abstractmethod
    def _draw_loss(self) -> torch.Tensor:
        """Returns the loss `()` of a batch that it draws."""

    def _export(self, metadata: Mapping[str, Any], networks: Mapping[str, TorchNetwork], **parts: Any) -> Any:
        """Returns a policy of networks, with further parts."""
        config, policy_class = self._config, self._method.policy_class
        acting = {"algorithm": policy_class.algorithm, "chunk": config.chunk, "executed": config.executed}
        return policy_class(
            scales=self._scales,
            networks={name: network.export() for name, network in networks.items()},
            metadata={**metadata, **acting, **self._metadata, **self._method.settings()},
            **parts,
        )

    def controller(self, policy: StoredPolicy, environments: SuiteVectorEnv) -> Controller:
        episodes = seeded_policies(lambda environment, generator: policy.episode(environment.task, generator))
        return PolicyController(environments, episodes)


class ImitationLearner(RecordingLearner):
    """Fits the networks of a method to demonstrations."""

    _loss_name = "loss/imitation loss"

    def __init__(
        self,
        demonstrations: Demonstrations,
        method: type[ImitationMethod],
        config: ImitationHyperparameters,
        *,
        num_steps: int,
        seed: int,
        tasks: Sequence[str] = (),
        extras: Mapping[str, Any] = MappingProxyType({}),
    ) -> None:
        """Builds the networks of the class of a method; the seed is also that of the batches.

        The learning rate falls over `num_steps` steps. Requests of `tasks` are inputs; `extras` is as in `_extras`.
        """
        torch.manual_seed(seed)
        self._scales = scales = _scales_of(demonstrations, config.standardisation_epsilon)
        self._inputs = torch.as_tensor(scales.inputs(demonstrations.inputs))
        self._actions = torch.as_tensor((demonstrations.actions - scales.action_mean) / scales.action_deviation)
        self._chunks = torch.as_tensor(demonstrations.chunks(config.chunk))
        self._pictures = {camera: torch.as_tensor(each) for camera, each in demonstrations.pictures.items()}
        elements, own_size = demonstrations.state_elements, self._inputs.shape[1]
        self._metadata = {"state_size": own_size - len(tasks), "tasks": [*tasks]}
        if elements is not None:
            self._metadata["state_elements"] = [*elements]
        built = method(own_size + config.features * len(self._pictures), config.chunk * self._actions.shape[1], config)
        if self._pictures:
            shapes = [each.shape for each in self._pictures.values()]
            built.encoders = torch.nn.ModuleList(TorchEncoder(h, w, config.features) for _, h, w, _ in shapes)
            self._metadata |= {"cameras": [*self._pictures], "image_size": [*shapes[0][1:3]]}
        self._metadata |= extras
        optimizer = torch.optim.AdamW(built.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay)
        super().__init__(built, built, optimizer, config, num_steps)

    @property
    def averaged(self) -> ImitationMethod:
        """The networks with the averaged weights, which act."""
        return cast(ImitationMethod, self._average.module)

    def _draw_loss(self) -> torch.Tensor:
        indices = torch.randint(len(self._inputs), (self._config.batch_size,))
        inputs, chunks = self._inputs[indices], self._actions[self._chunks[indices]].flatten(1)
        if self._config.input_noise:
            inputs = (inputs + self._config.input_noise * torch.randn_like(inputs)).clamp(-CLIP, CLIP)
        pictures = [augmented(each[indices], self._config) for each in self._pictures.values()]
        return self._method.loss(self._method.see(inputs, pictures), chunks, self.steps)

    def export(self, metadata: Mapping[str, Any]) -> ImitatedPolicy:
        method = self.averaged
        return self._export(
            metadata,
            {name: getattr(method, name) for name in method.policy_class.network_names},
            tables=method.tables(),
            encoders=tuple(cast(TorchEncoder, each).export() for each in method.encoders) if self._pictures else (),
        )


class OfflineLearner(RecordingLearner):
    """Fits the networks of a method to recorded transitions."""

    _loss_name = "loss/offline loss"

    def __init__(
        self,
        transitions: Transitions,
        method: type[OfflineMethod],
        config: OfflineHyperparameters,
        *,
        num_steps: int,
        seed: int,
        goal_elements: tuple[int, ...],
        metadata: Mapping[str, Any],
    ) -> None:
        """Builds the networks of the class of a method; the seed is also that of the batches.

        The learning rate falls over `num_steps` steps of the optimiser. The elements of the state in a goal, if any,
        are further inputs; the metadata of the policy is on its inputs.
        """
        torch.manual_seed(seed)
        scales = _scales_of(transitions, config.standardisation_epsilon)
        inputs = scales.inputs(transitions.inputs)
        actions = (transitions.actions - scales.action_mean) / scales.action_deviation
        recorded = (transitions, inputs, actions, config)
        self._sampler = GoalSampler(*recorded, elements=goal_elements) if goal_elements else Sampler(*recorded)
        # Goals are standardised as the elements of the state that they have.
        elements = [*range(inputs.shape[1]), *goal_elements]
        mean, deviation = scales.input_mean[elements], scales.input_deviation[elements]
        self._scales = scales._replace(input_mean=mean, input_deviation=deviation)
        built = method(len(elements), config.chunk * actions.shape[1], config)
        self._metadata = {"method": built.title, **metadata}
        learning: Iterable[torch.nn.Parameter] = (each for each in built.parameters() if each.requires_grad)
        optimizer = torch.optim.Adam(learning, lr=config.learning_rate, fused=True)
        super().__init__(built, built.network, optimizer, config, num_steps)

    def _draw_loss(self) -> torch.Tensor:
        return self._method.loss(*self._sampler.draw(), self.steps)

    def export(self, metadata: Mapping[str, Any]) -> ImitatedPolicy:
        networks = {"network": cast(TorchNetwork, self._average.module), **self._method.further_networks()}
        return self._export(metadata, networks)


def _scales_of(recorded: Demonstrations | Transitions, epsilon: float) -> Scales:
    """Returns the standardisation of recorded inputs and actions; `epsilon` is added to deviations of inputs."""
    inputs, actions = recorded.inputs.astype(np.float64), recorded.actions.astype(np.float64)
    return Scales(
        input_mean=inputs.mean(axis=0).astype(np.float32),
        input_deviation=(inputs.std(axis=0) + epsilon).astype(np.float32),
        action_mean=actions.mean(axis=0).astype(np.float32),
        action_deviation=(actions.std(axis=0) + _ACTION_EPSILON).astype(np.float32),
    )


class RecordingTraining(Training):
    """The settings of a run that learns from recordings alone."""

    steps = "steps of the optimiser"
    _build: Callable[..., RecordingLearner]

    def __init__(self, settings: TrainSettings, spec: EnvironmentSpec, method: Any) -> None:
        """Checks the settings; `spec` is that of the environments that are evaluated in, `method` a class."""
        if not settings.demonstrations:
            raise ValueError(f"algorithm {settings.algorithm!r} needs --demonstrations, a folder of kitchen-record")
        for flag in ("initial_policy", "training_kwargs"):
            if getattr(settings, flag):
                raise ValueError(f"--{flag} is for the algorithm 'ppo', not for {settings.algorithm!r}")
        self._method, self.title = method, method.title
        self.config: Any = checked_changes(method.hyperparameters(), settings.hyperparameters)
        if self.config.executed > self.config.chunk:
            raise ValueError(f"executed must be at most chunk, {self.config.chunk}, got {self.config.executed}")
        self.training_kwargs: dict[str, Any] = {}
        self.max_episode_steps = spec.max_episode_steps
        self._num_steps = settings.schedule.num_steps
        if self._num_steps <= (codes := getattr(self.config, "quantizer_steps", 0)):
            bound = f"the {codes} quantizer_steps" if codes else "0"
            raise ValueError(f"num_steps must be above {bound}, got {self._num_steps}")
        with spec.make_environment() as environment:
            task = suite_env(environment).composer_task
            # Of the tasks that can be requested, each episode draws some.
            self._tasks, self._inputs = task.requests.drawn_tasks, task.policy_inputs
        self._extras = _extras(spec)

    def make_learner(self, seed: int) -> RecordingLearner:
        return self._build(seed=seed)


class ImitationTraining(RecordingTraining):
    """The demonstrations and hyperparameters of a run by imitation."""

    def __init__(self, settings: TrainSettings, spec: EnvironmentSpec) -> None:
        """Reads the demonstrations; `spec` is that of the environments that are evaluated in."""
        super().__init__(settings, spec, METHODS[settings.algorithm])
        found = load_demonstrations(settings.demonstrations, spec, self._tasks, settings.num_demonstrations)
        self.data = found.inputs, found.actions, found.last, *found.pictures.values()
        options: dict[str, Any] = {"num_steps": self._num_steps, "tasks": self._tasks, "extras": self._extras}
        self._build = functools.partial(ImitationLearner, found, self._method, self.config, **options)


class OfflineTraining(RecordingTraining):
    """The recordings and hyperparameters of a run of offline reinforcement learning."""

    def __init__(self, settings: TrainSettings, spec: EnvironmentSpec) -> None:
        """Reads the recordings; `spec` is that of the environments that are evaluated in."""
        super().__init__(settings, spec, OFFLINE_METHODS[settings.algorithm])
        reaches, inputs = self._method.reaches_goals, self._inputs
        if reaches and inputs.goal_place is None:
            flag = "--task_kwargs='{\"goal_states\": 1}' in the kitchen"
            raise ValueError(f"algorithm {settings.algorithm!r} needs a task that observes goal states: {flag}")
        # Goals stand for requests, which most recordings do not have.
        tasks = () if reaches else self._tasks
        elements = inputs.goal_elements if reaches else ()
        folders, counts = settings.demonstrations, settings.num_demonstrations
        found = load_transitions(folders, spec, tasks, counts, with_rewards=not reaches)
        self.data = found
        goals = {"goal_size": len(elements)} if reaches else {}
        metadata = {"state_size": inputs.state_size, "tasks": [*tasks], **goals, **self._extras}
        options: dict[str, Any] = {"num_steps": self._num_steps, "goal_elements": elements, "metadata": metadata}
        self._build = functools.partial(OfflineLearner, found, self._method, self.config, **options)


def _extras(spec: EnvironmentSpec) -> dict[str, Any]:
    """Returns the metadata of a policy on the extra observables of environments; see `ImitatedPolicy`."""
    arguments = {name: value for name, value in spec.task_kwargs.items() if name != "variations"}
    with dataclasses.replace(spec, task_kwargs=arguments).make_environment() as environment:
        environment.reset(seed=0)
        task = suite_env(environment).composer_task
        layout = {}
        if task.extras:
            layout = {name: task.extras.values[task.extra_slices[name]].tolist() for name in task.extras.of_layout}
    sizes = {name: part.stop - part.start for name, part in task.extra_slices.items()}
    return {"extra_observables": sizes, "layout": layout}
