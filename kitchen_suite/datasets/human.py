"""Demonstrations of the kitchen that other programs recorded: files of D4RL, and Minari datasets of FrankaKitchen-v1.

There are such data of the kitchen alone, so that this module reads its goals and its MDP itself. The actions of both
formats are nine joint velocities in units of 2 rad/s and 2 m/s, which are added to the positions last observed, with
their noise: the control mode `joint_velocity`.
"""

import collections
import contextlib
import dataclasses
import itertools
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from kitchen_suite import files
from kitchen_suite.datasets import hdf5, minari
from kitchen_suite.datasets.d4rl import POSITIONS
from kitchen_suite.entities import Scene
from kitchen_suite.episodes.episode import MAX_VALUE, Episode, EpisodeBuffer, Step, flatten
from kitchen_suite.episodes.recording import SPEC_FILE, Recording
from kitchen_suite.episodes.spec import EnvironmentSpec, EpisodeSpec
from kitchen_suite.gymnasium_env.base import SuiteEnv, suite_env
from kitchen_suite.gymnasium_env.observations import Present
from kitchen_suite.tasks import DEFAULT_TASKS, GOALS, KitchenTask
from kitchen_suite.tasks.kitchen.mdp import KitchenState
from kitchen_suite.tasks.kitchen.observation import FRANKA_SLICES, ROUNDING, SIZE, KitchenReading
from kitchen_suite.tasks.metrics import Metrics
from kitchen_suite.tasks.orders import order_of, sequence_of
from kitchen_suite.versions import installed_versions

ACTION_SIZE = 9  # Numbers of an action of the kitchen.

_D4RL_ARRAYS = ("observations", "actions", "terminals", "timeouts")  # Those that are read of a file of D4RL.

_ORIGINAL_ID = "FrankaKitchen-v1"  # Of Gymnasium-Robotics; the datasets D4RL/kitchen/*-v2 are recordings of it.

# An episode may ask for any number of the seven tasks; episodes go on after their last completion.
_TASK_KWARGS: dict[str, Any] = {"tasks_per_episode": [1, 7], "terminate_on_tasks_completed": False}


class Demonstration(NamedTuple):
    """A recorded episode.

    Attributes:
      observations: `(T + 1, 59)`, as the kitchen observes; NaN for elements that were not recorded.
      actions: `(T, 9)`, joint velocities in units of 2 rad/s and 2 m/s.
      achieved: `(T + 1, m)` by task, achieved goals without noise, where they were recorded.
      goals: tasks whose goals were recorded.
    """

    observations: NDArray[np.float64]
    actions: NDArray[np.floating]
    achieved: Mapping[str, NDArray[np.float64]]
    goals: Sequence[str]


class D4RLData:
    """A file of D4RL, such as kitchen-complete-v0, with flat arrays of all control steps.

    Its observations are the positions, then goals in the same layout, 0 where there is none.
    """

    format = "D4RL"
    has_velocities = False

    def __init__(self, path: Path, scene: Scene) -> None:
        self._scene = scene
        arrays = hdf5.read_arrays(path, _D4RL_ARRAYS)
        self.contents = {"sha256": files.file_digest(path)}
        for name in ("observations", "actions", "terminals"):
            if name not in arrays:
                raise ValueError(f"{path} has no array {name!r}: D4RL's files have observations, actions and terminals")
        count = np.atleast_1d(arrays["observations"]).shape[0]
        shape = (count, 2 * POSITIONS.size)
        _check_shape(arrays["observations"], shape, f"observations of {path}", "30 positions and 30 goals")
        _check_actions(arrays["actions"], count, f"actions of {path}")
        ends = np.zeros(count, bool)
        for name in ("terminals", "timeouts"):
            if name in arrays:
                _check_shape(arrays[name], (count,), f"{name} of {path}", "a flag for each control step")
                ends |= arrays[name].astype(bool)
        bounds = np.unique([0, *(np.flatnonzero(ends) + 1), count]).tolist()
        # The outcome of an episode's last action is not in the file.
        self._rows = [(start, stop) for start, stop in itertools.pairwise(bounds) if stop - start > 1]
        self._observations = arrays["observations"].astype(np.float64)
        self._actions = arrays["actions"]

    def __len__(self) -> int:
        return len(self._rows)

    def read(self) -> Iterator[Demonstration]:
        for start, stop in self._rows:
            recorded = self._observations[start:stop]
            observations = np.full((stop - start, SIZE), np.nan)
            observations[:, POSITIONS] = recorded[:, : POSITIONS.size]
            objects, tasks = recorded[0, POSITIONS.size + ACTION_SIZE :], []
            for task in DEFAULT_TASKS:
                goal = objects[self._scene.elements(GOALS[task].prop, GOALS[task].joints)]
                if np.allclose(goal, GOALS[task].value, atol=ROUNDING):
                    tasks.append(task)
            yield Demonstration(observations, self._actions[start : stop - 1], {}, tasks)


