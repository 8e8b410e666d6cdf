"""Episodes in progress, step by step: those of a policy, and those of a person, who can go back and try again."""

import contextlib
import functools
import hashlib
import itertools
import json
import shutil
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kitchen_suite import files, policies
from kitchen_suite.episodes.episode import EpisodeArrays, EpisodeStats
from kitchen_suite.episodes.play import RewindableRollout, SingleRollout
from kitchen_suite.episodes.recording import RecordingFolder
from kitchen_suite.episodes.spec import EpisodeSpec
from kitchen_suite.gymnasium_env.base import suite_env

if TYPE_CHECKING:
    from dm_control import mjcf

    from kitchen_suite.policies.experts.teleoperation import TeleoperatedPolicy, Teleoperation

_SAVE_EVERY = 1.0  # Time between two copies of an episode that has not been saved yet [s].

# Simulated time in which neither hand nor fingers move after which time stands still again [s], and distance [m] and
# difference of a quaternion below which they do not. Who learns from episodes has no use for steps without motion.
_PATIENCE, _STILL = 0.15, 0.002

_BEGINNING = 0.3  # Simulated time that the arm has to begin to move [s].
UNSAVED = "unsaved"  # Folder of an episode that has not been saved yet, in the folder of those that have been.


class LiveEpisode:
    """The episode in progress of a specification, which is played step by step.

    Attributes:
      seed: of the episode.
      spec: of the episodes.
      timestep: duration of a control step [s].
    """

    seed: int

    def __init__(self, spec: EpisodeSpec, *, render_quality: str = "fast") -> None:
        """Builds environment and policy; `start` has to be called before anything else."""
        self.spec = spec
        self._rollout = self._make_rollout(render_quality)
        self._environment = suite_env(self._rollout.environment).environment
        self.timestep = self._environment.control_timestep()

    def _make_rollout(self, render_quality: str) -> SingleRollout:
        return SingleRollout(self.spec, visuals=True, render_quality=render_quality)

    @property
    def physics(self) -> "mjcf.Physics":
        """The physics, another object after a reset that compiles the model again."""
        return self._environment.physics

    @property
    def steps(self) -> int:
        """Control steps that have been made."""
        return self._rollout.buffer.steps

    @property
    def has_ended(self) -> bool:
        """Whether the episode has terminated or was truncated."""
        return self._rollout.buffer.has_ended

    @property
    def is_waiting(self) -> bool:
        """Whether time stands still until a person does something."""
        return False

    def start(self, seed: int, options: Mapping[str, Any] | None = None) -> None:
        """Starts the episode of a seed, and of the options of its reset; raises as `SingleRollout.start`."""
        self.seed, self._has_failed = seed, False
        self._rollout.start(seed, options=options)

    def step(self) -> None:
        """Makes a control step, unless the episode has ended; raises what `SingleRollout.step` does.

        After an error, such as physics that diverges, it raises a RuntimeError until the episode is started again.
        """
        if self._has_failed:
            raise RuntimeError("the episode cannot go on: the last control step was not completed")
        if not self.has_ended:
            self._has_failed = True
            self._rollout.step()
            self._has_failed = False

    def report(self) -> str:
        """Returns the progress of the episode as Markdown: the tasks that it asks for, reward and measures."""
        task, buffer = self._environment.task, self._rollout.buffer
        numbers = {
            "time": f"{buffer.steps * self.timestep:.1f} s",
            "control step": f"{buffer.steps} of {self.spec.max_episode_steps}",
            "reward": f"{buffer.reward:.3f}",
            "return": f"{buffer.total_reward:.3f}",
        }
        for name, value in task.episode_metrics.items():
            if not isinstance(value, dict):
                numbers[name.replace("_", " ")] = ("no", "yes")[value] if isinstance(value, bool) else f"{value:.3f}"
        lines = [f"**{task.instruction}**", ""] if task.instruction else []
        if completions := task.episode_completions:
            steps = {name.replace("_", " "): step for name, step in completions.steps_by_task.items()}
            done = {name: step * self.timestep for name, step in steps.items() if step is not None}
            lines += [
                f"- **{name}**: completed after {done[name]:.1f} s" if name in done else f"- {name}" for name in steps
            ]
            numbers = {"tasks completed": f"{len(done)} of {len(steps)}", **numbers}
        numbers |= self._further_numbers()
        return "\n".join([*lines, "", "| | |", "| --- | --- |", *(f"| {key} | {it} |" for key, it in numbers.items())])

    def close(self) -> None:
        """Frees the environment."""
        self._rollout.environment.close()

    def _further_numbers(self) -> dict[str, str]:
        return {}


