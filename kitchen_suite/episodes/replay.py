"""Plays the actions of recorded episodes again, and compares the episodes."""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import dataclasses
import itertools
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Literal

import gymnasium
import numpy as np
from numpy.typing import NDArray

from kitchen_suite import checks
from kitchen_suite.closing import closed_on_error
from kitchen_suite.environment import Environment
from kitchen_suite.episodes.episode import PHYSICS_STATE, Episode, EpisodeBuffer, Watch, ignore
from kitchen_suite.episodes.play import episode_name
from kitchen_suite.episodes.recording import Recording
from kitchen_suite.episodes.spec import reset_to_seed
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.tasks.requests import VARIATION_VALUES
from kitchen_suite.tasks.task import SuiteTask

Verdict = Literal["equal", "other digits", "altered"]
"""The result of playing an episode again.

- `equal`: all numbers are equal to the bit
- `other digits`: all scores are equal, but not all numbers
- `altered`: scores differ: the recording or receipt was altered, or this is another machine
"""

# From worst to best.
_VERDICTS: tuple[Verdict, ...] = ("altered", "other digits", "equal")


def replay_episode(environment: gymnasium.Env, recorded: Episode, seeding: str, watch: Watch = ignore) -> Episode:
    """Plays the actions of a recorded episode again, from its seed.

    Args:
      environment: of the recording's specification.
      recorded: the episode, which has a seed.
      seeding: one of `episodes.spec.SEEDINGS`.
      watch: is called after the reset and after every step.

    Raises a ValueError if the arrays do not fit the environment.
    """
    assert recorded.seed is not None
    shape, expected = recorded.arrays["action"].shape[1:], environment.action_space.shape
    if shape != expected:
        raise ValueError(f"episode {recorded.index} has actions of shape {shape}, the environment {expected}")
    options = reset_options(suite_env(environment).composer_task, recorded)
    name = episode_name(recorded.index, recorded.seed)
    for step in replayed_steps(environment, recorded.seed, seeding, options, recorded.arrays["action"], name):
        watch(*step)
    buffer, _ = step
    episode = buffer.episode(environment, recorded.index, recorded.seed)
    own = {"action": recorded.arrays["action"], **recorded.labels}
    return dataclasses.replace(episode, arrays={**episode.arrays, **own})


def replayed_steps(
    environment: gymnasium.Env,
    seed: int,
    seeding: str,
    options: Mapping[str, Any] | None,
    actions: NDArray,
    name: str,
) -> Iterator[tuple[EpisodeBuffer, Environment]]:
    """Plays an episode from its actions; yields it in progress, after its reset and after every step.

    Args:
      environment: of the episode's specification.
      seed: of the episode.
      seeding: one of `episodes.spec.SEEDINGS`.
      options: of the reset.
      actions: `(T, k)`.
      name: of the episode, for those who watch it.

    Raises a PhysicsError where the physics diverges.
    """
    inner = suite_env(environment)
    observation, info = reset_to_seed(environment, seed, seeding, options)
    buffer = EpisodeBuffer(observation, info, inner.physics_state, name)
    yield buffer, inner.environment
    for action in actions:
        buffer.step(environment, action)
        yield buffer, inner.environment


def reset_options(task: SuiteTask, recorded: Episode) -> dict[str, Any] | None:
    """Returns the options of a reset that repeat what was drawn in a recorded episode; None if there are none."""
    prefix = f"info/{VARIATION_VALUES}/"
    values = {name.removeprefix(prefix): rows[0] for name, rows in recorded.arrays.items() if name.startswith(prefix)}
    return {**({VARIATION_VALUES: values} if values else {}), **task.requests.recorded(recorded.arrays)} or None


