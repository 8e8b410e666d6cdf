"""The work of `kitchen-train`."""

import contextlib
import dataclasses
import functools
import json
import shutil
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from dm_control.rl.control import PhysicsError
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from tqdm import tqdm

from kitchen_suite import checks, files, suite
from kitchen_suite.policies import PolicyError
from kitchen_suite.policies.trained import TrainedPolicy
from kitchen_suite.rendering import video
from kitchen_suite.rollouts.play_job import policy_rollout
from kitchen_suite.rollouts.report import print_line
from kitchen_suite.rollouts.rollout_job import RolloutJob
from kitchen_suite.rollouts.settings import PlaySettings
from kitchen_suite.rollouts.spec import RecordingSpec
from kitchen_suite.training import run_folder
from kitchen_suite.training.behaviour_cloning import OBSERVATION_OPTIONS, load_demonstrations
from kitchen_suite.training.checkpoints import CheckpointError
from kitchen_suite.training.hyperparameters import Hyperparameters
from kitchen_suite.training.learner import DivergedError, Learner
from kitchen_suite.training.seed_run import EVALUATION_SEEDS, HEADING, POLICY_FILE, SeedRun, StopReason
from kitchen_suite.training.settings import TrainSettings
from kitchen_suite.vector_env.base import SuiteVectorEnv

# Below the success rate and mean return of any evaluation.
_NO_RESULT = (-1.0, 0.0)

_VIDEO_FPS = PlaySettings.video_fps


