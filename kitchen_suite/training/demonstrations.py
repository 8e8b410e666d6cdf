"""Recorded demonstrations: inputs and chunks of actions for behaviour cloning, observations and actions for PPO."""

import contextlib
import dataclasses
import json
import warnings
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kitchen_suite import suite
from kitchen_suite.episodes.episode import unflatten
from kitchen_suite.episodes.recording import SPEC_FILE, Recording
from kitchen_suite.episodes.spec import EnvironmentSpec
from kitchen_suite.episodes.transitions import Transitions
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.gymnasium_env.observations import picture_key
from kitchen_suite.tasks.task import SuiteTask

# Arguments of all domains on which the meaning of observed numbers depends.
OBSERVATION_OPTIONS = ("obs_type", "extra_observables")

# Other advice than to pass the same arguments to recording and training.
_REMEDIES = {"obs_type": "record again without obs_type; the same seeds are the same episodes"}


class Demonstrations(NamedTuple):
    """Control steps of all episodes, one after the other.

    Attributes:
      inputs: `(m, n)`, float32: the state, or some of its elements, and which of the policy's tasks are requested.
      actions: `(m, k)`, float32, taken on them.
      last: `(m,)`, index of the last step of each step's episode, or of the intervention that it belongs to.
      state_elements: elements of the state among the inputs; None for all.
      pictures: `(m, h, w, 3)`, uint8, of each camera.
    """

    inputs: NDArray[np.float32]
    actions: NDArray[np.float32]
    last: NDArray[np.int64]
    state_elements: tuple[int, ...] | None = None
    pictures: Mapping[str, NDArray[np.uint8]] = MappingProxyType({})

    def chunks(self, length: int) -> NDArray[np.int64]:
        """Returns the indices `(m, length)` of the actions that follow each input; the last ones repeat at the end."""
        return np.minimum(np.arange(len(self.actions))[:, np.newaxis] + np.arange(length), self.last[:, np.newaxis])


def load_demonstrations(
    folders: Sequence[Path], spec: EnvironmentSpec, tasks: Sequence[str], counts: Sequence[int]
) -> Demonstrations:
    """Reads the successful episodes of recordings; see `load_recording`.

    Args:
      folders: of the recordings.
      spec: of the environments that the policy is evaluated in.
      tasks: names of the tasks whose request the policy observes.
      counts: number of episodes of each recording, or one number for all; empty for all episodes.
    """
    parts = [load_recording(folder, spec, tasks, count) for folder, count in with_counts(folders, counts)]
    for folder, part in zip(folders, parts, strict=True):
        if part.state_elements != parts[0].state_elements:
            raise ValueError(f"{folder} and {folders[0]} do not hold the same elements of the state")
    starts = np.cumsum([0, *(len(part.last) for part in parts[:-1])])
    return Demonstrations(
        inputs=np.concatenate([part.inputs for part in parts]),
        actions=np.concatenate([part.actions for part in parts]),
        last=np.concatenate([part.last + start for part, start in zip(parts, starts, strict=True)]),
        state_elements=parts[0].state_elements,
        pictures={camera: np.concatenate([part.pictures[camera] for part in parts]) for camera in parts[0].pictures},
    )


def with_counts(folders: Sequence[Path], counts: Sequence[int]) -> list[tuple[Path, int | None]]:
    """Returns the number of episodes beside each folder, None for all; arguments as in `load_demonstrations`."""
    if len(counts) not in (0, 1, len(folders)):
        raise ValueError(f"num_demonstrations has {len(counts)} numbers for {len(folders)} folders of demonstrations")
    each = counts if len(counts) == len(folders) else [counts[0] if counts else None] * len(folders)
    return [*zip(folders, each, strict=True)]


