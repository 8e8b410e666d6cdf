"""Replays recorded actions, and compares the episodes: the work of `kitchen-replay`."""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import contextlib
import dataclasses
import itertools
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import gymnasium
import mujoco
import numpy as np
from dm_control.rl.control import PhysicsError
from numpy.typing import NDArray
from tqdm import tqdm

from kitchen_suite import checks
from kitchen_suite.datasets.formats import find_source
from kitchen_suite.episodes.episode import EpisodeArrays, EpisodeBuffer, Watch, unflatten
from kitchen_suite.episodes.play import episode_name
from kitchen_suite.episodes.report import print_line
from kitchen_suite.episodes.spec import reset_to_seed
from kitchen_suite.episodes.views import Views
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.settings import FAILURE, ReplaySettings
from kitchen_suite.tasks.requests import VARIATION_VALUES
from kitchen_suite.tasks.task import SuiteTask
from kitchen_suite.versions import installed_versions

# Widths of the table's columns; `difference` is the maximum over all numbers of the observations.
_COLUMNS = {
    "episode": 7,
    "seed": 6,
    "steps": 5,
    "return": 8,
    "replayed": 8,
    "difference": 10,
    "rewards": 13,
    "end": 13,
    "completions": 0,
}


def replay(
    environment: gymnasium.Env, recorded: EpisodeArrays, seeding: str, watch: Watch = lambda buffer: None
) -> EpisodeArrays:
    """Plays the actions of a recorded episode again, from its seed.

    Without a seed, noise cannot be drawn again: each of a kitchen's actions is then added to the recorded positions, as
    when it was recorded. An episode of a kitchen that began in another state than a reset begins in that state.

    `environment` has the arguments of the recording, `seeding` is one of `episodes.spec.SEEDINGS`, and `watch` is
    called after the reset and after every step. Raises a ValueError if the arrays do not fit the environment, or the
    episode has no seed, and its task's episodes start from a seed only.
    """
    _check_shape(recorded, "action", recorded.arrays["action"], environment.action_space.shape)
    states = _states(environment, recorded)
    start = _start(environment, recorded, seeding, states)
    buffer = EpisodeBuffer(*start, name=episode_name(recorded.index, recorded.seed))
    watch(buffer)
    for step, action in enumerate(recorded.arrays["action"]):
        if recorded.seed is None and states is not None:
            suite_env(environment).composer_task.records.set_observed_positions(states[step])
        buffer.step(environment, action)
        watch(buffer)
    episode = buffer.episode(environment, recorded.index, recorded.seed)
    own = {"action": recorded.arrays["action"], **recorded.labels}
    return dataclasses.replace(episode, arrays={**episode.arrays, **own})


def _states(environment: gymnasium.Env, recorded: EpisodeArrays) -> NDArray | None:
    """Returns the flat observations `(T + 1, ...)` of a recording, if it has them, without extra observables."""
    inner = suite_env(environment)
    try:
        states = inner.observations.recover_flat(unflatten(recorded.arrays, "observation"))
        is_missing = isinstance(states, Mapping) or (states is None and recorded.seed is None)
    except (IndexError, KeyError, TypeError):
        is_missing = True
    if is_missing:
        raise ValueError(f"episode {recorded.index} has no observations of the state")
    if states is None:
        return None
    _check_shape(recorded, "observation", states, inner.observations.flat_space.shape)
    if np.abs(states[0]).max() > mujoco.mjMAXVAL:
        limit = f"{mujoco.mjMAXVAL:g}, the greatest that MuJoCo simulates"
        raise ValueError(f"episode {recorded.index} begins with positions beyond {limit}")
    # The extra observables come last.
    return states[:, : states.shape[1] - inner.composer_task.extra_size]


def _check_shape(recorded: EpisodeArrays, name: str, array: NDArray, expected: tuple[int, ...] | None) -> None:
    if array.shape[1:] != expected:
        raise ValueError(f"episode {recorded.index} has {name}s of shape {array.shape[1:]}, the environment {expected}")


def _start(
    environment: gymnasium.Env, recorded: EpisodeArrays, seeding: str, states: NDArray | None
) -> tuple[Any, dict[str, Any]]:
    """Resets to where the recorded episode began; returns the observation and the info there."""
    inner = suite_env(environment)
    task = inner.composer_task
    observation, info = reset_to_seed(environment, recorded.seed or 0, seeding, _options(task, recorded))
    if states is None:
        return observation, info
    if recorded.seed is None:
        task.records.set_observed_positions(states[0])
    physics = inner.environment.physics
    if np.isfinite(states[0]).all() and not task.records.is_initial(physics, states[0]):
        task.records.restore(physics, states[0])
        observation = inner.set_state(inner.get_state())
    return observation, info


