"""Policies in npz files, which are read without pickle and act with numpy alone, and those that the package ships."""

import abc
import dataclasses
import functools
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self, TypeVar

import dm_env
from numpy.typing import NDArray

from kitchen_suite import checks, files
from kitchen_suite._version import __version__

if TYPE_CHECKING:
    from kitchen_suite.tasks.task import SuiteTask

# Returns the action for a time step of an episode.
EpisodePolicy = Callable[[dm_env.TimeStep], NDArray]

FORMAT = 1  # Version of the file layout, incremented when older versions of the suite would misread new files.

SHIPPED = Path(__file__).parent / "trained_policies"  # Folder of the policies that come with the package.

# Bound of the arrays of a file [bytes], a dozen times what the greatest policy of the package takes.
_MAX_BYTES = 64 * 2**20


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Metadata:
    """Metadata that every file must hold: the version of its layout, and the task of the policy."""

    format: int
    domain_name: str
    task_name: str
    task_kwargs: dict[str, Any]


class StoredPolicy(abc.ABC):
    """A policy that can be written to a file.

    Attributes:
      metadata: JSON-compatible; `domain_name`, `task_name`, `task_kwargs` and a record of the training.
    """

    # Name of the algorithm in the metadata of files.
    algorithm: ClassVar[str]
    metadata: Mapping[str, Any]

    def __repr__(self) -> str:
        task = f"{self.metadata.get('domain_name')} {self.metadata.get('task_name')}"
        return f"<{type(self).__name__} of {task}, layers {self.layers}>"

    @property
    @abc.abstractmethod
    def layers(self) -> list[int]:
        """Number of inputs, and of outputs of each layer or block of the greatest network."""

    @property
    @abc.abstractmethod
    def action_size(self) -> int:
        """Number of elements of the action."""

    def missing_observables(self, task: "SuiteTask") -> list[str]:
        """Returns the names of the extra observables that the policy needs and that a task does not have."""
        return []

    @abc.abstractmethod
    def check_fits(self, task: "SuiteTask") -> None:
        """Raises a ValueError unless the policy's sizes are a task's, and it can act in the task's control mode."""

    def episode(self, task: "SuiteTask") -> EpisodePolicy:
        """Returns the policy of an episode of a task; raises a ValueError if it does not fit the task."""
        self.check_fits(task)
        act = self._acting(task)
        convert = task.mdp.action_mode.conversion(self._control_mode(task))
        if not convert:
            return act
        # The task may have another control mode than the actions.
        inputs = task.policy_inputs
        return lambda timestep: convert(inputs.state_and_requests(timestep.observation, ()).ravel(), act(timestep))

    @abc.abstractmethod
    def _acting(self, task: "SuiteTask") -> EpisodePolicy:
        """Returns the policy of an episode in the control mode that it was trained in."""

    @property
    @abc.abstractmethod
    def arrays(self) -> dict[str, NDArray]:
        """The arrays of its file, by name."""

    @classmethod
    @abc.abstractmethod
    def from_arrays(cls, arrays: dict[str, NDArray], metadata: Mapping[str, Any]) -> Self:
        """Returns the policy with the arrays, which may be emptied, and the metadata of a file.

        Raises a ValueError if parts are missing or unknown, or do not fit the others.
        """

    @classmethod
    def load(cls, path: Path) -> Self:
        """Reads a policy of this class.

        Raises:
          OSError: the file does not exist, is larger than any policy, or is not an npz file with metadata.
          ValueError: the file is of another algorithm or version of the layout, or lacks or contradicts some part.
        """
        return load(path, (cls,))

    def with_metadata(self, metadata: Mapping[str, Any]) -> Self:
        """Returns the policy with other metadata."""
        return dataclasses.replace(self, metadata=metadata)  # type: ignore[type-var]

    def save(self, path: Path) -> None:
        """Writes the policy to an npz file, atomically."""
        metadata = {**self.metadata, "format": FORMAT, "kitchen_suite": __version__}
        files.save_arrays(path, self.arrays, metadata)

    @property
    def _trained_for(self) -> str:
        task = f"it was trained for {self.metadata.get('domain_name')} {self.metadata.get('task_name')}"
        arguments = self.metadata.get("task_kwargs")
        return f"{task} with the task_kwargs {json.dumps(arguments)}" if arguments else task

    def _check_sizes_and_mode(self, task: "SuiteTask", *, observed: int, expected: int) -> None:
        """Raises a ValueError unless observed and expected numbers of elements agree, and the actions fit the task."""
        (size,) = task.mdp.action_mode.spec(task.robot).shape
        if (observed, self.action_size) != (expected, size):
            mapped = f"{observed} observed numbers to {self.action_size} numbers of an action"
            raise ValueError(f"the policy maps {mapped}, but this task has {expected} and {size}: {self._trained_for}")
        mode = self._control_mode(task)
        present = task.mdp.action_mode
        if mode != present.name and not present.conversion(mode):
            raise ValueError(f"the policy acts in control mode {mode!r}, not {present.name!r}: {self._trained_for}")

    def _control_mode(self, task: "SuiteTask") -> str:
        """Returns the name of the control mode that the policy was trained in."""
        arguments = self.metadata.get("task_kwargs") or {}
        return arguments.get("control_mode") or next(iter(task.control_modes), task.mdp.action_mode.name)


