"""Training by imitation: the demonstrations, and the learners from them."""

from typing import Any

from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.rollouts.spec import EnvironmentSpec
from kitchen_suite.training.hyperparameters import checked_changes
from kitchen_suite.training.imitation import demonstrations
from kitchen_suite.training.imitation.learner import ImitationLearner
from kitchen_suite.training.imitation.methods import METHODS
from kitchen_suite.training.settings import TrainSettings


class ImitationTraining:
    """The demonstrations and hyperparameters of a run by imitation; see `learning.Training`."""

    def __init__(self, settings: TrainSettings, spec: EnvironmentSpec) -> None:
        """Reads the demonstrations.

        Args:
          settings: of the run.
          spec: of the environments that are evaluated in.

        Raises:
          OSError: the demonstrations cannot be read.
          TypeError: a hyperparameter has the wrong type.
          ValueError: a setting is missing, or for PPO alone; or demonstrations or a hyperparameter do not fit.
        """
        name, folders = settings.algorithm, settings.demonstrations
        if not folders:
            raise ValueError(f"algorithm {name!r} needs --demonstrations, a folder written by kitchen-record")
        for flag in ("initial_policy", "training_kwargs"):
            if getattr(settings, flag):
                raise ValueError(f"--{flag} is for the algorithm 'ppo', not for {name!r}")
        self._method = METHODS[name]
        self.title = self._method.__doc__.partition(":")[0]
        self.config: Any = checked_changes(self._method.hyperparameters(), settings.hyperparameters)
        if self.config.executed > self.config.chunk:
            raise ValueError(f"executed must be at most chunk, {self.config.chunk}, got {self.config.executed}")
        self.training_kwargs: dict[str, Any] = {}
        self.max_episode_steps = spec.max_episode_steps
        self._num_steps = settings.schedule.num_steps
        with spec.make_environment() as environment:
            self._tasks = suite_env(environment).environment.task.drawn_tasks
        self._demonstrations = demonstrations.load_all(folders, spec, self._tasks, settings.num_demonstrations)

    def make_learner(self, seed: int) -> ImitationLearner:
        return ImitationLearner(
            self._demonstrations, self._method, self.config, num_steps=self._num_steps, seed=seed, tasks=self._tasks
        )

    def prepare(self, learner: ImitationLearner) -> None:
        """Does nothing: demonstrations are all that it learns from."""

    def close(self) -> None:
        """Does nothing: there are no environments to learn in."""