def _options(task: SuiteTask, recorded: EpisodeArrays) -> dict[str, Any] | None:
    """Returns the options of a reset that repeat what was drawn in a recorded episode; None if there are none."""
    prefix = f"info/{VARIATION_VALUES}/"
    values = {name.removeprefix(prefix): rows[0] for name, rows in recorded.arrays.items() if name.startswith(prefix)}
    return {**({VARIATION_VALUES: values} if values else {}), **task.requests.recorded(recorded.arrays)} or None


@dataclasses.dataclass(frozen=True, kw_only=True)
class Comparison:
    """The differences between a recorded episode and its replay; steps count from 1, None without a difference.

    Attributes:
      steps: number of control steps.
      rewards: first step with another reward.
      completions: first step after which other tasks are within their threshold (open_cabinet: with another success).
      tasks: those that differ there.
      ends: first step that ends only one of the two episodes.
      observation_difference: maximum over all numbers of the observations, goals included; NaN where one is NaN, inf
        where an array is missing or has another shape.
      arrays: names of all arrays that are missing in one episode, or differ in shape or in a number; NaN differs.
    """

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

    def is_equal(self, *, exactly: bool) -> bool:
        """Whether rewards, completions and ends are equal; `exactly`: all arrays as well."""
        steps = (self.rewards, self.completions, self.ends)
        return steps == (None, None, None) and not (exactly and self.arrays)


def compare(task: SuiteTask, recorded: EpisodeArrays, replayed: EpisodeArrays, *, truncations: bool) -> Comparison:
    """Compares an episode with its replay; truncations only if told to: other recorders truncate where they stop."""
    one, other = recorded.arrays, replayed.arrays
    ends = one["termination"] != other["termination"]
    if truncations:
        ends = ends | (one["truncation"] != other["truncation"])
    completions, tasks = _compare_completions(task, recorded, replayed)
    names = list({**one, **other})
    return Comparison(
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
    )


def _difference(one: Mapping[str, NDArray], other: Mapping[str, NDArray], name: str) -> float:
    """Returns the greatest difference of an observation's numbers, 0 for other arrays."""
    if name.partition("/")[0] != "observation":
        return 0.0
    if name not in one or name not in other or one[name].shape != other[name].shape:
        return math.inf
    # Pictures are unsigned.
    return float(np.abs(np.subtract(one[name], other[name], dtype=np.float64)).max())


def _compare_completions(
    task: SuiteTask, recorded: EpisodeArrays, replayed: EpisodeArrays
) -> tuple[int | None, tuple[str, ...]]:
    """Returns the first step after which completions differ, and the tasks that do."""
    if not _have_same_layout(recorded.arrays, replayed.arrays):
        return None, ()
    one, other = task.records.goals_reached(recorded.arrays), task.records.goals_reached(replayed.arrays)
    if one is None or other is None:  # Recorded without infos.
        return None, ()
    names = np.array(one[0])
    # Before the first step no task can be completed.
    differing = (one[1] != other[1])[1:]
    step = _first(differing.any(axis=1))
    return step, () if step is None else tuple(names[differing[step - 1]])


def _have_same_layout(recorded: Mapping[str, NDArray], replayed: Mapping[str, NDArray]) -> bool:
    """Whether recorded observations, and infos where there are any, have the shapes of the replayed ones."""
    return all(
        recorded[name].shape == array.shape if name in recorded else name.startswith("info/")
        for name, array in replayed.items()
    )


def _first(differs: NDArray[np.bool_]) -> int | None:
    """Returns the number of the first step, from 1, that differs."""
    return int(np.argmax(differs)) + 1 if differs.any() else None


def check_pictures(environment: gymnasium.Env) -> None:
    """Resets an environment; raises an OSError if it has pictures that cannot be rendered here."""
    try:
        # The first reset compiles the model, and the size of its pictures with it.
        environment.reset()
    except RuntimeError as error:
        raise OSError(f"the recording holds pictures: {error}") from error