def load_recording(
    folder: Path, spec: EnvironmentSpec, tasks: Sequence[str], count: int | None = None
) -> Demonstrations:
    """Reads the successful episodes that `kitchen-record` has written to a folder; arguments as `load_demonstrations`.

    Of `count` episodes they are the first ones.

    Raises:
      OSError: there is no recording, or one of its episodes cannot be read, or holds actions that are not finite.
      ValueError: it is of another domain, of tasks none of which is wanted, or with other arguments that state or
        actions depend on, or holds fewer such episodes, or observed numbers that are not finite.
    """
    recording = open_recording(folder, spec, suite.find_domain(spec.domain_name).control_options)
    if missing := spec.names - recording.spec.names:
        if missing == spec.names:
            raise ValueError(f"{folder} holds episodes of {_title(recording.spec)}, not of {_title(spec)}")
        names = sorted(name for _, name in missing)
        warnings.warn(f"{folder} holds no episodes of {names}: nothing is learned of them", stacklevel=2)
    indices = recording.successful[:count]
    if len(indices) < (count or 1):
        raise ValueError(f"{folder} holds {len(indices)} successful episodes, not {count or 'one or more'}")
    with recording.spec.make_environment() as environment:
        single = suite_env(environment)
        task = single.composer_task
        robot = single.observations.robot_elements
        sees = single.observations.has_pictures
        transitions = Transitions.of(recording.load_fitting(index, environment) for index in indices)
    taught = _taught(transitions, folder)
    observation = unflatten(transitions.arrays, "observation")
    policy_inputs = task.policy_inputs
    if sees:
        check_same(folder, recording.spec, spec, ("cameras", "image_size"))
        # Of the state they have the robot's part alone.
        policy_inputs = dataclasses.replace(policy_inputs, state_size=len(robot))
    inputs = policy_inputs.state_and_requests(observation, tasks)[transitions.rows]
    elements: tuple[int, ...] | None = None
    size = task.policy_inputs.state_size
    recorded = np.isfinite(inputs[:, :size]).all(axis=0)
    if recording.spec.origin is not None and not recorded.all():
        # Another program has recorded some elements of the state alone.
        elements = tuple(np.flatnonzero(recorded).tolist())
        inputs = inputs[:, [*elements, *range(size, inputs.shape[1])]]
    return Demonstrations(
        inputs=finite(inputs[taught], folder),
        actions=finite(transitions.actions[taught], folder),
        last=_last_of_stretches(np.split(taught, np.cumsum(transitions.lengths)[:-1])),
        state_elements=tuple(robot) if sees else elements,
        pictures=_pictures(observation["pixels"], task, transitions.rows[taught]) if sees else {},
    )


def _pictures(observed: Any, task: SuiteTask, rows: NDArray[np.int64]) -> dict[str, NDArray[np.uint8]]:
    """Returns the pictures `(m, h, w, 3)` of each camera in some rows of what was observed of them."""
    cameras = [picture.camera for picture in task.pictures.pictures if picture.kind == "pixels"]
    if not isinstance(observed, Mapping):
        return dict.fromkeys(cameras, observed[rows])
    return {camera: observed[picture_key(camera)][rows] for camera in cameras}


def _taught(transitions: Transitions, folder: Path) -> NDArray[np.bool_]:
    """Returns which actions `(m,)` are a demonstrator's: interventions; all where there are no labels."""
    taught = transitions.arrays.get("label/is_intervention", np.ones(len(transitions.actions), np.bool_))
    if not taught.any():
        raise ValueError(f"{folder} holds no actions of a demonstrator: its policy never intervened")
    return taught


def _last_of_stretches(taught: Sequence[NDArray[np.bool_]]) -> NDArray[np.int64]:
    """Returns, for each true element of arrays, the number of the last one of its stretch among all true elements."""
    stretches = [part for each in taught for part in np.split(each, np.flatnonzero(np.diff(each)) + 1)]
    lengths = [len(stretch) for stretch in stretches if stretch.any()]
    return np.repeat(np.cumsum(lengths) - 1, lengths)


def finite(numbers: NDArray, folder: Path) -> NDArray[np.float32]:
    """Returns numbers of a recording as float32; raises a ValueError unless all are finite."""
    with np.errstate(over="ignore"):
        numbers = numbers.astype(np.float32)
    if not np.isfinite(numbers).all():
        raise ValueError(f"{folder} holds observations or actions that are not finite")
    return numbers


