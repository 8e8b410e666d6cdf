"""Episodes that a person plays, alone or in turns with a policy, who can go back and try again, and their files."""

import dataclasses
import itertools
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kitchen_suite import installation, policies
from kitchen_suite.environment import Environment
from kitchen_suite.episodes.episode import Episode
from kitchen_suite.episodes.play import RewindableRollout
from kitchen_suite.episodes.recording import Recording
from kitchen_suite.episodes.spec import EpisodeSpec
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.installation import EXTRA_PACKAGES
from kitchen_suite.policies import PolicyBuilder, PolicyRef
from kitchen_suite.viewer.live_episode import Choice, LiveEpisode

if TYPE_CHECKING:
    from kitchen_suite.policies.experts.teleoperation import TeleoperatedPolicy, Teleoperation

TELEOP = "teleop"  # Name of the policy in the specification of a person's episodes.

_EPISODE_STEPS = 2_000  # Control steps of an episode by default: a program needs a tenth.

# Time stands still after `_PATIENCE` without motion, of which those who learn from episodes have no use.
_PATIENCE = 0.15  # [s]
_STILL = 0.002  # Distance [m], or difference of a quaternion, below which nothing has moved.
_BEGINNING = 0.3  # Time that the arm has to begin to move [s].


class Stillness:
    """Counts the control steps in which neither hand nor fingers have moved."""

    def __init__(self, arm: "Teleoperation", timestep: float) -> None:
        """Begins to count for an arm that has been observed, in control steps of a duration [s]."""
        self._arm = arm
        self._timestep = timestep
        self.wait_for_motion()

    def wait_for_motion(self) -> None:
        """Gives the arm time to begin to move."""
        self._place = self._current_place()
        self._count = -round(_BEGINNING / self._timestep)

    def restart(self) -> None:
        """Counts from here on."""
        self._place = self._current_place()
        self._count = 0

    def lasts(self) -> bool:
        """Counts a control step; returns whether nothing has moved for a while."""
        self._count += 1
        if np.abs(self._current_place() - self._place).max() > _STILL:
            self.restart()
        return self._count * self._timestep >= _PATIENCE

    def _current_place(self) -> NDArray[np.float64]:
        position, orientation = self._arm.hand
        # Of the two quaternions of an orientation the one that is positive where it is greatest.
        sign = np.sign(orientation[np.abs(orientation).argmax()])
        return np.concatenate([position, sign * orientation, self._arm.fingers])


class TeleoperatedEpisode(LiveEpisode):
    """An episode that a person plays, alone or in turns with a policy, who can go back.

    It can be played again to the bit, whatever has been tried on the way.
    """

    _rollout: RewindableRollout
    _stillness: Stillness

    def __init__(self, spec: EpisodeSpec, policy: PolicyRef | None = None, *, render_quality: str = "fast") -> None:
        """Builds the environment of a specification, and the policy that acts until the person takes over, if any."""
        installation.installed(EXTRA_PACKAGES["experts"], "moving the hand", "experts")
        if policy and policy.takes != policies.TIMESTEP:
            raise ValueError("a person can take over from a policy of time steps alone, not from one of observations")
        build_other = policy.sequential_builder(spec.policy_sha256) if policy else None

        def build_policy(environment: Environment, generator: np.random.Generator) -> "TeleoperatedPolicy":
            from kitchen_suite.policies.experts.teleoperation import TeleoperatedPolicy

            return TeleoperatedPolicy(environment.task, build_other(environment, generator) if build_other else None)

        super().__init__(spec, build_policy, render_quality=render_quality)

    def _make_rollout(self, build_policy: PolicyBuilder, render_quality: str) -> RewindableRollout:
        return RewindableRollout(self.spec, build_policy, visuals=True, render_quality=render_quality)

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

    def start(self, seed: int, options: Mapping[str, Any] | None = None) -> None:
        super().start(seed, options)
        self._observe()
        self._stillness = Stillness(self.arm, self.timestep)

    def start_from(self, episode: Episode, steps: int | None = None) -> None:
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
        self.start(episode.seed)
        actions = episode.arrays["action"]
        for step in range(count):
            labels = {"is_intervention": False, "teleop_action": actions[step]}
            for name in labels:
                if (rows := episode.labels.get(f"label/{name}")) is not None:
                    labels[name] = rows[step]
            self._rollout.repeat(actions[step], labels)
        if differing := self._rollout.buffer.differing(episode.arrays):
            raise ValueError(f"the recorded episode does not play again here: its {differing} differs")
        if count:
            self._go_on()

    def step(self) -> None:
        super().step()
        # Where the person acts, and nothing has moved for a while, time stands still.
        if not self.policy.is_persons:
            self._stillness.restart()
        elif self._stillness.lasts():
            self.arm.rest()
            self._stillness.wait_for_motion()

    @property
    def can_hand_back(self) -> bool:
        """Whether there is a policy that could act in place of the person, who acts."""
        return self.policy.can_hand_back

    def hand_back(self) -> None:
        """Lets the policy act again from which the person took over, if there is one."""
        self.policy.hand_back()

    def rewind(self, steps: int) -> None:
        """Goes back by control steps, as far as states are kept."""
        self._rollout.rewind(steps)
        self._has_failed = False
        self._go_on()
        self._stillness.wait_for_motion()

    def discard(self) -> None:
        """Starts the episode anew."""
        self.start(self.seed, self._rollout.options)

    def result(self) -> Episode:
        """Returns the episode up to now; raises a ValueError where there is nothing to be kept."""
        if not self.steps:
            raise ValueError("there is nothing to save: make a control step first")
        if self._has_failed:
            raise ValueError("the last control step was not completed: go back, and then save")
        seconds = self.steps * self.timestep
        return self._rollout.buffer.episode(self._rollout.environment, self.seed, self.seed, seconds)

    def _numbers(self) -> dict[str, str]:
        return {
            **super()._numbers(),
            "hand": ", ".join(f"{number:.3f}" for number in self.arm.hand[0]) + " m",
            "fingers": "closed" if self.arm.is_closed else "open",
        }

    def _state(self) -> list[str]:
        return [*super()._state(), "you act" if self.policy.is_persons else "the policy acts"]

    def _go_on(self) -> None:
        """Lets the person go on from the current state, after steps that were not commanded."""
        self._observe()
        self.policy.take_over()
        self.arm.resume()

    def _observe(self) -> None:
        """Shows the person's policy where the hand is."""
        environment = suite_env(self._rollout.environment)
        self.policy.observe(self._rollout.buffer.timestep(environment))