class ReplayJob:
    """Replays episodes of a recording, and compares them."""

    errors: ClassVar = {PhysicsError: FAILURE, OSError: FAILURE, ValueError: FAILURE}

    def __init__(self, settings: ReplaySettings) -> None:
        self._settings = settings
        self._source = find_source(settings.source, settings.data_path)
        self._indices = choose(self._source.indices, settings.episodes, settings.num_episodes)
        self._environment = self._source.make_environment(**settings.rendering)
        check_pictures(self._environment)
        self._inner = suite_env(self._environment).environment
        limit = self._environment.spec.max_episode_steps if self._environment.spec else None
        self._views = Views(settings, self._inner, num_episodes=len(self._indices), max_steps=limit)
        self._finished = 0

    def progress(self) -> str:
        return f"after {self._finished} of {len(self._indices)} episodes"

    def run(self) -> bool:
        exactly = self._source.spec is not None
        print_line(f"{self._heading()}\n")
        equal, unseen = 0, list[str]()
        with contextlib.closing(self._environment), self._views.open() as watch:
            print_line(_row({name: name for name in _COLUMNS}))
            for index in tqdm(self._indices, unit="episode", disable=None, leave=False):
                comparison = self._compare(index, watch, exactly)
                equal += comparison.is_equal(exactly=exactly)
                self._finished += 1
                print_line(_row(_cells(index, comparison)))
                if comparison.is_equal(exactly=False) and not comparison.is_equal(exactly=exactly):
                    unseen.append(f"episode {index} differs in {', '.join(comparison.arrays)}")
        print_line("\n".join(["", *unseen, f"{equal} of {len(self._indices)} episodes are equal"]))
        return equal == len(self._indices)

    def _compare(self, index: int, watch: Watch, exactly: bool) -> Comparison:
        spec = self._source.spec
        recorded = self._source.load(index)
        replayed = replay(self._environment, recorded, spec.seeding if spec else "gymnasium", watch)
        return compare(self._inner.task, recorded, self._source.projected(replayed), truncations=exactly)

    def _heading(self) -> str:
        text = f"{self._settings.source}: {len(self._indices)} of {len(self._source.indices)} episodes"
        if self._source.spec is None:
            return f"{text}; recorded by another program, so that observations and truncations are not compared"
        here, there = installed_versions(), self._source.spec.versions
        differing = [name for name in here if here[name] != there.get(name)]
        return "\n".join([text, *(f"recorded with {name} {there.get(name)}, here {here[name]}" for name in differing)])


def choose(indices: Sequence[int], wanted: str | None, count: int) -> list[int]:
    """Returns the episodes to replay, of all `indices` in order.

    `wanted` is `all`, or numbers and ranges such as `0,5,7-9`; None for `count`, spread evenly from first to last.
    """
    if not indices:
        raise ValueError("there are no episodes")
    if wanted is None:
        chosen = np.linspace(0, len(indices) - 1, min(count, len(indices))).round().astype(int)
        return [indices[i] for i in chosen]
    return list(indices) if wanted == "all" else _listed(indices, wanted)


def _listed(indices: Sequence[int], wanted: str) -> list[int]:
    present, chosen = {*indices}, list[int]()
    for part in wanted.split(","):
        if not (match := re.fullmatch(r"(\d+)(?:-(\d+))?", part)):
            raise ValueError(f"episodes must be 'all', or such as 0,5,7-9, got {checks.shown(wanted)}")
        first, last = int(match[1]), int(match[2] or match[1])
        if first > last:
            raise ValueError(f"the range {part} of episodes is empty")
        # The ends come first: a range may have any length.
        for number in itertools.chain((first, last), range(first, last + 1)):
            if number not in present:
                raise ValueError(f"there is no episode {number}: there are {len(indices)}, from {indices[0]}")
        chosen += range(first, last + 1)
    return chosen


def _cells(index: int, comparison: Comparison) -> dict[str, str]:
    def verdict(step: int | None) -> str:
        return "equal" if step is None else f"differ at {step}"

    completions = verdict(comparison.completions)
    return {
        "episode": str(index),
        "seed": "none" if comparison.seed is None else str(comparison.seed),
        "steps": str(comparison.steps),
        "return": f"{comparison.recorded_return:.5g}",
        "replayed": f"{comparison.replayed_return:.5g}",
        "difference": f"{comparison.observation_difference:.3g}",
        "rewards": verdict(comparison.rewards),
        "end": verdict(comparison.ends),
        "completions": ": ".join(filter(None, [completions, ", ".join(comparison.tasks)])),
    }


def _row(cells: dict[str, str]) -> str:
    return "  ".join(f"{cells[name]:>{width}}" for name, width in _COLUMNS.items())
