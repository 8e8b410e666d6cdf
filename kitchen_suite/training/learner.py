"""Interfaces of all training algorithms: the settings of a run, its learner, and the evaluation of its policies."""

import abc
import collections
import hashlib
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
import torch
from numpy.typing import NDArray

from kitchen_suite.episodes.play import Controller, VectorRollout
from kitchen_suite.policies.stored import StoredPolicy
from kitchen_suite.tasks.task import SuiteTask
from kitchen_suite.training.checkpoints import Checkpoint, check_modules
from kitchen_suite.vector_env.base import SuiteVectorEnv

EPISODE_METRICS = ("episode/success", "episode/progress", "episode/length")


class DivergedError(Exception):
    """A network's parameters are no longer finite."""


class Learner(abc.ABC):
    """Learns step by step, and exports a policy.

    Attributes:
      steps: learned from so far: control steps over all environments, or steps of the optimiser.
      warmup_batches: batches that still train the value network alone.
    """

    steps = 0
    warmup_batches = 0

    @property
    @abc.abstractmethod
    def modules(self) -> Mapping[str, Any]:
        """Networks, scalers and optimiser by name."""

    def start(self, seed: int) -> None:  # noqa: B027
        """Begins to learn, with episodes of seeds from a first one."""

    @abc.abstractmethod
    def learn(self) -> dict[str, float]:
        """Learns from a batch, or makes some steps of the optimiser; returns metrics by name."""

    @abc.abstractmethod
    def export(self, metadata: Mapping[str, Any]) -> StoredPolicy:
        """Returns the present policy, without exploration."""

    @abc.abstractmethod
    def controller(self, policy: StoredPolicy, environments: SuiteVectorEnv) -> Controller:
        """Returns a controller that acts by an exported policy."""

    def check_finite(self, networks: Mapping[str, torch.nn.Module]) -> None:
        """Raises a DivergedError unless all parameters of networks, by name, are finite."""
        for name, network in networks.items():
            if not all(parameter.isfinite().all() for parameter in network.parameters()):
                problem = f"the {name} network is no longer finite: lower the learning rate"
                raise DivergedError(f"after {self.steps} steps {problem}")

    def state(self) -> dict[str, Any]:
        """Returns the state of learning, as in a `Checkpoint`; that of the episodes in progress is not part of it."""
        return {
            "modules": {name: module.state_dict() for name, module in self.modules.items()},
            "random": torch.get_rng_state(),
            "steps": self.steps,
            "warmup_batches": self.warmup_batches,
        }

    def check_fits(self, checkpoint: Checkpoint) -> None:
        """Checks that `load_state` can restore a checkpoint; raises a ValueError if it is one of other networks."""
        check_modules(checkpoint.modules, self.modules)
        # A generator of its own, so that a random state that is refused changes nothing.
        torch.Generator().set_state(checkpoint.random)

    def load_state(self, checkpoint: Checkpoint) -> None:
        """Restores the state of learning; the checkpoint has to fit."""
        for name, module in self.modules.items():
            module.load_state_dict(checkpoint.modules[name])
        torch.set_rng_state(checkpoint.random)
        self.steps, self.warmup_batches = checkpoint.steps, checkpoint.warmup_batches


class Training(abc.ABC):
    """The settings of a run as its algorithm reads them, and the environments or demonstrations that it learns from.

    Attributes:
      title: name of the algorithm.
      steps: name of the steps that it counts.
      config: hyperparameters, a dataclass.
      training_kwargs: arguments of the environments that are trained in alone.
      max_episode_steps: of evaluations.
      data: recorded arrays that are learned from, or arrays of the policy that is started from.
    """

    title: str
    steps: ClassVar[str]
    config: Any
    training_kwargs: dict[str, Any]
    max_episode_steps: int
    data: Sequence[NDArray] = ()

    @property
    def data_sha256(self) -> str:
        """SHA-256 of the data: of the shape of each array, and of the SHA-256 of its contents."""
        parts = [(each.shape, hashlib.sha256(each.ravel().view(np.uint8).data).hexdigest()) for each in self.data]
        return hashlib.sha256(repr(parts).encode()).hexdigest()

    @abc.abstractmethod
    def make_learner(self, seed: int) -> Learner:
        """Returns a new learner."""

    def prepare(self, learner: Any) -> None:  # noqa: B027
        """Prepares the learner of a new run for its first step, such as by cloning."""

    def close(self) -> None:  # noqa: B027
        """Closes the environments that are trained in."""


def episode_metrics(task: SuiteTask, infos: Mapping[str, Any]) -> dict[str, NDArray]:
    """Returns the `EPISODE_METRICS` `(n,)` of episodes of a task from their last infos."""
    values = (infos["is_success"], task.records.progress(infos), infos["episode_step"])
    return {name: np.asarray(value, np.float64) for name, value in zip(EPISODE_METRICS, values, strict=True)}


def evaluate(controller: Controller, environments: SuiteVectorEnv, seeds: Sequence[int]) -> dict[str, NDArray]:
    """Plays an episode of each seed, without exploration.

    Environments have autoreset mode `Disabled`. Returns metrics of the episodes `(n,)` by name: those of
    `episode_metrics`, and `episode/return`; all are 0 for an episode in which the physics has diverged.
    """
    task = environments.composer_task
    metrics = {name: np.zeros(len(seeds)) for name in (*EPISODE_METRICS, "episode/return")}
    for index, episode in VectorRollout(environments, controller).play(collections.deque(enumerate(seeds))):
        if not episode.diverged:
            last = {**episode_metrics(task, episode.last_info), "episode/return": episode.rewards.sum()}
            for name, value in last.items():
                metrics[name][index] = value
    return metrics