class TrainJob:
    """Trains with one seed, and with further seeds as long as there is no progress."""

    failures = (CheckpointError, DivergedError, OSError, PhysicsError, PolicyError)
    usage_errors = ()

    def __init__(self, settings: TrainSettings) -> None:
        """Prepares the training, so that bad settings are refused before the first step.

        Raises:
          ImportError: a video is asked for, but there is no ffmpeg.
          OSError: the folder cannot be written to, holds another run, or holds none to resume; or there are no
            demonstrations where the settings say so.
          TypeError: an argument of the task or a hyperparameter has the wrong type or does not exist.
          ValueError: an unknown name, or a value that is refused.
        """
        self._schedule = settings.schedule
        if self._schedule.num_steps == 0 and not settings.demonstrations:
            raise ValueError("num_steps 0 is for cloning alone, which needs --demonstrations")
        self._settings = settings
        self._spec = self._make_spec(settings.environment_kwargs, None)
        self._training_kwargs = self._make_training_kwargs()
        if settings.video:
            video.check_ffmpeg()
        self._config = Hyperparameters.for_domain(
            settings.domain_name, settings.hyperparameters, cloning=settings.demonstrations is not None
        )
        self._metadata: dict[str, Any] = {
            "domain_name": settings.domain_name,
            "task_name": self._spec.task_name,
            "task_kwargs": settings.environment_kwargs,
            "training_kwargs": self._training_kwargs,
            "hyperparameters": dataclasses.asdict(self._config),
        }
        training = self._make_training_spec()
        self._environments = self._make_environments(training, self._config.num_envs, AutoresetMode.SAME_STEP)
        evaluation = dataclasses.replace(self._spec, max_episode_steps=training.max_episode_steps)
        self._evaluation_environments = self._make_environments(
            evaluation, settings.eval_episodes, AutoresetMode.DISABLED
        )
        self._initial_policy, self._demonstrations = self._load_initial_policy(), self._load_demonstrations()
        # Raises a ValueError if hyperparameters or initial policy do not fit the environments.
        self._make_learner(settings.seed)
        self._seed_run: SeedRun | None = None
        self._best = self._present_best() if settings.resume else _NO_RESULT
        prepare = run_folder.open_run if settings.resume else run_folder.create_run
        prepare(settings.output, run_folder.RunDescription(**self._metadata, seed=settings.seed))

    def progress(self) -> str:
        steps = self._seed_run.steps if self._seed_run else 0
        return (
            f"after {steps:,} of {self._schedule.num_steps:,} steps; "
            "the same command with --resume continues from the last checkpoint"
        )

    def run(self) -> bool:
        """Trains; prints a table of the evaluations, and why each seed stopped.

        Raises:
          CheckpointError: a run is to be resumed, but none of its checkpoints can be read.
          DivergedError: the parameters of a network are no longer finite.
          OSError: a file cannot be written.
        """
        # The matrices are small: with a second thread, training is slower.
        torch.set_num_threads(1)
        settings = self._settings
        print_line(f"{settings.domain_name} {self._spec.task_name}, PPO, in {settings.output}")
        print_line(f"curves: tensorboard --logdir={settings.output}\n\n{HEADING}")
        with contextlib.closing(self._environments), contextlib.closing(self._evaluation_environments):
            for seed in range(settings.seed, settings.seed + settings.restarts + 1):
                if self._train_seed(seed) is not StopReason.NO_PROGRESS:
                    break
        print_line(f"best policy: {settings.output / POLICY_FILE}")
        if settings.video:
            self._film(settings.video)
        return True

    def _train_seed(self, seed: int) -> StopReason:
        """Trains with one seed; returns why it stopped."""
        folder = self._settings.output / f"seed_{seed}"
        learner = self._make_learner(seed)
        run = SeedRun(folder, seed, self._schedule, learner, self._evaluation_environments, self._metadata)
        self._seed_run = run
        if self._demonstrations and not run.resumed:
            with _cloning_bar(self._config.clone_epochs) as report:
                learner.imitate(*self._demonstrations, report)
        reason = run.run(functools.partial(self._report, run))
        self._keep_if_best(run)
        success, mean_return = run.best
        print_line(f"seed {seed}: {reason.value}; best evaluation: success {success:.0%}, return {mean_return:.1f}")
        return reason

    def _make_learner(self, seed: int) -> Learner:
        """Returns a new learner, which starts from the initial policy if there is one."""
        learner = Learner(self._environments, self._config, seed)
        if self._initial_policy:
            learner.adopt(self._initial_policy)
        return learner

    def _report(self, run: SeedRun, row: str) -> None:
        """Prints the row of an evaluation, after which the policy may be the best so far."""
        self._keep_if_best(run)
        print_line(row)

    def _present_best(self) -> tuple[float, float]:
        """Returns success rate and mean return of the policy in the folder of a run that is resumed."""
        try:
            metadata = files.load_metadata(self._settings.output / POLICY_FILE, "a trained policy")
            training = metadata["training"]
            return float(training["success"]), float(training["return"])
        except (KeyError, OSError, TypeError, ValueError):  # There is none, or a damaged one.
            return _NO_RESULT

    def _keep_if_best(self, run: SeedRun) -> None:
        """Copies the policy of a seed to the folder of the run if it is the best of all seeds so far."""
        if run.best > self._best:
            self._best = run.best
            with files.atomic_write(self._settings.output / POLICY_FILE) as partial:
                shutil.copyfile(run.policy_file, partial)

    def _film(self, file: Path) -> None:
        """Films the best policy on a seed that it was not trained with."""
        policy = self._settings.output / POLICY_FILE
        RolloutJob(
            policy_rollout(policy, num_episodes=1, seed=EVALUATION_SEEDS, video=file, video_fps=_VIDEO_FPS)
        ).run()
        print_line(f"video {file}")

    def _make_spec(self, task_kwargs: Mapping[str, Any], max_episode_steps: int | None) -> RecordingSpec:
        """Returns the specification of environments of the task, with which `kitchen-play` can play the policy."""
        settings = self._settings
        spec = RecordingSpec.make(
            domain_name=settings.domain_name,
            task_name=settings.task_name,
            task_kwargs=task_kwargs,
            policy="zero",
            seed=settings.seed,
            seeding="gymnasium",
            max_episode_steps=max_episode_steps,
        )
        default = spec.env_class.observed.default_type
        if spec.task_kwargs.get("obs_type") not in (None, default):
            raise ValueError(
                f"obs_type {spec.task_kwargs['obs_type']!r} cannot be trained on here: policies take the domain's "
                f"default, {default!r}; leave obs_type out"
            )
        spec.make_environment().close()
        return spec

    def _make_training_kwargs(self) -> dict[str, Any]:
        """Returns the arguments of the environments that are trained in, which replace those of the task.

        The domain's are left out where the task's arguments have them.

        Raises:
          ValueError: observations or actions would have another meaning than in those that are evaluated in.
        """
        settings = self._settings
        domain = suite.DOMAINS[settings.domain_name]
        own = {} if settings.demonstrations else domain.training_options
        defaults = {name: value for name, value in own.items() if name not in settings.environment_kwargs}
        arguments = json.loads(json.dumps({**defaults, **settings.training_kwargs}))
        if shared := sorted({*OBSERVATION_OPTIONS, *domain.cloning_options} & arguments.keys()):
            raise ValueError(f"training_kwargs cannot change {shared}, on which the policy depends: use --task_kwargs")
        return arguments

    def _make_training_spec(self) -> RecordingSpec:
        """Returns the specification of the environments that are trained in."""
        arguments = {**self._settings.environment_kwargs, **self._training_kwargs}
        steps = arguments.pop("max_episode_steps", None)
        if steps is not None:
            checks.integer(steps, "max_episode_steps", minimum=1)
        return self._make_spec(arguments, steps)

    def _make_environments(self, spec: RecordingSpec, count: int, autoreset_mode: AutoresetMode) -> SuiteVectorEnv:
        options = suite.DOMAINS[spec.domain_name].flat_options
        return spec.make_vector_env(count, self._settings.num_threads, autoreset_mode, **options)

    def _load_initial_policy(self) -> TrainedPolicy | None:
        """Returns the policy to start from, if any; raises as `TrainedPolicy.load`.

        Raises:
          ValueError: it is of another domain, or demonstrations are to be cloned.
        """
        path = self._settings.initial_policy
        if path is None:
            return None
        if self._settings.demonstrations:
            raise ValueError("--initial_policy and --demonstrations both give a policy to start from: give one of them")
        policy = TrainedPolicy.load(path)
        if (domain := policy.metadata["domain_name"]) != self._settings.domain_name:
            raise ValueError(f"{path} is a policy of the domain {domain}, not of {self._settings.domain_name}")
        return policy

    def _load_demonstrations(self) -> tuple[NDArray[np.float32], NDArray[np.float32]] | None:
        """Returns the observations and actions to clone, if any; raises as `load_demonstrations`.

        Raises:
          ValueError: their shapes are not those of this task.
        """
        folder = self._settings.demonstrations
        if folder is None:
            return None
        observations, actions = load_demonstrations(folder, self._spec)
        space, shape = self._environments.single_observation_space, self._environments.single_action_space.shape
        found, expected = (observations.shape[1:], actions.shape[1:]), ((spaces.flatdim(space),), shape)
        if found != expected:
            raise ValueError(f"{folder} holds observations and actions of shapes {found}, but this task has {expected}")
        return observations, actions


@contextlib.contextmanager
def _cloning_bar(epochs: int) -> Iterator[Callable[[float], None]]:
    """Shows a progress bar; yields the function that takes the loss of each epoch."""
    with tqdm(total=epochs, desc="cloning", unit="epoch", disable=None, leave=False) as bar:

        def report(loss: float) -> None:
            bar.set_postfix_str(f"loss {loss:.4f}", refresh=False)
            bar.update()

        yield report
