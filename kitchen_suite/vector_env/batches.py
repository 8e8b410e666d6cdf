"""Batches of simulations of one model, or of several side by side."""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import collections
import concurrent.futures
import ctypes
import functools
import os
import weakref
from collections.abc import Callable, Sequence
from typing import Any, Literal

import mujoco
import numpy as np
import tree
from dm_control import mjcf
from mujoco.batch import Batch
from numpy.typing import NDArray

from kitchen_suite.tasks.pushes import Push, Pusher
from kitchen_suite.tasks.simulation import BatchSimulation, Columns, Simulation

_batches: "weakref.WeakSet[Batch]" = weakref.WeakSet()


def make_batch(model: mujoco.MjModel, count: int, threads: int) -> Batch:
    """Returns a batch that stays alive in every process forked from now on.

    Its destructor joins its threads, which do not survive a fork: a forked process that destroyed it would never end.
    """
    batch = Batch(model, count, threads, persistent=True)
    _batches.add(batch)
    return batch


def _keep_batches() -> None:
    for batch in _batches:
        # Module globals are destroyed when the interpreter ends, so no Python reference lasts for ever.
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(batch))


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_keep_batches)


class JoinedBatch:
    """Simulations of several models, with the methods and attributes of one batch.

    Attributes:
      batches: the batches, one for each model.
      rows: indices `(k,)` of the simulations of each.
      state: live rows of the states, whose sizes depend on the model.
    """

    def __init__(self, models: Sequence[mujoco.MjModel], threads: int) -> None:
        """Builds the batches.

        Args:
          models: model of each simulation.
          threads: number of threads that step them, including the calling one; each takes the next batch that waits.
        """
        distinct = {id(model): model for model in models}
        numbers = np.array([id(model) for model in models])
        self.rows = [np.flatnonzero(numbers == number) for number in distinct]
        parts = zip(distinct.values(), self.rows, strict=True)
        self.batches = [make_batch(model, rows.size, max(1, threads // len(distinct))) for model, rows in parts]
        self._others = min(threads, len(distinct)) - 1
        self._pool = concurrent.futures.ThreadPoolExecutor(max(self._others, 1))
        self._order = np.argsort(np.concatenate(self.rows))
        self.state = self._split([batch.state for batch in self.batches])

    def join(self, parts: Sequence[NDArray]) -> NDArray:
        """Returns the rows `(n, ...)` of all simulations in a fresh array, given those of each model."""
        return np.concatenate(parts).take(self._order, axis=0)

    def _split(self, parts: Sequence[NDArray]) -> list[NDArray]:
        """Returns views of the rows of all simulations, given those of each model."""
        rows = [row for part in parts for row in part]
        return [rows[place] for place in self._order.tolist()]

    @property
    def warning(self) -> NDArray:
        """Warnings of MuJoCo, as those of a batch."""
        return self.join([batch.warning for batch in self.batches])

    def expand(self, name: str) -> "JoinedRows":
        """Returns live rows of a field of the model, which each simulation then has for itself."""
        arrays = [batch.expand(name) for batch in self.batches]
        places = [(array, row) for array in arrays for row in range(len(array))]
        return JoinedRows([places[place] for place in self._order.tolist()])

    def call(self, method: Callable[..., None], ids: NDArray | None, *arguments: Any, **options: Any) -> None:
        """Calls a method of each batch for its simulations among some, all if `ids` is None."""
        chosen = np.full(self._order.size, ids is None)
        if ids is not None:
            chosen[ids] = True
        masks = [(batch, chosen[rows]) for batch, rows in zip(self.batches, self.rows, strict=True)]
        calls = [(batch, mask) for batch, mask in masks if mask.any()]
        waiting, others = iter(calls), list[concurrent.futures.Future[None]]()

        def work() -> None:
            for batch, mask in waiting:
                method(batch, None if mask.all() else mask, *arguments, **options)

        try:
            for _ in range(min(self._others, len(calls) - 1)):
                others.append(self._pool.submit(work))
            work()
        finally:
            # After an error or an interrupt nobody begins another call.
            collections.deque(waiting, maxlen=0)
            concurrent.futures.wait(others)
        for other in others:
            other.result()

    reset = functools.partialmethod(call, Batch.reset)
    forward = functools.partialmethod(call, Batch.forward)
    step = functools.partialmethod(call, Batch.step)


class StateCopies:
    """Copies of the states of all simulations of a batch, to which they can return."""

    def __init__(self, batch: Batch | JoinedBatch) -> None:
        """Copies the present states."""
        if isinstance(batch, JoinedBatch):
            self._present, self._rows = [part.state for part in batch.batches], batch.rows
        else:
            self._present, self._rows = [batch.state], [np.arange(batch.nsim)]
        self._copies = [states.copy() for states in self._present]

    def update(self) -> None:
        """Copies the present states."""
        for copy, states in zip(self._copies, self._present, strict=True):
            np.copyto(copy, states)

    def restore(self, mask: NDArray[np.bool_]) -> None:
        """Sets the states of the simulations where a mask `(n,)` is True to their copies."""
        for states, copy, rows in zip(self._present, self._copies, self._rows, strict=True):
            states[mask[rows]] = copy[mask[rows]]


class JoinedRows:
    """Rows of several arrays as those of one."""

    def __init__(self, places: Sequence[tuple[NDArray, int]]) -> None:
        """Stores the array and index of each row."""
        self._places = places

    def __getitem__(self, i: int) -> Any:
        array, row = self._places[i]
        return array[row]

    def __setitem__(self, i: int, value: Any) -> None:
        array, row = self._places[i]
        array[row] = value


class JoinedSimulation:
    """The simulations of a joined batch, in whose models a column means the same; all that is read is a copy."""

    def __init__(self, batch: JoinedBatch, physics: Sequence[mjcf.Physics]) -> None:
        """Stores a batch, and a physics of each of its models, which know the names in it."""
        self.batch = batch
        self.parts = [BatchSimulation(each, one) for each, one in zip(batch.batches, physics, strict=True)]

    def read(self, field: str, columns: Columns, order: Literal["C", "F"] = "C") -> NDArray[np.float64]:
        return self.batch.join([part.read(field, columns) for part in self.parts])

    def write(self, field: str, columns: Columns, values: NDArray[np.float64]) -> None:
        for part, rows in zip(self.parts, self.batch.rows, strict=True):
            part.write(field, columns, values[rows])

    def named(self, field: str, name: str) -> NDArray[np.float64]:
        return self.batch.join([part.named(field, name) for part in self.parts])

    def evaluate(self) -> None:
        """Does nothing, as of a batch."""


class JoinedSensors:
    """The sensors of several models, each of which has columns of its own.

    Attributes:
      stage: greatest of theirs.
    """

    def __init__(self, sensors: Sequence[Any]) -> None:
        """Takes the sensors of each model of a `JoinedSimulation`, in its order."""
        self._sensors = sensors
        self.stage = max((each.stage for each in sensors), key=int)

    def read(self, simulation: JoinedSimulation) -> Any:
        """Returns the values of all simulations, in fresh arrays `(n, ...)`."""
        readings = [each.read(part) for each, part in zip(self._sensors, simulation.parts, strict=True)]
        arrays = zip(*(tree.flatten(reading) for reading in readings), strict=True)
        return tree.unflatten_as(readings[0], [simulation.batch.join(parts) for parts in arrays])


class JoinedPusher:
    """The pushers of several models, in each of which other joints belong to the tasks."""

    def __init__(self, pushers: Sequence[Pusher]) -> None:
        """Takes the pusher of each model of a `JoinedSimulation`, in its order."""
        self._pushers = pushers

    def push(self, simulation: JoinedSimulation, push: Push, state: Any) -> Push:
        """Makes the pushes that are due; see `Pusher.push`."""
        if push.is_due.any():
            complete = self._pushers[0].complete(state)
            for pusher, part, rows in zip(self._pushers, simulation.parts, simulation.batch.rows, strict=True):
                pusher.move(part, Push._make(each[rows] for each in push), complete[rows])
        return push.stepped()


def make_simulations(physics: Sequence[mjcf.Physics], threads: int) -> tuple[Any, Simulation]:
    """Returns a batch with a simulation of the model of each physics, joined if these are several models."""
    models = [each.model.ptr for each in physics]
    if all(model is models[0] for model in models):
        batch = make_batch(models[0], len(models), threads)
        return batch, BatchSimulation(batch, physics[0])
    joined = JoinedBatch(models, threads)
    return joined, JoinedSimulation(joined, [*{id(each.model.ptr): each for each in physics}.values()])
