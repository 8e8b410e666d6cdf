"""What `kitchen-train` does once its flags are read."""

import contextlib
import dataclasses
import json
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, cast

import gymnasium
import numpy as np
import torch
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from tqdm import tqdm

from kitchen_suite import checks, files, gymnasium_env, suite
from kitchen_suite.rendering import video
from kitchen_suite.rollouts import rollout_job
from kitchen_suite.training.behaviour_cloning import load_demonstrations
from kitchen_suite.training.hyperparameters import Hyperparameters
from kitchen_suite.training.learner import Learner
from kitchen_suite.training.seed_run import EVALUATION_SEEDS, HEADING, POLICY_FILE, Schedule, SeedRun, StopReason
from kitchen_suite.vector_env.base import SuiteVectorEnv

RUN_FILE = "training.json"

# What a trained policy sees: arrays alone.
_ARRAYS = {"kitchen": {"goal_format": "flat", "info_format": "arrays"}, "open_cabinet": {}}


@dataclasses.dataclass(frozen=True, kw_only=True)
class Settings:
    """What is asked for; see the flags of `train`."""

    domain_name: str
    task_name: str | None
    task_kwargs: Mapping[str, Any]
    hyperparameters: Mapping[str, Any]
    schedule: Schedule
    seed: int
    restarts: int
    num_threads: int | None
    demonstrations: Path | None
    output: Path
    resume: bool
    video: Path | None = None


class TrainJob:
    """A training run: one seed, and further ones where a seed comes to no progress."""

    def __init__(self, settings: Settings) -> None:
        """Makes everything ready, so that nothing that can be known to be wrong stops the job later.

        Raises:
          ImportError: there is no ffmpeg, but a video is asked for.
          OSError: the folder cannot be written to or holds another run, there is none to be resumed, or there are no
            demonstrations where there should be.
          TypeError: an argument or a hyperparameter has the wrong type, or there is no such argument.
          ValueError: an unknown name, or a value that is refused.
        """
        domain = checks.choice(settings.domain_name, gymnasium_env.IDS.keys(), "env")
        self._settings = settings
        self._task_name = settings.task_name or suite.default_task(domain)
        self._check_playable()
        self._config = Hyperparameters.of(domain, settings.hyperparameters)
        self._metadata = {
            "domain_name": domain,
            "task_name": self._task_name,
            "task_kwargs": dict(settings.task_kwargs),
            "hyperparameters": dataclasses.asdict(self._config),
        }
        self._environments = self._build(self._config.num_envs, AutoresetMode.SAME_STEP)
        self._evaluated = self._build(settings.schedule.eval_episodes, AutoresetMode.NEXT_STEP)
        # It refuses what does not fit the environments.
        Learner(self._environments, self._config, settings.seed)
        self._demonstrations = self._load_demonstrations()
        self._best = (-1.0, 0.0)
        claim(settings.output, {**self._metadata, "seed": settings.seed}, resume=settings.resume)

    def run(self) -> None:
        """Trains; prints a table of evaluations, and how it ended.

        Raises:
          CheckpointError: a run is to be resumed, but none of its checkpoints can be read.
          DivergedError: a network is no longer finite.
          OSError: a file cannot be written.
        """
        # The matrices are small: a second thread costs more than it gives.
        torch.set_num_threads(1)
        settings = self._settings
        _print(f"{settings.domain_name} {self._task_name}, PPO, in {settings.output}")
        _print(f"curves: tensorboard --logdir={settings.output}\n\n{HEADING}")
        with contextlib.closing(self._environments), contextlib.closing(self._evaluated):
            for seed in range(settings.seed, settings.seed + settings.restarts + 1):
                if self._attempt(seed) is not StopReason.NO_PROGRESS:
                    break
        _print(f"best policy: {settings.output / POLICY_FILE}")
        if settings.video:
            self._film(settings.video)

    def _attempt(self, seed: int) -> StopReason:
        """Trains with one seed; its policy becomes the run's if it is the best so far."""
        settings, folder = self._settings, self._settings.output / f"seed_{seed}"
        learner = Learner(self._environments, self._config, seed)
        attempt = SeedRun(folder, seed, settings.schedule, learner, self._evaluated, self._metadata)
        if self._demonstrations and not attempt.resumed:
            with _cloning_bar(self._config.clone_epochs) as watch:
                learner.imitate(*self._demonstrations, watch)
        reason = attempt.run(_print)
        success, gain = attempt.best
        _print(f"seed {seed}: {reason.value}; best evaluation: success {success:.0%}, return {gain:.1f}")
        if attempt.best > self._best:
            self._best = attempt.best
            with files.whole_file(settings.output / POLICY_FILE) as partial:
                shutil.copyfile(folder / POLICY_FILE, partial)
        return reason

    def _load_demonstrations(self) -> tuple[NDArray[np.float32], NDArray[np.float32]] | None:
        folder = self._settings.demonstrations
        if folder is None:
            return None
        observations, actions = load_demonstrations(folder, self._settings.domain_name, self._task_name)
        space, shape = self._environments.single_observation_space, self._environments.single_action_space.shape
        found, wanted = (observations.shape[1:], actions.shape[1:]), ((spaces.flatdim(space),), shape)
        if found != wanted:
            raise ValueError(f"{folder} holds observations and actions of shapes {found}, but this task has {wanted}")
        return observations, actions

    def _film(self, video: Path) -> None:
        """Plays the best policy on a seed that it was not trained with."""
        file = self._settings.output / POLICY_FILE
        settings = rollout_job.settings_of_policy(file, num_episodes=1, seed=EVALUATION_SEEDS, video=video)
        rollout_job.RolloutJob(settings).run()
        _print(f"video {video}")

    def _check_playable(self) -> None:
        """Refuses arguments that `kitchen-play` could not play a policy with; raises what `suite.load` does."""
        arguments = {**self._settings.task_kwargs, "visuals": False}
        suite.load(self._settings.domain_name, self._task_name, arguments).close()
        if self._settings.video:
            video.check_ffmpeg()

    def _build(self, count: int, mode: AutoresetMode) -> SuiteVectorEnv:
        settings, domain = self._settings, self._settings.domain_name
        arguments = {**suite.task_arguments(domain, self._task_name), **_ARRAYS[domain], **settings.task_kwargs}
        return cast(
            SuiteVectorEnv,
            gymnasium.make_vec(
                gymnasium_env.IDS[domain],
                count,
                vectorization_mode="vector_entry_point",
                num_threads=settings.num_threads,
                autoreset_mode=mode,
                **arguments,
            ),
        )


