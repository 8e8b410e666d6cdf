"""A pool of Ray workers that share a queue of episodes.

Each worker is an actor that holds a few episodes and returns one as soon as it has ended; it is then given another. An
episode does not depend on the worker that runs it, so the episodes of a worker that dies are run again by others.

Nothing here imports dm_control: a runner's modules, which do, are imported by unpickling it.
"""

import collections
import dataclasses
import importlib
import logging
import pickle
import platform
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, Protocol

from kitchen_suite.versions import installed_versions

_MAX_DEATHS = 3  # Deaths in a row in one slot, without a finished episode, after which the pool fails.
_PATIENCE = 10.0  # Time after which a pool without a single worker says that it waits [s].

_LOG = logging.getLogger(__name__)


class ClusterError(OSError):
    """Ray cannot be reached or used, or its workers fail repeatedly."""


class EpisodeRunner(Protocol):
    """Runs episodes in a worker process, one or several at a time."""

    def run(self, more: Sequence[tuple[int, int]]) -> tuple[int, Any]:
        """Runs until an episode, of `more` (index, seed) or given before, has ended; returns its index and result."""


RunnerFactory = Callable[[], EpisodeRunner]


class Worker:
    """A Ray actor that runs episodes."""

    def start(self, pickled: bytes, versions: Mapping[str, str]) -> None:
        """Builds the episode runner of a pickled `RunnerFactory`.

        Raises a ClusterError if it cannot be built on this machine, or versions differ from those of the main process.
        """
        try:
            here = installed_versions()
            odd = [f"{name} {here[name]} instead of {there}" for name, there in versions.items() if here[name] != there]
            if odd:
                raise ValueError(f"it has {', '.join(odd)}, so its episodes would differ")
            self._runner: EpisodeRunner = pickle.loads(pickled)()
        except (ImportError, OSError, TypeError, ValueError) as error:
            raise ClusterError(f"a worker on {platform.node()} cannot start: {error}") from error

    def run(self, more: Sequence[tuple[int, int]]) -> tuple[int, Any]:
        return self._runner.run(more)


@dataclasses.dataclass(eq=False)
class _WorkerSlot:
    """A worker, replaced in the same slot if it dies."""

    actor: Any
    in_flight: dict[int, int] = dataclasses.field(default_factory=dict)  # Seed by index, of the episodes that it holds.
    deaths: int = 0  # Since an episode ended.
    busy: bool = False  # Whether a call is pending.


class Pool:
    """A fixed number of workers."""

    def __init__(self, build: RunnerFactory, *, workers: int, capacity: int, num_threads: int) -> None:
        """Starts the workers; arguments as in `RaySettings.run`."""
        self._ray = importlib.import_module("ray")
        self._start_arguments = pickle.dumps(build), installed_versions()
        self._capacity, self._num_threads = capacity, num_threads
        self._actor_class = self._ray.remote(Worker).options(num_cpus=num_threads)
        self._queue: collections.deque[tuple[int, int]] = collections.deque()
        self._pending_calls: dict[Any, _WorkerSlot] = {}
        self._slots = [_WorkerSlot(self._actor_class.remote()) for _ in range(workers)]
        for slot in self._slots:
            self._start_worker(slot)

    def close(self) -> None:
        for slot in self._slots:
            self._ray.kill(slot.actor)

    def run(self, episodes: Iterable[tuple[int, int]]) -> Iterator[tuple[int, Any]]:
        self._queue.extend(episodes)
        self._assign_episodes()
        self._wait_for_room()
        while self._queue or any(slot.in_flight for slot in self._slots):
            (call,), _ = self._ray.wait([*self._pending_calls])
            ended = self._receive(call)
            self._assign_episodes()
            if ended:
                yield ended

    def _wait_for_room(self) -> None:
        """Waits until a worker has its processors; warns if that takes long, since others may use the cluster."""
        placed = [slot.actor.__ray_ready__.remote() for slot in self._slots]
        ready, _ = self._ray.wait(placed, timeout=_PATIENCE)
        if not ready:
            machines = [node["Resources"].get("CPU", 0) for node in self._ray.nodes() if node["Alive"]]
            free = self._ray.available_resources().get("CPU", 0)
            _LOG.warning(waiting_line(self._num_threads, free=free, machines=machines))

    def _receive(self, call: Any) -> tuple[int, Any] | None:
        """Receives the result of a call: index and result of the episode that ended, if any."""
        slot = self._pending_calls.pop(call)
        slot.busy = False
        try:
            ended = self._ray.get(call)
        except self._ray.exceptions.RayTaskError as error:
            raise error.cause from error
        except self._ray.exceptions.RayError as error:
            self._replace_worker(slot, error)
            return None
        if ended:
            index, _ = ended
            del slot.in_flight[index]
            slot.deaths = 0
        return ended

    def _replace_worker(self, slot: _WorkerSlot, error: Exception) -> None:
        """Starts a new worker instead of one that died or cannot be reached, and returns its episodes to the queue."""
        slot.deaths += 1
        if slot.deaths == _MAX_DEATHS:
            reason = " ".join(str(error).split())
            raise ClusterError(f"{_MAX_DEATHS} workers died in a row without finishing an episode: {reason}")
        _LOG.warning("a worker died; its %d episodes are run again", len(slot.in_flight))
        self._ray.kill(slot.actor)
        self._queue.extendleft(reversed(slot.in_flight.items()))
        slot.in_flight.clear()
        slot.actor = self._actor_class.remote()
        self._start_worker(slot)

    def _start_worker(self, slot: _WorkerSlot) -> None:
        self._add_call(slot, slot.actor.start.remote(*self._start_arguments))

    def _add_call(self, slot: _WorkerSlot, call: Any) -> None:
        self._pending_calls[call] = slot
        slot.busy = True

    def _assign_episodes(self) -> None:
        """Lets every idle worker continue, with as many episodes as it may hold."""
        for slot in self._slots:
            if slot.busy:
                continue
            count = min(self._capacity - len(slot.in_flight), len(self._queue))
            more = [self._queue.popleft() for _ in range(count)]
            slot.in_flight.update(more)
            if slot.in_flight:
                self._add_call(slot, slot.actor.run.remote(more))


def waiting_line(num_threads: int, *, free: float, machines: Sequence[float]) -> str:
    """Returns why no worker has started yet, by processors: those that one needs, the free ones, and each machine's."""
    line, largest = f"waiting for processors: a worker needs {num_threads}", max(machines, default=0)
    if num_threads <= largest:
        return f"{line}, {free:g} of the cluster's are free"
    # A cluster that grows may yet add a larger one.
    return f"{line}, but its largest machine has {largest:g}: give a smaller --num_threads, or add one"
