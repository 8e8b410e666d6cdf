"""Offline training: recorded episodes, and the learners from them."""

import dataclasses
import time
from collections.abc import Mapping
from typing import Any, cast

import numpy as np
import torch
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.policies.imitated import ImitatedPolicy
from kitchen_suite.policies.stored import StoredPolicy
from kitchen_suite.rollouts.rollout import Controller
from kitchen_suite.rollouts.spec import EnvironmentSpec
from kitchen_suite.settings import TrainSettings
from kitchen_suite.training.hyperparameters import OfflineHyperparameters
from kitchen_suite.training.imitation.learner import RecordingTraining, cosine, policy_controller, scales_of
from kitchen_suite.training.imitation.methods import TorchNetwork
from kitchen_suite.training.learner import DivergedError, Learner
from kitchen_suite.training.offline.methods import OFFLINE_METHODS, OfflineMethod
from kitchen_suite.training.offline.transitions import GoalSampler, Sampler, Transitions, load_transitions
from kitchen_suite.vector_env.base import SuiteVectorEnv

# Steps of the optimiser between points of the curves.
_STEPS = 100


class OfflineLearner(Learner):
    """Fits the networks of a method to recorded transitions."""

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
        """Builds the networks.

        Args:
          transitions: to learn from.
          method: class of the method.
          config: its hyperparameters.
          num_steps: steps of the optimiser in the whole run, over which the learning rate falls.
          seed: of networks and batches.
          goal_elements: elements of the state in a goal, which are further inputs; empty for none.
          metadata: of the policy, on its inputs.
        """
        torch.manual_seed(seed)
        self._config, self._num_steps, self._own = config, num_steps, metadata
        scales = scales_of(transitions, config.standardisation_epsilon)
        inputs = scales.inputs(transitions.inputs)
        actions = (transitions.actions - scales.action_mean) / scales.action_deviation
        recorded = (transitions, inputs, actions, config)
        self._sampler = GoalSampler(*recorded, elements=goal_elements) if goal_elements else Sampler(*recorded)
        # Goals are standardised as the elements of the state that they have.
        elements = [*range(inputs.shape[1]), *goal_elements]
        self._scales = dataclasses.replace(
            scales, input_mean=scales.input_mean[elements], input_deviation=scales.input_deviation[elements]
        )
        self._method = method(len(elements), config.chunk * actions.shape[1], config)
        self._average = AveragedModel(self._method.policy, multi_avg_fn=get_ema_multi_avg_fn(config.averaging))
        self._optimizer = torch.optim.Adam(
            (each for each in self._method.parameters() if each.requires_grad), lr=config.learning_rate, fused=True
        )

    @property
    def modules(self) -> dict[str, Any]:
        return {"method": self._method, "average": self._average, "optimizer": self._optimizer}

    def learn(self) -> dict[str, float]:
        started, losses = time.perf_counter(), []
        for _ in range(min(_STEPS, self._num_steps - self.steps)):
            losses.append(self._step())
        if not np.isfinite(losses).all():
            raise DivergedError(f"after {self.steps} steps the loss is no longer finite: lower the learning rate")
        seconds = time.perf_counter() - started
        return {"loss/offline loss": float(np.mean(losses)), "time/update_milliseconds": 1000 * seconds / len(losses)}

    def _step(self) -> float:
        """Makes a step of the optimiser; returns its loss."""
        for group in self._optimizer.param_groups:
            group["lr"] = self._config.learning_rate * cosine(self.steps / self._num_steps)
        loss = self._method.loss(*self._sampler.draw(), self.steps)
        self._optimizer.zero_grad()
        loss.backward()
        self._optimizer.step()
        self._method.update_targets()
        self._average.update_parameters(self._method.policy)
        self.steps += 1
        return loss.item()

    def export(self, metadata: Mapping[str, Any]) -> ImitatedPolicy:
        config, method = self._config, self._method
        acting = {"algorithm": method.policy_class.algorithm, "chunk": config.chunk, "executed": config.executed}
        networks = {"network": cast(TorchNetwork, self._average.module), **method.further_networks()}
        return method.policy_class(
            scales=self._scales,
            networks={name: network.export() for name, network in networks.items()},
            metadata={**metadata, **acting, "method": method.title, **method.settings(), **self._own},
        )

    def controller(self, policy: StoredPolicy, environments: SuiteVectorEnv) -> Controller:
        return policy_controller(policy, environments)


class OfflineTraining(RecordingTraining):
    """The recordings and hyperparameters of a run of offline reinforcement learning."""

    def __init__(self, settings: TrainSettings, spec: EnvironmentSpec) -> None:
        """Reads the recordings; `spec` is that of the environments that are evaluated in."""
        self._method = OFFLINE_METHODS[settings.algorithm]
        super().__init__(settings, spec, self._method)
        with spec.make_environment() as environment:
            inputs = suite_env(environment).composer_task.policy_inputs
        reaches = self._method.reaches_goals
        if reaches and inputs.goal_place is None:
            raise ValueError(
                f"algorithm {settings.algorithm!r} needs a task that observes goal states: "
                "--task_kwargs='{\"goal_states\": 1}' in the kitchen"
            )
        # Goals stand for requests, which most recordings do not have.
        tasks = () if reaches else self.tasks
        self._goal_elements = inputs.goal_elements if reaches else ()
        self._transitions = load_transitions(
            settings.demonstrations, spec, tasks, settings.num_demonstrations, with_rewards=not reaches
        )
        self._metadata = {
            "state_size": inputs.state_size,
            "tasks": [*tasks],
            **({"goal_size": len(self._goal_elements)} if reaches else {}),
            **self.extras,
        }

    def make_learner(self, seed: int) -> OfflineLearner:
        return OfflineLearner(
            self._transitions,
            self._method,
            self.config,
            num_steps=self.num_steps,
            seed=seed,
            goal_elements=self._goal_elements,
            metadata=self._metadata,
        )
