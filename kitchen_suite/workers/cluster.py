"""Connects to Ray: started on this machine for the duration of a run, or an existing cluster.

Needs the extra `ray`, which is imported only when a run starts.
"""

import contextlib
import dataclasses
import importlib.util
import os
import signal
import socket
import threading
from collections.abc import Generator, Iterator, Sequence
from typing import Any

from kitchen_suite import checks
from kitchen_suite.workers.pool import ClusterError, Pool, RunnerFactory

# Ray reads these when it is imported or started. The pool logs a worker's death itself; no usage statistics are sent.
_RAY_VARIABLES = {
    "RAY_DEDUP_LOGS_SKIP_REGEX": "A worker died or was killed|Raylet is terminated",
    "RAY_USAGE_STATS_ENABLED": "0",
}


@dataclasses.dataclass(frozen=True, kw_only=True)
class RaySettings:
    """Number of Ray workers and the cluster that they run on.

    The address is `HOST:PORT` of a cluster's head, `ray://HOST:PORT` of its client server, or `auto` for the cluster
    that this machine belongs to; None starts Ray on this machine.
    """

    workers: int
    address: str | None = None

    @classmethod
    def of(cls, workers: int, address: str | None) -> "RaySettings":
        """Returns settings with an address at which a server accepts connections.

        Raises an ImportError if Ray is not installed, an OSError if nothing answers, a ValueError for a bad address.
        """
        if importlib.util.find_spec("ray") is None:
            raise ImportError(f"workers need Ray: {checks.install_command('ray')}")
        if address not in (None, "auto"):
            _check_reachable(address)
        return cls(workers=workers, address=address)

    def run(
        self, build: RunnerFactory, episodes: Sequence[tuple[int, int]], *, capacity: int, num_threads: int
    ) -> Generator[tuple[int, Any], None, None]:
        """Runs episodes (index, seed) on the workers and yields (index, result) as each finishes, until it is closed.

        A worker holds `capacity` episodes at most, and uses `num_threads` processors; `build`, which must be picklable,
        builds its episode runner there. Raises a ClusterError if Ray cannot be used, or workers cannot start or die
        repeatedly, and any exception that an episode raises.
        """
        with self._connected(self.workers * num_threads):
            pool = Pool(build, workers=self.workers, capacity=capacity, num_threads=num_threads)
            with contextlib.closing(pool):
                yield from pool.run(episodes)

    @contextlib.contextmanager
    def _connected(self, num_cpus: int) -> Iterator[None]:
        """Connects to Ray, and disconnects or stops it at the end; uses the connection that the program has, if any."""
        with _environment_defaults():
            import ray

            if ray.is_initialized():
                yield
                return
            settings = {"num_cpus": num_cpus, "include_dashboard": False} if self.address is None else {}
            handler = signal.getsignal(signal.SIGTERM)
            try:
                try:
                    ray.init(self.address or "local", log_to_driver=False, logging_level="ERROR", **settings)
                except (OSError, RuntimeError, ValueError) as error:
                    raise ClusterError(f"cannot use Ray at {self.address or 'this machine'}: {error}") from error
                finally:
                    # Ray replaces it when it is started.
                    if threading.current_thread() is threading.main_thread():
                        signal.signal(signal.SIGTERM, handler)
                yield
            finally:
                ray.shutdown()


def _check_reachable(address: str) -> None:
    """Raises a ValueError for a malformed address, an OSError if nothing answers; Ray itself would try for minutes."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 2**16:
        forms = "HOST:PORT, ray://HOST:PORT or auto"
        raise ValueError(f"{checks.shown(address)} is not a Ray address: it must be {forms}")
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=5.0).close()
    except OSError as error:
        raise OSError(f"no Ray answers at {address}: {error}") from error


@contextlib.contextmanager
def _environment_defaults() -> Iterator[None]:
    added = {name: value for name, value in _RAY_VARIABLES.items() if name not in os.environ}
    os.environ.update(added)
    try:
        yield
    finally:
        for name in added:
            os.environ.pop(name, None)