class SeedTakenError(ValueError):
    """An episode of the same seed has been saved already; the message names the file of this one."""


class Collection:
    """The folder of the episodes that a person has saved, by their seeds.

    Attributes:
      saved: number of episodes that have been saved in this session.
      last: seed of the one that was saved last, and whether its task was done, in words; empty without one.
    """

    def __init__(self, folder: Path, spec: EpisodeSpec) -> None:
        """Begins or continues a recording in a folder; raises as `Recording.claim`."""
        self._path = folder
        self._folder = Recording.claim(folder, spec)
        self.saved = 0
        self.last = ""

    def check(self, spec: EpisodeSpec) -> None:
        """Raises a ValueError unless episodes of a specification belong in the folder."""
        Recording.claim(self._path, spec)

    def next_seed(self, seed: int) -> int:
        """Returns the first seed from a given one on of which no episode has been saved."""
        return next(each for each in itertools.count(seed) if each not in self._folder.indices)

    def save(self, live: TeleoperatedEpisode) -> bool:
        """Saves an episode up to now, and returns whether its task was done.

        Raises a ValueError where there is nothing to save, and a SeedTakenError where an episode of its seed has been
        saved: this one is then kept aside, in a file that no command reads.
        """
        episode = live.result()
        try:
            self._folder.append(episode)
        except FileExistsError:
            aside = self._folder.keep_aside(episode)
            taken = f"an episode of seed {live.seed} has been saved already"
            raise SeedTakenError(f"{taken}: this one is kept as {aside.name}") from None
        self.saved += 1
        is_done = bool(episode.metrics["success"])
        self.last = f"seed {live.seed}: the task was {'done' if is_done else 'not done'}"
        return is_done

    def numbers(self) -> dict[str, str]:
        """Returns rows of the report: what has been saved."""
        saved = {"episodes saved": str(self.saved)}
        return {**saved, "saved last": self.last} if self.last else saved


def persons_episode(choice: Choice, recorded: EpisodeSpec | None = None, *, render_quality: str) -> TeleoperatedEpisode:
    """Returns an episode of a person, who may take over from the chosen policy, to be started.

    With the specification of a recording, its environment is that of the recorded episodes.
    """
    policy = PolicyRef.parse(choice.policy) if choice.policy else None
    # A policy that does nothing stands for none.
    other = policy or PolicyRef.parse("zero")
    spec = recorded or choice.spec(other)
    # Episodes have the numbers of their seeds. That recorded ones play again here is checked.
    steps = choice.max_episode_steps or _EPISODE_STEPS
    spec = dataclasses.replace(
        spec, policy=other.text, policy_sha256=None, seed=0, versions=spec.current_versions, max_episode_steps=steps
    )
    name = TELEOP
    if policy:
        spec = spec.prepared(policy)
        name = f"{TELEOP}(policy={choice.policy!r})"
    return TeleoperatedEpisode(dataclasses.replace(spec, policy=name), policy, render_quality=render_quality)
