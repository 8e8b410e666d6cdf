"""Demonstrations as inputs of a policy and chunks of the actions that follow them."""

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kitchen_suite import suite
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.rollouts.spec import EnvironmentSpec
from kitchen_suite.tasks.task import SuiteTask
from kitchen_suite.training import behaviour_cloning

_REQUESTED = "observation/requested_tasks"


class Demonstrations(NamedTuple):
    """Control steps of all episodes, one after the other.

    Attributes:
      inputs: `(m, n)`, float32: the state, or some of its elements, and which of the policy's tasks are asked.
      actions: `(m, k)`, float32, taken on them.
      last: `(m,)`, index of the last step of each step's episode.
      state_elements: elements of the state among the inputs; None for all.
    """

    inputs: NDArray[np.float32]
    actions: NDArray[np.float32]
    last: NDArray[np.int64]
    state_elements: tuple[int, ...] | None = None

    def chunks(self, length: int) -> NDArray[np.int64]:
        """Returns the indices `(m, length)` of the actions that follow each input; the last ones repeat at the end."""
        return np.minimum(np.arange(len(self.actions))[:, np.newaxis] + np.arange(length), self.last[:, np.newaxis])


def load_all(
    folders: Sequence[Path], spec: EnvironmentSpec, tasks: Sequence[str], counts: Sequence[int]
) -> Demonstrations:
    """Reads the successful episodes of recordings; see `load`.

    Args:
      folders: of the recordings.
      spec: of the environments that the policy is evaluated in.
      tasks: names of the tasks whose request the policy observes.
      counts: number of episodes of each recording, or one number for all; empty for all episodes.

    Raises:
      OSError: there is no recording, or one of its episodes cannot be read.
      ValueError: as `load`; or there are not as many numbers as recordings, or these have other elements of the state.
    """
    if len(counts) not in (0, 1, len(folders)):
        raise ValueError(f"num_demonstrations has {len(counts)} numbers for {len(folders)} folders of demonstrations")
    wanted = counts if len(counts) == len(folders) else [counts[0] if counts else None] * len(folders)
    parts = [load(folder, spec, tasks, count) for folder, count in zip(folders, wanted, strict=True)]
    for folder, part in zip(folders, parts, strict=True):
        if part.state_elements != parts[0].state_elements:
            raise ValueError(f"{folder} and {folders[0]} do not hold the same elements of the state")
    starts = np.cumsum([0, *(len(part.last) for part in parts[:-1])])
    return Demonstrations(
        inputs=np.concatenate([part.inputs for part in parts]),
        actions=np.concatenate([part.actions for part in parts]),
        last=np.concatenate([part.last + start for part, start in zip(parts, starts, strict=True)]),
        state_elements=parts[0].state_elements,
    )


def load(folder: Path, spec: EnvironmentSpec, tasks: Sequence[str], count: int | None = None) -> Demonstrations:
    """Reads the successful episodes that `kitchen-record` has written to a folder.

    Args:
      folder: of the recording.
      spec: of the environments that the policy is evaluated in.
      tasks: names of the tasks whose request the policy observes; none where it does not.
      count: number of these episodes, the first ones; all when omitted.

    Raises:
      OSError: there is no recording, or one of its episodes cannot be read.
      ValueError: it is of another domain or with other arguments that state or actions depend on, or holds fewer
        such episodes.
    """
    recording = behaviour_cloning.open_recording(folder, spec, suite.DOMAINS[spec.domain_name].state_options)
    successful = (index for index in recording.indices if recording.load_stats(index).metrics["success"])
    indices = [*itertools.islice(successful, count)]
    if len(indices) < (count or 1):
        raise ValueError(f"{folder} holds {len(indices)} successful episodes, not {count or 'one or more'}")
    with recording.spec.make_environment() as environment:
        task = suite_env(environment).environment.task
    episodes = [recording.load(index).arrays for index in indices]
    lengths = [len(arrays["action"]) for arrays in episodes]
    inputs = np.concatenate([_inputs(arrays, task, tasks) for arrays in episodes])
    elements = None if recording.spec.origin is None else _recorded_elements(inputs, task.state_size)
    if elements is not None:
        inputs = inputs[:, [*elements, *range(task.state_size, inputs.shape[1])]]
    return Demonstrations(
        inputs=inputs,
        actions=np.concatenate([arrays["action"] for arrays in episodes]).astype(np.float32),
        last=np.repeat(np.cumsum(lengths) - 1, lengths),
        state_elements=elements,
    )


def _recorded_elements(inputs: NDArray[np.float32], size: int) -> tuple[int, ...] | None:
    """Returns which of the `size` elements of the state another program has recorded; None for all."""
    recorded = np.isfinite(inputs[:, :size]).all(axis=0)
    return None if recorded.all() else tuple(np.flatnonzero(recorded).tolist())


def _inputs(arrays: Mapping[str, NDArray], task: SuiteTask, tasks: Sequence[str]) -> NDArray[np.float32]:
    """Returns the inputs `(t, n)` of an episode of a recorded task."""
    state = behaviour_cloning.flat_observations(arrays)[:-1, : task.state_size]
    # Without draws, every episode asks for all tasks.
    requested = arrays.get(_REQUESTED, np.ones((len(state) + 1, len(task.task_names))))[:-1]
    columns = dict(zip(task.task_names, requested.T, strict=True))
    asked = [columns.get(name, np.zeros(len(state))) for name in tasks]
    return np.column_stack([state, *asked]).astype(np.float32)
