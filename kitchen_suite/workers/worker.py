"""The actor that runs in each worker process on Ray."""

import pickle
import platform
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

from kitchen_suite.rendering import gl
from kitchen_suite.versions import installed_versions

# Nothing here imports dm_control: the runner's modules, which do, are imported by unpickling it, after `gl.prepare`.


class ClusterError(OSError):
    """Ray cannot be reached or used, or its workers fail repeatedly."""


class EpisodeRunner(Protocol):
    """Runs episodes in a worker process, one or several at a time."""

    def run(self, more: Sequence[tuple[int, int]]) -> tuple[int, Any]:
        """Runs until one of the pending episodes has ended, and returns its index and result.

        Args:
          more: (index, seed) of further episodes, which become pending first.
        """


RunnerFactory = Callable[[], EpisodeRunner]


class Worker:
    """A Ray actor that runs episodes."""

    def start(self, pickled: bytes, versions: Mapping[str, str]) -> None:
        """Builds the episode runner of a pickled `RunnerFactory`.

        Raises a ClusterError if it cannot be built on this machine, or versions differ from those of the main process.
        """
        try:
            gl.prepare(rendering=False)
            _check_versions(versions)
            self._runner: EpisodeRunner = pickle.loads(pickled)()
        except (ImportError, OSError, TypeError, ValueError) as error:
            raise ClusterError(f"a worker on {platform.node()} cannot start: {error}") from error

    def run(self, more: Sequence[tuple[int, int]]) -> tuple[int, Any]:
        return self._runner.run(more)


def waiting_line(num_threads: int, *, free: float, machines: Sequence[float]) -> str:
    """Returns why no worker has started yet, by processors: those that one needs, the free ones, and each machine's."""
    line, largest = f"waiting for processors: a worker needs {num_threads}", max(machines, default=0)
    if num_threads <= largest:
        return f"{line}, {free:g} of the cluster's are free"
    # A cluster that grows may yet add a larger one.
    return f"{line}, but its largest machine has {largest:g}: give a smaller --num_threads, or add one"


def _check_versions(expected: Mapping[str, str]) -> None:
    """Raises a ValueError that lists the packages of which another version is installed here."""
    installed = installed_versions()
    differing = [
        f"{name} {installed[name]} instead of {version}"
        for name, version in expected.items()
        if installed[name] != version
    ]
    if differing:
        raise ValueError(f"it has {', '.join(differing)}, so its episodes would differ")