Stored = TypeVar("Stored", bound=StoredPolicy)


def load(path: Path, classes: Sequence[type[Stored]]) -> Stored:
    """Reads a policy of one of some classes: that of the algorithm that the file names."""
    problem = f"{path} holds no trained policy"
    arrays, metadata = files.load_arrays(path, "a trained policy", max_bytes=_MAX_BYTES)
    version = files.parse(metadata, _Metadata, problem).format
    if version != FORMAT:
        raise ValueError(f"{path} has format {version}; this version reads {FORMAT}")
    by_algorithm = {each.algorithm: each for each in classes}
    try:
        # Files of PPO do not name it.
        algorithm = checks.choice(metadata.get("algorithm", "ppo"), by_algorithm, "algorithm")
        return by_algorithm[algorithm].from_arrays(arrays, metadata)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{problem}: {error}") from error


def shipped(task: "SuiteTask") -> Path:
    """Returns the path of the policy that comes with the package for a task and its reward, or a set with the task.

    Where pictures are observed, a policy that takes them is preferred; where parameters vary, one trained with these.
    """
    paths = [path for name in task.policy_inputs.names if (path := SHIPPED / f"{name}.npz").exists()]
    # Those that see, where they can, else the others.
    seeing, others = ([path for path in paths if _sees(path, task) is sees] for sees in (True, False))
    paths = seeing or others
    if task.variations.by_name:
        paths = [path for path in paths if "variations" in _metadata(path)["task_kwargs"]] or paths
    if paths:
        return paths[0]
    title = f"{task.domain_name or 'task'} {task.policy_inputs.names[0]}"
    present = [f"{_metadata(path)['domain_name']} {path.stem}" for path in sorted(SHIPPED.glob("*.npz"))]
    raise ValueError(f"no trained policy comes with the package for {title}; there are: {', '.join(present)}")


def _sees(path: Path, task: "SuiteTask") -> bool | None:
    """Returns whether a policy takes pictures; None if the task does not observe those that it takes."""
    metadata = _metadata(path)
    taken = task.pictures.by_name
    cameras = metadata.get("cameras", ())
    sizes = [list(taken[camera].array_spec.shape[:2]) for camera in cameras if camera in taken]
    return bool(cameras) if sizes == [metadata.get("image_size")] * len(cameras) else None


@functools.cache
def _metadata(path: Path) -> dict[str, Any]:
    return files.load_metadata(path, "a trained policy")


def shipped_as(name: str) -> Path:
    """Returns the path of a policy that comes with the package.

    Args:
      name: of the file without suffix: the task, such as `top_drawer`, and the reward unless it is the original one,
        such as `top_drawer_grasp`; or `kitchen`, for any set of the kitchen's seven tasks.
    """
    names = sorted(path.stem for path in SHIPPED.glob("*.npz"))
    return SHIPPED / f"{checks.choice(name, names, 'trained policy that comes with the package')}.npz"