def claim(folder: Path, run: Mapping[str, Any], *, resume: bool) -> None:
    """Makes a folder ready for a run, or sees to it that it holds the one to be resumed.

    Raises:
      OSError: it cannot be made or written to, or it holds a run that is not to be resumed, or none that is.
      ValueError: it holds a run of something else.
    """
    path = folder / RUN_FILE
    if not resume:
        folder.mkdir(parents=True, exist_ok=True)
        files.check_writable(folder)
        if path.exists():
            raise FileExistsError(f"{folder} holds a training run already: name another folder, or give --resume")
        with files.whole_file(path) as partial:
            partial.write_text(json.dumps(run, indent=2) + "\n", encoding="utf-8")
        return
    if not path.exists():
        raise FileNotFoundError(f"{folder} holds no training run to be resumed")
    files.check_writable(folder)
    for part in (folder, *folder.glob("seed_*")):
        files.sweep(part)
    present, wanted = _parts(json.loads(path.read_text(encoding="utf-8"))), _parts(json.loads(json.dumps(run)))
    for name in {**wanted, **present}:
        one, other = present.get(name), wanted.get(name)
        if one != other:
            raise ValueError(f"{folder} holds a run with {name} {json.dumps(one)}, not {json.dumps(other)}")


def _parts(run: Mapping[str, Any]) -> dict[str, Any]:
    """What a run is of, with the arguments of the task and the hyperparameters one by one."""
    parts: dict[str, Any] = {}
    for name, value in run.items():
        parts |= value if isinstance(value, dict) else {name: value}
    return parts


@contextlib.contextmanager
def _cloning_bar(epochs: int) -> Iterator[Callable[[float], None]]:
    """Gives what is to be called with the loss of each pass."""
    with tqdm(total=epochs, desc="cloning", unit="epoch", disable=None, leave=False) as bar:

        def watch(loss: float) -> None:
            bar.set_postfix_str(f"loss {loss:.4f}", refresh=False)
            bar.update()

        yield watch


def _print(text: str) -> None:
    """Prints above the progress bar, at once: the reader may be a pipe."""
    tqdm.write(text)
    sys.stdout.flush()
