"""Traces of episodes: actions, from which an episode can be played again, and digests of all its numbers.

The numbers of a control step are its reward, 0 at a reset, and the observation without pictures: the observables in
the order of the suite's own environment. A digest is the SHA-256 of the numbers of an episode as little-endian float64,
step after step from the reset; a check is the first two bytes, little-endian, of this SHA-256 as far as it has come.
After a control step in which the physics diverged, all numbers are NaN.

Files hold the traces of the `n` episodes of a condition, which make `t` control steps together and have actions of `k`
and observations of `m` numbers, in five arrays:
  `steps`: `(n,)` int64, control steps of each episode.
  `actions`: `(4, k, t)` uint8, the four bytes of each action's number, a little-endian float32.
  `checks`: `(t + n,)` uint16, for the reset and for each control step.
  `digests`: `(n, 32)` uint8, of each episode.
  `last`: `(n, 1 + m)` float32, numbers after the last control step.
"""

import dataclasses
import hashlib
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.episodes.play import BatchStep, Controller, VectorEpisode
from kitchen_suite.vector_env.base import SuiteVectorEnv

ARRAYS = ("steps", "actions", "checks", "digests", "last")
"""Names of the arrays of a condition's traces."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Trace:
    """The actions `(T, k)` of an episode, and of its numbers checks `(T + 1,)`, digest `(32,)` and last ones `(m,)`."""

    actions: NDArray[np.float32]
    checks: NDArray[np.uint16]
    digest: NDArray[np.uint8]
    last: NDArray[np.float32]

    def first_difference(self, other: "Trace") -> int | None:
        """Returns the first control step at which the numbers differ, 0 for the reset; None if all are equal."""
        count = min(self.checks.size, other.checks.size)
        differing = np.flatnonzero(self.checks[:count] != other.checks[:count])
        if differing.size:
            return int(differing[0])
        same_end = np.array_equal(self.digest, other.digest) and np.array_equal(self.last, other.last, equal_nan=True)
        # One in 65,536 checks is equal by chance, though the numbers differ.
        return None if same_end and self.checks.size == other.checks.size else count - 1

    def greatest_difference(self, other: "Trace") -> float:
        """Returns the greatest difference of the numbers after the last control steps, as float32."""
        if self.last.shape != other.last.shape:
            return np.inf
        differences = np.abs(self.last.astype(np.float64) - other.last)
        differences[np.isnan(self.last) & np.isnan(other.last)] = 0.0
        return float(np.nan_to_num(differences, nan=np.inf).max(initial=0.0))


class TraceRecorder:
    """Acts as another controller does, and keeps the traces of its episodes, and how long the answers took."""

    def __init__(self, environments: SuiteVectorEnv, controller: Controller) -> None:
        self._environments, self._controller = environments, controller
        # Of the episode in progress in each environment.
        self._numbers: dict[int, list[NDArray[np.float64]]] = {}
        self._actions: dict[int, list[NDArray]] = {}
        self._seconds: dict[int, list[float]] = {}

    @property
    def is_batched(self) -> bool:
        return self._controller.is_batched

    @property
    def labels(self) -> Mapping[str, NDArray]:
        return self._controller.labels

    def start(self, i: int, seed: int, options: Mapping[str, Any]) -> None:
        self._controller.start(i, seed, options)
        self._numbers[i], self._actions[i], self._seconds[i] = [], [], []

    def act(self, step: BatchStep) -> NDArray:
        playing = np.flatnonzero(step.is_playing).tolist()
        numbers = self._present(np.where(step.is_first, 0.0, step.rewards))
        started = time.perf_counter()
        actions = self._controller.act(step)
        seconds = time.perf_counter() - started
        if not self.is_batched:
            seconds /= len(playing)
        for i in playing:
            self._seconds[i].append(seconds)
            self._numbers[i].append(numbers[i])
            self._actions[i].append(actions[i].astype("<f4"))
        return actions

    def trace(self, episode: VectorEpisode) -> Trace:
        numbers, hashed, words = self._numbers[episode.i], hashlib.sha256(), b""
        if episode.diverged:
            numbers.append(np.full_like(numbers[-1], np.nan))
        else:
            numbers.append(self._present(np.full(self._environments.num_envs, episode.rewards[-1]))[episode.i])
        for each in numbers:
            hashed.update(each.astype("<f8").tobytes())
            words += hashed.digest()[:2]
        with np.errstate(over="ignore"):
            last = numbers[-1].astype("<f4")
        actions, digest = np.array(self._actions[episode.i]), np.frombuffer(hashed.digest(), np.uint8)
        return Trace(actions=actions, checks=np.frombuffer(words, "<u2"), digest=digest, last=last)

    def answer_seconds(self, episode: VectorEpisode) -> NDArray[np.float64]:
        """Returns how long the policy's answer of each control step took `(T,)` [s], of a batch that of all rows."""
        return np.array(self._seconds[episode.i])

    def observations(self, episode: VectorEpisode) -> NDArray[np.float64]:
        """Returns the observed numbers `(T + 1, m)` of an episode whose trace has been taken."""
        return np.stack(self._numbers[episode.i])[:, 1:]

    def _present(self, rewards: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the numbers `(n, 1 + m)` of the present step."""
        parts = [rewards, *self._environments.present_numbers.values()]
        return np.concatenate([part.reshape(len(rewards), -1) for part in parts], axis=1, dtype=np.float64)


class ActionReplay:
    """Acts by recorded actions; where an episode goes on after its last one, by zeros."""

    is_batched = False

    def __init__(self, actions: Mapping[int, NDArray]) -> None:
        """Takes the actions `(T, k)` of the episodes by their seeds."""
        self._by_seed = actions
        self._size = next(iter(actions.values())).shape[1:]
        self._remaining: dict[int, Iterator[NDArray]] = {}
        self.labels: Mapping[str, NDArray] = {}

    def start(self, i: int, seed: int, options: Mapping[str, Any]) -> None:
        self._remaining[i] = iter(self._by_seed[seed])

    def act(self, step: BatchStep) -> NDArray:
        actions = np.zeros((step.rewards.size, *self._size), np.float32)
        for i in np.flatnonzero(step.is_playing).tolist():
            actions[i] = next(self._remaining[i], 0.0)
        return actions


def stacked(traces: Sequence[Trace]) -> dict[str, NDArray]:
    """Returns the arrays of the traces of a condition's episodes, by the names of `ARRAYS`."""
    return {
        "steps": np.array([len(trace.actions) for trace in traces]),
        "actions": _planes(np.concatenate([trace.actions for trace in traces])),
        "checks": np.concatenate([trace.checks for trace in traces]),
        "digests": np.stack([trace.digest for trace in traces]),
        "last": np.stack([trace.last for trace in traces]),
    }


def unstacked(arrays: Mapping[str, NDArray], count: int) -> list[Trace]:
    """Returns the traces of the `count` episodes of which `stacked` made arrays; raises a ValueError for others."""
    steps = arrays["steps"]
    actions = _from_planes(arrays["actions"])
    words = arrays["checks"]
    digests = arrays["digests"]
    last = arrays["last"]
    expected = {
        "steps": (steps, np.int64, (count,)),
        "checks": (words, np.uint16, (len(actions) + count,)),
        "digests": (digests, np.uint8, (count, hashlib.sha256().digest_size)),
        "last": (last, np.float32, (count, *last.shape[-1:])),
    }
    for part, (array, dtype, shape) in expected.items():
        if array.dtype != dtype or array.shape != shape:
            raise ValueError(f"{part} has type {array.dtype} and shape {array.shape}, not {dtype} and {shape}")
    if steps.min() < 1 or steps.sum() != len(actions):
        raise ValueError(f"steps do not fit {len(actions)} actions")
    stops = np.cumsum(steps)[:-1]
    rows = zip(np.split(actions, stops), np.split(words, stops + np.arange(1, count)), digests, last, strict=True)
    return [Trace(actions=a, checks=c, digest=d, last=e) for a, c, d, e in rows]


def _planes(actions: NDArray) -> NDArray[np.uint8]:
    """Returns the bytes `(4, k, T)` of actions `(T, k)`; those of one place in the numbers compress well together."""
    contents = np.ascontiguousarray(actions, "<f4").view(np.uint8)
    return np.ascontiguousarray(contents.reshape(*actions.shape, 4).transpose(2, 1, 0))


def _from_planes(planes: NDArray) -> NDArray[np.float32]:
    """Returns the actions `(T, k)` of which `_planes` made bytes; raises a ValueError for another array."""
    if planes.dtype != np.uint8 or planes.ndim != 3 or planes.shape[0] != 4:
        raise ValueError(f"actions of shape {planes.shape} and type {planes.dtype}")
    return np.ascontiguousarray(planes.transpose(2, 1, 0)).view("<f4")[..., 0]