@dataclasses.dataclass(frozen=True, kw_only=True)
class ReplayedEpisode:
    """The differences between a recorded episode and its replay; steps count from 1, None without a difference.

    Attributes:
      condition: name of the episode's task.
      episode: number of the episode.
      seed: of the episode.
      steps: number of control steps.
      recorded_return: sum of the recorded rewards.
      replayed_return: sum of the rewards of the replay.
      rewards: first step with another reward.
      completions: first step after which other tasks are within their threshold (open_cabinet: with another success).
      tasks: those that differ there.
      ends: first step that ends only one of the two episodes.
      observation_difference: maximum over all numbers of the observations, goals included; NaN where one is NaN, inf
        where an array is missing or has another shape.
      arrays: names of all arrays that are missing in one episode, or differ in shape or in a number; NaN differs.
      last_info: infos of the replay after its last control step.
    """

    condition: str
    episode: int
    seed: int | None
    steps: int
    recorded_return: float
    replayed_return: float
    rewards: int | None
    completions: int | None
    tasks: tuple[str, ...]
    ends: int | None
    observation_difference: float
    arrays: tuple[str, ...]
    last_info: Mapping[str, Any]

    @property
    def verdict(self) -> Verdict:
        """`equal`, `other digits` or `altered`."""
        if (self.rewards, self.completions, self.ends) != (None, None, None):
            return "altered"
        return "other digits" if self.arrays else "equal"

    @property
    def differences(self) -> tuple[str, ...]:
        """Descriptions of the differences; empty if there are none."""
        steps = {"rewards": self.rewards, "completions": self.completions, "ends": self.ends}
        found = [f"{name} differ at control step {step}" for name, step in steps.items() if step is not None]
        return (*found, *(f"{name} differs" for name in self.arrays))


def compare(task: SuiteTask, recorded: Episode, replayed: Episode, condition: str) -> ReplayedEpisode:
    """Compares an episode with its replay; `condition` is the name of the task."""
    one, other = recorded.arrays, replayed.arrays
    ends = (one["termination"] != other["termination"]) | (one["truncation"] != other["truncation"])
    completions, tasks = _compare_completions(task, recorded, replayed)
    # Older recordings lack the physics state.
    names = [name for name in {**one, **other} if name != PHYSICS_STATE or name in one]
    return ReplayedEpisode(
        condition=condition,
        episode=recorded.index,
        seed=recorded.seed,
        steps=recorded.steps,
        recorded_return=float(one["reward"].sum()),
        replayed_return=float(other["reward"].sum()),
        rewards=_first(one["reward"] != other["reward"]),
        completions=completions,
        tasks=tasks,
        ends=_first(ends),
        observation_difference=float(np.max([_difference(one, other, name) for name in names])),
        arrays=tuple(
            name for name in names if name not in one or name not in other or not np.array_equal(one[name], other[name])
        ),
        last_info=replayed.last_info,
    )


def _difference(one: Mapping[str, NDArray], other: Mapping[str, NDArray], name: str) -> float:
    """Returns the greatest difference of an observation's numbers, 0 for other arrays."""
    if name.partition("/")[0] != "observation":
        return 0.0
    if name not in one or name not in other or one[name].shape != other[name].shape:
        return math.inf
    # Pictures are unsigned.
    return float(np.abs(np.subtract(one[name], other[name], dtype=np.float64)).max())


def _compare_completions(task: SuiteTask, recorded: Episode, replayed: Episode) -> tuple[int | None, tuple[str, ...]]:
    """Returns the first step after which completions differ, and the tasks that do."""
    if not _have_same_layout(recorded.arrays, replayed.arrays):
        return None, ()
    one, other = task.records.goals_reached(recorded.arrays), task.records.goals_reached(replayed.arrays)
    if one is None or other is None:
        return None, ()
    names = np.array(one[0])
    # Before the first step no task can be completed.
    differing = (one[1] != other[1])[1:]
    step = _first(differing.any(axis=1))
    return step, () if step is None else tuple(names[differing[step - 1]])


def _have_same_layout(recorded: Mapping[str, NDArray], replayed: Mapping[str, NDArray]) -> bool:
    """Whether recorded observations, and infos where there are any, have the shapes of the replayed ones."""
    return all(
        recorded[name].shape == array.shape if name in recorded else name.startswith(("info/", PHYSICS_STATE))
        for name, array in replayed.items()
    )


