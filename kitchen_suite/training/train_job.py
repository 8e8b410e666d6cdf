"""The work of `kitchen-train`."""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import contextlib
import dataclasses
import shutil
from typing import Any, ClassVar

import torch
from dm_control.rl.control import PhysicsError

from kitchen_suite import checks, files
from kitchen_suite.episodes.report import print_line
from kitchen_suite.episodes.rollout_job import RolloutJob, policy_rollout
from kitchen_suite.episodes.spec import EnvironmentSpec
from kitchen_suite.policies import PolicyError
from kitchen_suite.rendering import video
from kitchen_suite.settings import ALGORITHMS, FAILURE, OFFLINE, PPO, PlaySettings, TrainSettings
from kitchen_suite.training.checkpoints import CheckpointError
from kitchen_suite.training.learner import DivergedError, Training
from kitchen_suite.training.reinforcement import PPOTraining, make_spec
from kitchen_suite.training.run_folder import RunDescription
from kitchen_suite.training.seed_run import EVALUATION_SEEDS, HEADING, NO_RESULT, POLICY_FILE, SeedRun, StopReason

_EVALUATION_ENVS = 20  # Environments that policies are evaluated in.

# What makes a finished seed train on, with the flags as fields of its `Schedule`.
_TRAIN_ON = {
    StopReason.TARGET: "a --target_success above {target_success:g}",
    StopReason.STEPS: "a --num_steps above {num_steps}",
    StopReason.NO_PROGRESS: "a --patience above {patience}, or of 0,",
}


class TrainJob:
    """Trains with one seed, and with further seeds as long as there is no progress.

    Attributes:
      training: environments or demonstrations of the algorithm, and its settings.
      evaluation_environments: those that policies are evaluated in.
      metadata: of exported policies; `domain_name`, `task_name`, `task_kwargs`, `training_kwargs`, `hyperparameters`.
    """

    errors: ClassVar = dict.fromkeys((CheckpointError, DivergedError, OSError, PhysicsError, PolicyError), FAILURE)

    def __init__(self, settings: TrainSettings) -> None:
        """Prepares the training, so that bad settings are refused before the first step."""
        self._settings, self._schedule = settings, settings.schedule
        self._spec = make_spec(settings, settings.environment_kwargs)
        if settings.video:
            video.check_ffmpeg()
        self.training = make_training(settings, self._spec)
        self.metadata: dict[str, Any] = {
            "domain_name": settings.domain_name,
            "task_name": self._spec.task_name,
            "task_kwargs": settings.environment_kwargs,
            "training_kwargs": self.training.training_kwargs,
            "hyperparameters": dataclasses.asdict(self.training.config),
        }
        evaluation = dataclasses.replace(self._spec, max_episode_steps=self.training.max_episode_steps)
        options, count = self._spec.env_class.flat_options, min(settings.eval_episodes, _EVALUATION_ENVS)
        self.evaluation_environments = evaluation.make_vector_env(count, settings.num_threads, **options)
        # Raises a ValueError if hyperparameters or initial policy do not fit the environments.
        self.training.make_learner(settings.seed)
        self._seed_run: SeedRun | None = None
        self._best = self._present_best() if settings.resume else NO_RESULT
        own: dict[str, Any] = {"algorithm": settings.algorithm, "data_sha256": self.training.data_sha256}
        description = RunDescription(**self.metadata, seed=settings.seed, **own)
        (description.resume if settings.resume else description.create)(settings.output)

    def progress(self) -> str:
        steps = self._seed_run.steps if self._seed_run else 0
        done = f"after {steps:,} of {self._schedule.num_steps:,} steps"
        return f"{done}; the same command with --resume continues from the last checkpoint"

    def run(self) -> bool:
        """Trains; prints a table of the evaluations, and why each seed stopped."""
        # The matrices are small: with a second thread, training is slower.
        torch.set_num_threads(1)
        settings = self._settings
        print_line(f"{settings.domain_name} {self._spec.task_name}, {self.training.title}, in {settings.output}")
        schedule, steps = self._schedule, f"at most {self._schedule.num_steps:,} {self.training.steps} for each seed"
        print_line(f"{steps}, evaluated every {schedule.eval_interval:,} in {schedule.eval_episodes} episodes")
        if schedule.target_success <= 1.0:
            target = f"{100 * schedule.target_success:.4g} %"
            print_line(f"ends once two evaluations in a row reach a success of {target} (--target_success)")
        print_line(f"curves: tensorboard --logdir={settings.output}\n\n{HEADING}")
        with contextlib.closing(self.training), contextlib.closing(self.evaluation_environments):
            for seed in range(settings.seed, settings.seed + settings.restarts + 1):
                if self._train_seed(seed) is not StopReason.NO_PROGRESS:
                    break
        print_line(f"best policy: {settings.output / POLICY_FILE}")
        if settings.video:
            best, fps = settings.output / POLICY_FILE, PlaySettings.video_fps
            film = policy_rollout(best, num_episodes=1, seed=EVALUATION_SEEDS, video=settings.video, video_fps=fps)
            RolloutJob(film).run()
            print_line(f"video {settings.video}")
        return True

    def _train_seed(self, seed: int) -> StopReason:
        folder = self._settings.output / f"seed_{seed}"
        learner = self.training.make_learner(seed)
        run = SeedRun(folder, seed, self._schedule, learner, self.evaluation_environments, self.metadata)
        self._seed_run = run
        if not run.resumed:
            self.training.prepare(learner)

        first_step, was_resumed = run.steps, run.resumed

        def report(row: str) -> None:
            self._keep_if_best(run)
            print_line(row)

        reason = run.run(report)
        self._keep_if_best(run)
        success, mean_return = run.best
        print_line(f"seed {seed}: {reason.value}; best evaluation: success {success:.0%}, return {mean_return:.1f}")
        if was_resumed and run.steps == first_step:
            print_line(f"seed {seed} had finished before: {_TRAIN_ON[reason].format(**vars(self._schedule))} trains on")
        return reason

    def _present_best(self) -> tuple[float, float]:
        """Returns success rate and mean return of the policy in the folder of a run that is resumed."""
        try:
            metadata = files.load_metadata(self._settings.output / POLICY_FILE, "a trained policy")
            training = metadata["training"]
            return float(training["success"]), float(training["return"])
        except (KeyError, OSError, TypeError, ValueError):  # There is none, or a damaged one.
            return NO_RESULT

    def _keep_if_best(self, run: SeedRun) -> None:
        """Copies the policy of a seed to the folder of the run if it is the best of all seeds so far."""
        if run.best > self._best:
            self._best = run.best
            with files.atomic_write(self._settings.output / POLICY_FILE) as partial:
                shutil.copyfile(run.policy_file, partial)


def make_training(settings: TrainSettings, spec: EnvironmentSpec) -> Training:
    """Returns the training of the algorithm that settings name; raises a ValueError for an unknown one."""
    checks.choice(settings.algorithm, ALGORITHMS, "algorithm")
    if settings.algorithm == PPO:
        return PPOTraining(settings, spec)
    # It needs a further package.
    from kitchen_suite.training.recorded import ImitationTraining, OfflineTraining

    training = OfflineTraining if settings.algorithm in OFFLINE else ImitationTraining
    return training(settings, spec)
