"""Interfaces between a training run and the algorithms that it may train with."""

from collections.abc import Mapping
from typing import Any, Protocol

from kitchen_suite.policies.stored import StoredPolicy
from kitchen_suite.rollouts.controllers import Controller
from kitchen_suite.training.checkpoints import Checkpoint
from kitchen_suite.vector_env.base import SuiteVectorEnv


class Learner(Protocol):
    """Learns step by step, and exports what it has learned.

    Attributes:
      steps: learned from so far: control steps over all environments, or steps of the optimiser.
    """

    steps: int

    def start(self, seed: int) -> None:
        """Begins to learn, with episodes of seeds from a first one."""

    def learn(self) -> dict[str, float]:
        """Learns a little; returns metrics by name."""

    def export(self, metadata: Mapping[str, Any]) -> StoredPolicy:
        """Returns the present policy."""

    def controller(self, policy: StoredPolicy, environments: SuiteVectorEnv) -> Controller:
        """Returns a controller that acts by an exported policy."""

    def state(self) -> dict[str, Any]:
        """Returns the state of learning, as in a `Checkpoint`."""

    def check_fits(self, checkpoint: Checkpoint) -> None:
        """Checks that `load_state` can restore a checkpoint.

        Raises:
          ValueError: it is one of other networks.
        """

    def load_state(self, checkpoint: Checkpoint) -> None:
        """Restores the state of learning; the checkpoint has to fit."""


class Training(Protocol):
    """The settings of a run as its algorithm reads them, and what it learns from.

    Attributes:
      title: name of the algorithm.
      config: hyperparameters, a dataclass.
      training_kwargs: arguments of the environments that are trained in alone.
      max_episode_steps: of evaluations.
    """

    title: str
    config: Any
    training_kwargs: dict[str, Any]
    max_episode_steps: int

    def make_learner(self, seed: int) -> Learner:
        """Returns a new learner."""

    def prepare(self, learner: Any) -> None:
        """Does what comes before the first step of a new run."""

    def close(self) -> None:
        """Closes the environments that are trained in."""