class TeleoperatedEpisode(LiveEpisode):
    """An episode that a person plays, alone or in turns with a policy, who can go back.

    Its file can be played again to the bit, whatever has been tried on the way. While it is played, a copy without
    observations is kept, from which it goes on after a crash: another start of the same seed makes its control steps
    again.

    Attributes:
      is_finished: whether the person has said that it is done.
      saved: number of episodes that have been saved.
      last_saved: seed of the one that was saved last, and whether its task was done, in words; empty without one.
    """

    _rollout: RewindableRollout
    _moved: int
    _place: NDArray[np.float64]

    def __init__(self, spec: EpisodeSpec, *, unsaved: Path | None = None, render_quality: str = "fast") -> None:
        """Builds environment and policy; that of the specification is `teleop`, with options or without.

        The folder `unsaved` of the copies is removed where there is none; without it there are no copies.
        """
        self._folder: RecordingFolder | None = None
        self._unsaved, self.saved = unsaved, 0
        self.last_saved = ""
        self.can_rewind = policies.options_of(spec.policy).get("rewind", True)
        super().__init__(spec, render_quality=render_quality)

    def keep_in(self, folder: Path) -> None:
        """Saves episodes in a folder by their seeds, and copies below it; raises as `RecordingFolder.claim`."""
        self._folder, self._unsaved = RecordingFolder.claim(folder, self.spec), folder / UNSAVED

    def _make_rollout(self, render_quality: str) -> RewindableRollout:
        # Without the checks of `policies.find`, behind which the arm could not be reached.
        build = functools.partial(policies.POLICIES["teleop"], **policies.options_of(self.spec.policy))
        return RewindableRollout(self.spec, build, visuals=True, render_quality=render_quality)

    @property
    def policy(self) -> "TeleoperatedPolicy":
        """The person's policy."""
        return self._rollout.policy  # type: ignore[return-value]

    @property
    def arm(self) -> "Teleoperation":
        """The arm, to be commanded."""
        return self.policy.arm

    @property
    def is_waiting(self) -> bool:
        return self.has_ended or (self.policy.is_persons and self.arm.is_idle)

    @property
    def next_seed(self) -> int:
        """The first seed from that of this episode on of which no episode has been saved."""
        return next(seed for seed in itertools.count(self.seed) if seed not in self.present)

    @property
    def present(self) -> list[int]:
        """Seeds of the episodes that have been saved."""
        return self._folder.indices if self._folder else []

    def start(self, seed: int, options: Mapping[str, Any] | None = None) -> None:
        """Starts the episode of a seed, or goes on with its copy; raises an OSError if that cannot be read."""
        self._start(seed, options)
        self._resume_copy()

    def start_from(self, episode: EpisodeArrays, steps: int | None = None) -> None:
        """Starts an episode by the first control steps of a recorded one, by all of them without a number.

        Raises a ValueError if that does not lead to the recorded state, or there are fewer control steps.
        """
        if episode.seed is None:
            raise ValueError("the recording has no seeds, so that its episodes cannot be played again")
        count = episode.steps if steps is None else steps
        if not 0 <= count <= episode.steps:
            raise ValueError(f"the recorded episode has {episode.steps} control steps, not {count}")
        if count > self.spec.max_episode_steps:
            raise ValueError(f"an episode has {self.spec.max_episode_steps} control steps, fewer than {count}")
        self._start(episode.seed, None)
        if not self._resume_copy():
            self._repeat(episode, count)

    def _resume_copy(self) -> bool:
        """Makes the control steps of the copy again that was kept of this episode, if there is one."""
        copies = self._copies()
        if copies is None or self.seed not in copies.indices:
            return False
        try:
            self._repeat(copies.load(self.seed))
        except ValueError as error:
            raise OSError(f"{self._unsaved} has a copy of this episode: {error}; remove it to start anew") from error
        return True

    def _start(self, seed: int, options: Mapping[str, Any] | None) -> None:
        self.is_finished, self._kept = False, time.monotonic()
        super().start(seed, options)
        self._observe()
        self._wait_for_motion()

    def _repeat(self, episode: EpisodeArrays, count: int | None = None) -> None:
        """Makes the first control steps of an episode again, and goes on from there."""
        arrays, buffer = episode.arrays, self._rollout.buffer
        count = episode.steps if count is None else count
        for step in range(count):
            labels = {"is_intervention": False, "teleop_action": arrays["action"][step]}
            labels |= {name: arrays[f"label/{name}"][step] for name in labels if f"label/{name}" in arrays}
            self._rollout.repeat(arrays["action"][step], labels)
        if differing := buffer.differing(arrays):
            raise ValueError(f"the recorded episode does not play again here: its {differing} differs")
        if count:
            self._observe()
            self.policy.take_over()
            self.arm.resume()

    def step(self) -> None:
        super().step()
        # Where the person acts, and nothing has moved for a while, time stands still.
        place = self._places()
        if not self.policy.is_persons or np.abs(place - self._place).max() > _STILL:
            self._moved, self._place = self.steps, place
        elif (self.steps - self._moved) * self.timestep >= _PATIENCE:
            self.arm.rest()
            self._wait_for_motion()
        if self.has_ended or time.monotonic() - self._kept >= _SAVE_EVERY:
            self.keep()

    def _wait_for_motion(self) -> None:
        self._moved, self._place = self.steps + round(_BEGINNING / self.timestep), self._places()

    def _places(self) -> NDArray[np.float64]:
        position, orientation = self.arm.hand
        # Of the two quaternions of an orientation the one that is positive where it is greatest.
        sign = np.sign(orientation[np.abs(orientation).argmax()])
        return np.concatenate([position, sign * orientation, self.arm.fingers])

    def hand_back(self) -> None:
        """Lets the policy act again from which the person took over, if there is one."""
        self.policy.hand_back()

    def rewind(self, steps: int) -> None:
        """Goes back by control steps, as far as states are kept; a ValueError where the specification forbids it."""
        self._check_may_rewind()
        self._rollout.rewind(steps)
        self._has_failed = False
        self._observe()
        self.policy.take_over()
        self.arm.resume()
        self._wait_for_motion()
        self.keep()

    def _check_may_rewind(self) -> None:
        if not self.can_rewind:
            raise ValueError("this episode cannot go back: its policy has the option rewind=False")

    def finish(self) -> None:
        """Ends the episode: its further control steps are made with the hand where it is."""
        self.policy.take_over()
        while not self.has_ended:
            super().step()
        self.is_finished = True

    def discard(self) -> None:
        """Starts the episode anew, and forgets what has been played of it; raises as `rewind`."""
        self._check_may_rewind()
        self.forget()
        self._start(self.seed, self._rollout.options)

    def save(self) -> bool:
        """Saves the episode up to now, and returns whether its task was done.

        Raises a ValueError where there is nothing to save, or an episode of its seed has been saved.
        """
        if self._folder is None or not self.steps:
            raise ValueError("there is nothing to save: make a control step first")
        if self._has_failed:
            raise ValueError("the last control step was not completed: go back, and then save")
        if self.seed in self.present:
            raise ValueError(f"an episode of seed {self.seed} has been saved already: choose another seed, and reset")
        episode = self.episode()
        stats = EpisodeStats.of(episode, self._environment.task.records.metrics(episode.last_info))
        self._folder.save(episode, stats)
        self.forget()
        self.saved += 1
        is_done = bool(stats.metrics["success"])
        self.last_saved = f"seed {self.seed}: the task was {'done' if is_done else 'not done'}"
        return is_done

    def episode(self, *, with_observations: bool = True) -> EpisodeArrays:
        """Returns the episode up to now, with at least one control step; argument as in `EpisodeBuffer.arrays`."""
        arrays, seconds = self._rollout.buffer.arrays(with_observations=with_observations), self.steps * self.timestep
        instruction = self._environment.task.instruction
        return EpisodeArrays(index=self.seed, seed=self.seed, arrays=arrays, seconds=seconds, instruction=instruction)

    def keep(self) -> None:
        """Writes a copy of the episode up to now, without observations: the same control steps lead to the same ones.

        A folder that cannot be written to is left alone.
        """
        self._kept = time.monotonic()
        if not self._unsaved:
            return
        if not self.steps:
            self.forget()
            return
        with contextlib.suppress(OSError):
            episode = self.episode(with_observations=False)
            stats = EpisodeStats.of(episode, self._environment.task.episode_metrics)
            RecordingFolder.claim(self._unsaved, self.spec).save(episode, stats)

    def _copies(self) -> RecordingFolder | None:
        return RecordingFolder.claim(self._unsaved, self.spec) if self._unsaved and self._unsaved.exists() else None

    def forget(self) -> None:
        """Removes the copy of this episode, and the folder of copies if it was the last one."""
        if copies := self._copies():
            copies.remove(self.seed)
            if self._unsaved and not copies.indices:
                shutil.rmtree(self._unsaved, ignore_errors=True)

    def _further_numbers(self) -> dict[str, str]:
        numbers = {
            "acts": "you" if self.policy.is_persons else "the policy",
            "hand": ", ".join(f"{number:.3f}" for number in self.arm.hand[0]) + " m",
            "fingers": "closed" if self.arm.is_closed else "open",
        }
        if self._folder:
            numbers |= {"episodes saved": str(self.saved), "not saved yet": f"{self.steps * self.timestep:.1f} s"}
            if self.last_saved:
                numbers["saved last"] = self.last_saved
        return numbers

    def _observe(self) -> None:
        """Shows the person's policy where the hand is."""
        environment = suite_env(self._rollout.environment)
        self.policy.observe(self._rollout.buffer.timestep(environment))


def kept_by_user(spec: EpisodeSpec, seed: int, options: Mapping[str, Any] | None) -> Path | None:
    """Returns the folder of the copies of an episode that has no folder of its own; None for a user without a home."""
    root = files.cache_folder()
    key = json.dumps([spec.as_json(), seed, dict(options or {})], default=np.ndarray.tolist)
    return root and root / "teleop" / hashlib.sha256(key.encode()).hexdigest()[:32]