def _first(differs: NDArray[np.bool_]) -> int | None:
    """Returns the number of the first step, from 1, that differs."""
    return int(np.argmax(differs)) + 1 if differs.any() else None


class Replay:
    """Plays episodes of a recording again, and compares them; see `run`.

    Attributes:
      recording: the recording.
      environment: the Gymnasium environment in which they are played.
      indices: numbers of the episodes.
    """

    def __init__(
        self, recording: Recording, episodes: str | Sequence[int] | None, count: int, **rendering: Any
    ) -> None:
        """Chooses the episodes as `choose` does; `rendering` are arguments of the environment."""
        if recording.spec.origin is not None:
            raise ValueError(f"{recording.folder} holds episodes of another program, without seeds to replay from")
        self.recording = recording
        self.indices = choose(recording.indices, episodes, count)
        self.environment = recording.spec.make_environment(**rendering)
        with closed_on_error([self.environment]):
            try:
                # The first reset compiles the model, and the size of its images with it.
                self.environment.reset()
            except RuntimeError as error:
                raise OSError(f"the recording holds images: {error}") from error

    def run(self, watch: Watch = ignore) -> Iterator[ReplayedEpisode]:
        """Yields the comparison of each episode; `watch` is called after every reset and every step.

        Raises an OSError if an episode cannot be read, or its arrays do not fit the environment.
        """
        task = suite_env(self.environment).composer_task
        for index in self.indices:
            recorded = self.recording.load(index)
            try:
                replayed = replay_episode(self.environment, recorded, self.recording.spec.seeding, watch)
            except ValueError as error:
                raise OSError(f"{self.recording.folder} cannot be replayed: {error}") from error
            yield compare(task, recorded, replayed, self.recording.spec.task_name)


def worst(verdicts: Iterable[Verdict]) -> Verdict:
    """Returns the verdict on all of several episodes."""
    found = {*verdicts}
    return next((verdict for verdict in _VERDICTS if verdict in found), "equal")


def choose(indices: Sequence[int], wanted: str | Sequence[int] | None, count: int) -> list[int]:
    """Returns the episodes to replay, of all `indices` in order.

    `wanted` is `all`, numbers and ranges such as `0,5,7-9`, or a sequence of numbers; None for `count`, spread evenly
    from first to last.
    """
    if not indices:
        raise ValueError("there are no episodes")
    if wanted is None:
        places = np.linspace(0, len(indices) - 1, min(count, len(indices))).round().astype(int)
        return [indices[i] for i in places]
    if isinstance(wanted, str):
        return list(indices) if wanted == "all" else _listed(indices, wanted)
    if not isinstance(wanted, Iterable) or isinstance(wanted, bytes):
        raise TypeError(f"episodes must be 'all', text such as '0,5,7-9', or numbers, got {checks.shown(wanted)}")
    chosen = [checks.integer(number, "a number of episodes", minimum=0) for number in wanted]
    if not chosen:
        raise ValueError("episodes must name at least one")
    for number in chosen:
        _check_present(indices, number)
    return chosen


def _check_present(indices: Sequence[int], number: int) -> None:
    if number not in indices:
        raise ValueError(f"there is no episode {number}: there are {len(indices)}, from {indices[0]}")


def _listed(indices: Sequence[int], wanted: str) -> list[int]:
    chosen: list[int] = []
    for part in wanted.split(","):
        if not (match := re.fullmatch(r"(\d+)(?:-(\d+))?", part)):
            raise ValueError(f"episodes must be 'all', or such as 0,5,7-9, got {checks.shown(wanted)}")
        first, last = int(match[1]), int(match[2] or match[1])
        if first > last:
            raise ValueError(f"the range {part} of episodes is empty")
        # The ends come first: a range may have any length.
        for number in itertools.chain((first, last), range(first, last + 1)):
            _check_present(indices, number)
        chosen += range(first, last + 1)
    return chosen