def load_to_clone(folder: Path, spec: EnvironmentSpec) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Reads all episodes that `kitchen-record` has written to a folder, for PPO to clone; `spec` is to be trained in.

    Returns flat observations `(m, n)` in the order of a trained policy's, and the actions `(m, k)` taken on them.
    """
    options = (*spec.env_class.goal_options, *suite.find_domain(spec.domain_name).control_options)
    recording = open_recording(folder, spec, options)
    found, expected = _title(recording.spec), _title(spec)
    if found != expected:
        raise ValueError(f"{folder} holds episodes of {found}, not of {expected}")
    if not recording.indices:
        raise ValueError(f"{folder} holds no episodes yet")
    if recording.spec.origin is not None:
        raise ValueError(f"{folder} was made by kitchen-convert: behaviour cloning (bc) learns from it")
    with recording.spec.make_environment() as environment:
        transitions = Transitions.of(recording.load_fitting(index, environment) for index in recording.indices)
    with spec.make_environment() as environment:
        policy_inputs = suite_env(environment).composer_task.policy_inputs
    taught = _taught(transitions, folder)
    observations = policy_inputs.flatten(unflatten(transitions.arrays, "observation"))[transitions.rows]
    return finite(observations[taught], folder), finite(transitions.actions[taught], folder)


def open_recording(folder: Path, wanted: EnvironmentSpec, options: Collection[str]) -> Recording:
    """Opens a recording whose observations and actions mean the same as in the `wanted` environments to be trained in.

    The domain's `options`, which are named, have to be equal.
    """
    if not (folder / SPEC_FILE).exists():
        raise FileNotFoundError(f"there is no recording in {folder}: kitchen-record makes one")
    recording = Recording.open(folder)
    recorded = recording.spec
    if recorded.domain_name != wanted.domain_name:
        raise ValueError(f"{folder} holds episodes of {_title(recorded)}, not of {_title(wanted)}")
    check_same(folder, recorded, wanted, (*OBSERVATION_OPTIONS, *options))
    return recording


def check_observed(spec: EnvironmentSpec, algorithm: str, others: Collection[str] = ()) -> None:
    """Raises a ValueError unless policies of an algorithm take the observations of environments.

    They take the domain's default observation type, and some `others`.
    """
    taken = (spec.env_class.obs_types[0], *others)
    if (obs_type := spec.task_kwargs.get("obs_type") or taken[0]) not in taken:
        problem = f"obs_type {obs_type!r} cannot be trained on with {algorithm!r}"
        raise ValueError(f"{problem}: its policies take {' or '.join(map(repr, taken))}")


def check_same(path: Path, recorded: EnvironmentSpec, wanted: EnvironmentSpec, names: Collection[str]) -> None:
    """Raises a ValueError unless the arguments of some names of recorded environments and of others are the same."""
    for name in names:
        one, other = (spec.argument(name) for spec in (recorded, wanted))
        if one != other:
            one, other = _in_mode(recorded, name, one), _in_mode(wanted, name, other)
        if one != other:
            remedy = _REMEDIES.get(name, "record and train with the same task_kwargs")
            found, wanted_now = json.dumps(one), json.dumps(other)
            raise ValueError(f"{path} was made with {name} {found}, but this run has {wanted_now}: {remedy}")


def _title(spec: EnvironmentSpec) -> str:
    return f"{spec.domain_name} {spec.task_name}"


def _in_mode(spec: EnvironmentSpec, name: str, value: Any) -> Any:
    """Returns the value of an argument; where it is None, that of the environments' control, if it has it."""
    if value is not None:
        return value
    with contextlib.closing(spec.make_environment()) as environment:
        task = suite_env(environment).composer_task
    mode = task.mdp.action_mode
    own = {"control_mode": mode.name, "control_timestep": task.control_timestep}
    return own[name] if name in own else getattr(mode, name, None)
