"""Episodes on the workers of Ray, which needs the extra `ray`: imported only when episodes are played there."""

import contextlib
import dataclasses
import importlib.util
import itertools
import os
import platform
import signal
import threading
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from typing import Any, TypeVar

from kitchen_suite import checks, installation
from kitchen_suite.vector_env.base import processors
from kitchen_suite.versions import installed_versions

T = TypeVar("T")

# Parts into which the episodes are split for each worker: the more, the less is lost with a worker, and the more evenly
# they end; the fewer, the less often environments are built.
_PARTS = 4

# Least processors that a worker reserves, far above Ray's resolution.
MIN_CPUS = 0.01

# Times that Ray plays a part again whose worker has died.
_MAX_RETRIES = 3


class ClusterError(OSError):
    """Ray cannot be reached or used, or its workers fail repeatedly."""


@dataclasses.dataclass(frozen=True)
class Cluster:
    """Workers on Ray.

    Attributes:
      workers: number of processes that play episodes.
      address: `HOST:PORT` of the head of a running cluster, `ray://HOST:PORT` of its client server, or `auto` for the
        cluster that this machine belongs to; None starts Ray on this machine while episodes are played.
      cpus_per_worker: processors that each worker reserves with Ray; as many as it has threads when None. Less than 1
        is for policies that wait for a server, more for those with threads of their own.

    Workers play at once as far as their processors are free, those of this machine where Ray is started here.

    Raises an ImportError if Ray is not installed.
    """

    workers: int
    address: str | None = None
    cpus_per_worker: float | None = None

    def __post_init__(self) -> None:
        checks.integer(self.workers, "workers", minimum=1)
        if self.cpus_per_worker is not None:
            cpus = checks.number(self.cpus_per_worker, "cpus_per_worker", maximum=checks.MAX_THREADS)
            if cpus < MIN_CPUS:
                raise ValueError(f"cpus_per_worker must be at least {MIN_CPUS:g}, got {self.cpus_per_worker}")
        if importlib.util.find_spec("ray") is None:
            raise ImportError(f"workers need Ray: {installation.install_command('ray')}")

    def run(
        self, function: Callable[..., list[T]], arguments: Sequence[Any], items: Sequence[Any], *, num_threads: int
    ) -> Generator[T, None, None]:
        """Calls `function(part, *arguments)` for parts of the items on the workers; yields all results.

        Ray calls it again for a part whose worker dies: the function must return the same for the same part. Each call
        uses `num_threads` threads.

        Raises a ClusterError if Ray cannot be used, and any exception that the function raises.
        """
        num_cpus = num_threads if self.cpus_per_worker is None else self.cpus_per_worker
        with self._connected() as ray:
            sizes = [node["Resources"].get("CPU", 0) for node in ray.nodes() if node["Alive"]]
            if num_cpus > max(sizes, default=0):
                largest = f"{max(sizes, default=0):g}"
                reserved = f"a worker reserves {num_cpus:g} processors, and no machine has more than {largest}"
                raise ClusterError(f"{reserved}: lower num_threads or cpus_per_worker")
            remote = ray.remote(num_cpus=num_cpus, max_retries=_MAX_RETRIES)(_checked)
            size = max(1, -(-len(items) // (self.workers * _PARTS)))
            parts = [items[first : first + size] for first in range(0, len(items), size)]
            shared = ray.put((function, tuple(arguments), installed_versions()))
            waiting = [remote.remote(part, shared) for part in parts[: self.workers]]
            rest = iter(parts[self.workers :])
            try:
                while waiting:
                    ended, waiting = ray.wait(waiting)
                    waiting += [remote.remote(part, shared) for part in itertools.islice(rest, len(ended))]
                    for each in ended:
                        yield from _result(ray, each)
            finally:
                for each in waiting:
                    ray.cancel(each, force=True)

    @contextlib.contextmanager
    def _connected(self) -> Iterator[Any]:
        """Connects to Ray, and disconnects or stops it at the end; uses the connection that the program has, if any."""
        # No usage statistics are sent, unless they are wanted.
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        import ray

        if ray.is_initialized():
            yield ray
            return
        own = {"num_cpus": processors(), "include_dashboard": False} if self.address is None else {}
        handler = signal.getsignal(signal.SIGTERM)
        # The processes that Ray starts inherit this mask, as Ray has them do for SIGINT. Otherwise a SIGTERM to the
        # whole group of processes ends them first, and Ray then ends this process before it can say what happened.
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
        try:
            try:
                ray.init(self.address or "local", log_to_driver=False, logging_level="ERROR", **own)
            except (OSError, RuntimeError, ValueError) as error:
                raise ClusterError(f"cannot use Ray at {self.address or 'this machine'}: {error}") from error
            finally:
                # Ray replaces it when it is started, by one with which the process can end by signal 6.
                if threading.current_thread() is threading.main_thread():
                    signal.signal(signal.SIGTERM, handler)
                signal.pthread_sigmask(signal.SIG_SETMASK, mask)
            yield ray
        finally:
            ray.shutdown()


def _checked(part: Sequence[Any], shared: tuple[Callable[..., list[T]], tuple[Any, ...], Mapping[str, str]]) -> list[T]:
    """Calls a function on a worker; raises a ClusterError if its packages are of other versions than the caller's."""
    function, arguments, versions = shared
    here = installed_versions()
    odd = [f"{name} {here[name]} instead of {there}" for name, there in versions.items() if here[name] != there]
    if odd:
        raise ClusterError(f"a worker on {platform.node()} has {', '.join(odd)}, so its episodes would differ")
    return function(part, *arguments)


def _result(ray: Any, reference: Any) -> list[Any]:
    """Returns what a task returned; raises what it raised, and a ClusterError where its workers died."""
    try:
        return ray.get(reference)
    except ray.exceptions.RayError as error:
        cause = getattr(error, "cause", error)
        if not isinstance(cause, ray.exceptions.RayError):
            raise cause from error
        raise ClusterError(f"a part of the episodes could not be played: {' '.join(str(cause).split())}") from error