class MinariData:
    """A Minari dataset of FrankaKitchen-v1, such as D4RL/kitchen/complete-v2."""

    format = "Minari"
    has_velocities = True

    def __init__(self, dataset: Any, name: str) -> None:
        """Takes a dataset that Minari has loaded; raises a ValueError if it is of another environment."""
        self._dataset, self._name = dataset, name
        with files.reading(dataset.storage.data_path, "the metadata of a dataset"):
            environment = dataset.env_spec and dataset.env_spec.id
            self.contents = {
                "episodes": dataset.total_episodes,
                "steps": dataset.total_steps,
                "sha256": minari.data_digest(dataset),
            }
        if environment != _ORIGINAL_ID:
            raise ValueError(f"{name} is a dataset of {environment}, not of {_ORIGINAL_ID}: no recording is made of it")

    def __len__(self) -> int:
        return self.contents["episodes"]

    def read(self) -> Iterator[Demonstration]:
        """Yields the episodes in order; a ValueError where one has another layout."""
        for index in range(len(self)):
            episode, what = minari.load_episode(self._dataset, index), f"of episode {index} of {self._name}"
            parts, steps = flatten(episode.observations, "observation"), len(episode.rewards)
            if "observation/observation" not in parts:
                raise ValueError(f"the observations {what} have no part 'observation'")
            observations, actions = parts["observation/observation"], np.asarray(episode.actions)
            _check_shape(observations, (steps + 1, SIZE), f"observations {what}", "positions and velocities")
            _check_actions(actions, steps, f"actions {what}")
            prefix = "observation/achieved_goal/"
            achieved = {task: parts[prefix + task] for task in DEFAULT_TASKS if prefix + task in parts}
            for task, goal in achieved.items():
                _check_shape(goal, (steps + 1, len(GOALS[task].value)), f"goals of {task!r} {what}", "its joints")
            yield Demonstration(observations.astype(np.float64), actions, achieved, [*achieved])


def open_data(name: str, data_path: Path | None, scene: Scene) -> D4RLData | MinariData:
    """Opens a file of D4RL by its path, or a Minari dataset by its name below `data_path`, or by its own folder."""
    path = Path(name)
    if path.suffix in (".hdf5", ".h5") or path.is_file():
        return D4RLData(path, scene)
    if (path / SPEC_FILE).is_file():
        raise ValueError(f"{name} is a recording of this suite already")
    with minari.folder(data_path):
        dataset = minari.load(name)
    if dataset is not None:
        return MinariData(dataset, name)
    if path.exists():
        raise ValueError(f"{name} holds no Minari dataset")
    problem = f"there is no folder {name}, and no Minari dataset of that name on this machine"
    raise FileNotFoundError(f"{problem}; `minari download` gets datasets of Minari, whose names end in -v0")


def _check_shape(array: NDArray, shape: tuple[int, ...], what: str, meaning: str) -> None:
    if array.shape != shape:
        raise ValueError(f"{what} have shape {array.shape}, not {shape}: {meaning}")
    if array.dtype.kind not in "biuf" or not np.isfinite(array).all():
        raise ValueError(f"{what} are not all finite numbers")
    if (greatest := np.abs(array, dtype=np.float64).max(initial=0.0)) > MAX_VALUE:
        raise ValueError(f"{what} reach {greatest:.3g}, more than {MAX_VALUE:g}, MuJoCo's limit for divergence")


def _check_actions(actions: NDArray, steps: int, what: str) -> None:
    _check_shape(actions, (steps, ACTION_SIZE), what, "nine joint velocities")
    if (greatest := np.abs(actions).max(initial=0.0)) > 1.0 + ROUNDING:
        problem = f"{what} reach {greatest:.3g}: they are no joint velocities in [-1, 1], in units of 2 rad/s"
        raise ValueError(f"{problem}; absolute positions, as Diffusion Policy has them, are not converted")


