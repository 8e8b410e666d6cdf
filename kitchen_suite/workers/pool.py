"""Workers on Ray that share a list of episodes; one that dies is replaced, and what it was playing is played again.

Each worker is an actor that holds a few episodes and gives one as soon as it has ended; it is then given another one.
Which worker plays an episode makes no difference, so that it may be played again by any other.
"""

import collections
import dataclasses
import logging
import pickle
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Protocol

import ray

from kitchen_suite.versions import installed_versions
from kitchen_suite.workers.worker import ClusterError, Worker

# How often in a row a worker and its successors may die without having finished an episode.
_MOST_DEATHS = 3


class Player(Protocol):
    """What plays in a worker."""

    def play(self, more: Sequence[tuple[int, int]]) -> tuple[int, Any]:
        """Takes on more episodes, by number and seed; plays until any of those that it has has ended, and gives it."""


@dataclasses.dataclass(eq=False)
class _Place:
    """A worker, or the next one after it died.

    Attributes:
      actor: Ray's handle.
      hand: seeds, by number, of the episodes that it has been given and that have not ended.
      deaths: since an episode ended.
    """

    actor: Any
    hand: dict[int, int] = dataclasses.field(default_factory=dict)
    deaths: int = 0


class Pool:
    """A number of workers."""

    def __init__(self, build: Callable[[], Player], *, workers: int, capacity: int, num_threads: int) -> None:
        """Starts them.

        Args:
          build: makes what plays, in a worker's process; can be pickled.
          workers: how many.
          capacity: how many episodes one may hold.
          num_threads: processors that one takes.
        """
        self._pickled, self._versions = pickle.dumps(build), installed_versions()
        self._capacity = capacity
        self._actor_class = ray.remote(Worker).options(num_cpus=num_threads)
        self._waiting: collections.deque[tuple[int, int]] = collections.deque()
        # By what they were asked last: the places of all that have not answered.
        self._asked: dict[Any, _Place] = {}
        self._places = [_Place(self._actor_class.remote()) for _ in range(workers)]
        for place in self._places:
            self._ask_to_start(place)

    def close(self) -> None:
        """Ends all workers."""
        for place in self._places:
            ray.kill(place.actor)

    def play(self, episodes: Iterable[tuple[int, int]]) -> Iterator[tuple[int, Any]]:
        """Has episodes, of given numbers and seeds, played; gives each one's number and what came of it when it ended.

        Raises:
          ClusterError: workers cannot start, or die again and again.
          Exception: what playing an episode raised.
        """
        self._waiting.extend(episodes)
        self._hand_out()
        while self._waiting or any(place.hand for place in self._places):
            (answer,), _ = ray.wait([*self._asked])
            ended = self._take(answer)
            self._hand_out()
            if ended:
                yield ended

    def _take(self, answer: Any) -> tuple[int, Any] | None:
        """Takes an answer: an episode that ended, if any."""
        place = self._asked.pop(answer)
        try:
            ended = ray.get(answer)
        except ray.exceptions.RayTaskError as error:
            raise error.cause from error
        except ray.exceptions.RayError as error:
            self._replace(place, error)
            return None
        if ended:
            del place.hand[ended[0]]
            place.deaths = 0
        return ended

    def _replace(self, place: _Place, error: Exception) -> None:
        """Puts a new worker in the place of one that died, or that cannot be reached."""
        place.deaths += 1
        reason = " ".join(str(error).split())
        if place.deaths == _MOST_DEATHS:
            raise ClusterError(f"{_MOST_DEATHS} workers died in a row without finishing an episode: {reason}")
        logging.getLogger(__name__).warning("a worker died; another one plays its %d episodes", len(place.hand))
        ray.kill(place.actor)
        self._waiting.extendleft(reversed(place.hand.items()))
        place.hand.clear()
        place.actor = self._actor_class.remote()
        self._ask_to_start(place)

    def _ask_to_start(self, place: _Place) -> None:
        self._asked[place.actor.start.remote(self._pickled, self._versions)] = place

    def _hand_out(self) -> None:
        """Lets all play on that have answered, with as many episodes as they may hold."""
        busy = set(map(id, self._asked.values()))
        for place in self._places:
            if id(place) in busy:
                continue
            more = [self._waiting.popleft() for _ in range(min(self._capacity - len(place.hand), len(self._waiting)))]
            place.hand.update(more)
            if place.hand:
                self._asked[place.actor.play.remote(more)] = place
