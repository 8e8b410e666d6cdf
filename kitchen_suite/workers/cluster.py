"""Where workers are: on a Ray that is started here for the time being, or on a cluster that is there already.

Needs the extra `ray`, which is imported only when it is used.
"""

import contextlib
import dataclasses
import importlib.util
import os
import signal
import socket
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from typing import Any

from kitchen_suite.workers.worker import ClusterError

# Read when Ray is imported or started. That a worker died is told in a line; usage is not reported.
_QUIET = {
    "RAY_DEDUP_LOGS_SKIP_REGEX": "A worker died or was killed|Raylet is terminated",
    "RAY_USAGE_STATS_ENABLED": "0",
}
_CLIENT = "ray://"
_PATIENCE = 5.0  # How long an address may take to answer [s].


@dataclasses.dataclass(frozen=True, kw_only=True)
class Cluster:
    """A number of workers, and where they are.

    Attributes:
      workers: how many.
      address: `HOST:PORT` of a cluster's head, `ray://HOST:PORT` of its server for clients, `auto` for the cluster that
        this machine belongs to; None starts Ray here.
    """

    workers: int
    address: str | None = None

    def check(self) -> None:
        """Sees to it that there is something to connect to.

        Raises:
          ImportError: Ray is missing.
          OSError: nothing answers at the address.
          ValueError: it is no address.
        """
        if importlib.util.find_spec("ray") is None:
            raise ImportError("workers need Ray: pip install 'kitchen-suite[ray]'")
        if self.address not in (None, "auto"):
            _check_answers(self.address)

    def play(
        self, build: Callable[[], Any], episodes: Sequence[tuple[int, int]], *, capacity: int, num_threads: int
    ) -> Generator[tuple[int, Any], None, None]:
        """Has episodes played; gives their numbers and what came of them as they end. To be closed if left early.

        Args:
          build: makes what plays, a `ray_pool.Player`, in a worker's process; can be pickled.
          episodes: their numbers and seeds.
          capacity: how many a worker is given at once.
          num_threads: processors that a worker takes.

        Raises:
          ClusterError: see there.
          Exception: what playing an episode raised.
        """
        with self._connected(self.workers * num_threads):
            from kitchen_suite.workers.pool import Pool

            pool = Pool(build, workers=self.workers, capacity=capacity, num_threads=num_threads)
            with contextlib.closing(pool):
                yield from pool.play(episodes)

    @contextlib.contextmanager
    def _connected(self, num_cpus: int) -> Iterator[None]:
        """Connects to Ray, unless the program has done so already; leaves it, or stops it, at the end."""
        with _environment(_QUIET):
            import ray

            if ray.is_initialized():
                yield
                return
            try:
                with _sigterm_kept():
                    self._connect(num_cpus)
                yield
            finally:
                ray.shutdown()

    def _connect(self, num_cpus: int) -> None:
        import ray

        settings = {"num_cpus": num_cpus, "include_dashboard": False} if self.address is None else {}
        try:
            ray.init(self.address or "local", log_to_driver=False, logging_level="ERROR", **settings)
        except (OSError, RuntimeError, ValueError) as error:
            raise ClusterError(f"cannot use Ray at {self.address or 'this machine'}: {error}") from error


def _check_answers(address: str) -> None:
    """Raises a ValueError if it is no address, an OSError if nothing answers: Ray itself would try for minutes."""
    host, _, port = address.removeprefix(_CLIENT).rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 2**16:
        raise ValueError(f"{address!r} is no address of Ray: it must be HOST:PORT, {_CLIENT}HOST:PORT or auto")
    try:
        socket.create_connection((host.strip("[]"), int(port)), _PATIENCE).close()
    except OSError as error:
        raise OSError(f"no Ray answers at {address}: {error}") from error


@contextlib.contextmanager
def _environment(variables: dict[str, str]) -> Iterator[None]:
    """Sets environment variables where they are not set."""
    added = {name: value for name, value in variables.items() if name not in os.environ}
    os.environ.update(added)
    try:
        yield
    finally:
        for name in added:
            os.environ.pop(name, None)


@contextlib.contextmanager
def _sigterm_kept() -> Iterator[None]:
    """Keeps the handler of SIGTERM, which Ray replaces by one of its own."""
    handler = signal.getsignal(signal.SIGTERM)
    try:
        yield
    finally:
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGTERM, handler)