def as_episode(environment: SuiteEnv, index: int, demonstration: Demonstration) -> tuple[Episode, Metrics, list[str]]:
    """Converts a demonstration to an episode that asks for the tasks that it completes, in the order of completion.

    Rewards, completions and infos are those that the task's MDP computes from the recorded positions. Of `environment`,
    the kitchen with `tasks_per_episode`, no step is made.

    Returns:
      The episode; its metrics, without success where it completes nothing; and the tasks that it completes, in order.
    """
    task: KitchenTask = environment.composer_task
    mdp = task.mdp

    def observe(number: int, state: KitchenState) -> Any:
        flat = demonstration.observations[number]
        return environment.observations(Present(flat, task.simulation, state, pictures={}))

    robot = demonstration.observations[:, FRANKA_SLICES.robot_positions]
    objects = demonstration.observations[:, FRANKA_SLICES.object_positions]
    # The achieved goals `(T + 1, k)`: those recorded, or else the positions observed.
    goals = {name: GOALS[name] for name in task.policy_inputs.tasks}
    observed = {name: objects[:, task.scene.elements(goal.prop, goal.joints)] for name, goal in goals.items()}
    parts = [demonstration.achieved.get(name, rows) for name, rows in observed.items()]
    achieved = np.concatenate(parts, axis=1)
    within = mdp.success.within(achieved)[1:]
    first = np.where(within.any(axis=0), within.argmax(axis=0), -1)
    order, noise = order_of(sequence_of(first), first.size), np.zeros(mdp.noise_draws)
    readings = [KitchenReading(*rows) for rows in zip(robot, achieved, strict=True)]
    state = mdp.with_request(mdp.initial_state(readings[0], noise), order)
    buffer = EpisodeBuffer(observe(0, state), _info(task, state, 0))
    for step, action in enumerate(demonstration.actions, start=1):
        reading = readings[step]
        state = mdp.step(state, action=action, target=reading.positions, reading=reading, draws=noise)
        is_last = step == len(demonstration.actions)
        outcome = Step(np.asarray(action, np.float32), float(mdp.reward(state)), termination=False, truncation=is_last)
        buffer.add(outcome, observe(step, state), _info(task, state, step))
    completed = task.requests.tasks_in(order)
    instruction = task.requests.instructions_in(order)[0] if completed else ""
    episode = Episode(index=index, seed=None, arrays=buffer.arrays(), instruction=instruction)
    return episode, {**task.records.metrics(episode.last_info), "success": bool(completed)}, completed


def _info(task: KitchenTask, state: KitchenState, step: int) -> dict[str, Any]:
    info = task.mdp.info(state)
    return {**info, "is_success": np.array(info["is_success"]), "episode_step": np.array(step)}


@dataclasses.dataclass(frozen=True, kw_only=True)
class ImportedData:
    """Contents of demonstrations of which a recording was made.

    Attributes:
      format: `D4RL` or `Minari`.
      episodes: number of episodes.
      steps: number of control steps.
      goals: tasks whose goals were recorded.
      completions: number of episodes that complete each task.
      counts: number of episodes by the number of tasks that they complete.
      has_velocities: whether velocities were recorded; policies learn from positions alone without them.
    """

    format: str
    episodes: int
    steps: int
    goals: frozenset[str]
    completions: Mapping[str, int]
    counts: Mapping[int, int]
    has_velocities: bool


def import_human(source: str, output: Path, data_path: Path | None = None) -> ImportedData:
    """Makes a recording of demonstrations, or completes it.

    Args:
      source: file of D4RL, or name or folder of a Minari dataset.
      output: folder of the recording.
      data_path: folder of all Minari datasets; Minari's own when omitted.

    Raises:
      ImportError: a package is missing that reads the data.
      OSError: the data cannot be read, or the recording not be written.
      ValueError: the data are of another layout, or the folder has another recording.
    """
    base = EnvironmentSpec.make(domain_name="kitchen", task_name="all", task_kwargs=_TASK_KWARGS)
    with contextlib.closing(base.make_environment()) as made:
        environment = suite_env(made)
        task: KitchenTask = environment.composer_task
        data = open_data(source, data_path, task.scene)
        if not len(data):
            raise ValueError(f"{source} holds no episodes of two or more observations")
        origin, versions = {"format": data.format, "source": source, **data.contents}, installed_versions()
        spec = EpisodeSpec(**vars(base), policy="human", seed=0, seeding="gymnasium", versions=versions, origin=origin)
        folder = Recording.claim(output, spec)
        completions, counts = dict.fromkeys(task.policy_inputs.tasks, 0), collections.Counter[int]()
        goals, steps = set[str](), 0
        demonstrations = tqdm(data.read(), total=len(data), disable=None, leave=False)
        for index, demonstration in enumerate(demonstrations):
            episode, metrics, completed = as_episode(environment, index, demonstration)
            # An interrupted import has written the same episodes.
            with contextlib.suppress(FileExistsError):
                folder.append(dataclasses.replace(episode, metrics=metrics))
            for name in completed:
                completions[name] += 1
            counts[len(completed)] += 1
            goals |= {*demonstration.goals}
            steps += episode.steps
    return ImportedData(
        format=data.format,
        episodes=len(data),
        steps=steps,
        goals=frozenset(goals),
        completions=completions,
        counts=counts,
        has_velocities=data.has_velocities,
    )
