"""Orders: which of its tasks an episode asks for, and in what sequence.

An order is an array `(..., n)` int64 over the tasks that an episode may ask for: the place of each requested task, from
0, and -1 for the other tasks.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from kitchen_suite import checks
from kitchen_suite.types import Array

# Name of an option of a reset, of an observation and of an info.
REQUESTED = "requested_tasks"

# Name of the info on the order of the requested tasks.
REQUESTED_ORDER = "requested_order"


@dataclasses.dataclass(frozen=True, kw_only=True)
class TaskDraw:
    """How many of the configured tasks an episode asks for.

    Attributes:
      least: least number.
      most: greatest number.
    """

    least: int
    most: int

    @classmethod
    def make(cls, value: object, count: int) -> Self:
        """Makes the draw of some of `count` tasks; `value` is a number, or a pair of the least and greatest number."""
        name, given = "tasks_per_episode", checks.shown(value)
        bounds = value if isinstance(value, list | tuple) else (value, value)
        if len(bounds) != 2:
            raise ValueError(f"{name} must be a number, or a pair of the least and greatest number, got {given}")
        least, most = (checks.integer(bound, name, minimum=1) for bound in bounds)
        if least > most:
            raise ValueError(f"{name} must be a pair of the least and greatest number, got {given}")
        if most > count:
            raise ValueError(f"{name} is {given}, but there are {count} tasks_to_complete")
        return cls(least=least, most=most)

    def draw(self, random_state: np.random.RandomState, weights: Array) -> NDArray[np.int64]:
        """Draws an order `(n,)` from `2 n + 1` numbers of U(0, 1), whatever the weights.

        Tasks are drawn one after the other without replacement, each with a probability proportional to its weight
        among those that remain. Every order of them is equally likely.

        Args:
          random_state: that is drawn from.
          weights: `(n,)`, non-negative; at least `most` of them positive.
        """
        first, *numbers = random_state.random_sample(2 * weights.size + 1)
        choice, place = np.reshape(numbers, (2, weights.size))
        with np.errstate(divide="ignore", invalid="ignore"):
            # The least of exponential variables with these rates is the first one drawn, the next the second.
            times = np.log(-np.log1p(-choice)) - np.log(weights)
        chosen = np.argsort(times, kind="stable")[: self.least + int(first * (self.most - self.least + 1))]
        return order_of(chosen[np.argsort(place[chosen], kind="stable")], weights.size)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Ordering:
    """Which of its tasks an episode asks for, and in what sequence they count.

    Attributes:
      draw: how many of the tasks an episode asks for; None if every episode asks for all, which observations and infos
        then do not mention.
      in_turn: whether the next of them is requested only once the one before has been completed.
      in_order: whether a task counts only once those before it have been completed.
    """

    draw: TaskDraw | None
    in_turn: bool
    in_order: bool

    @classmethod
    def make(cls, *, tasks_per_episode: object, tasks_in_turn: bool, tasks_in_order: bool, count: int) -> Self:
        """Returns the ordering of `count` tasks; the other arguments are those of `KitchenTask`."""
        if checks.boolean(tasks_in_turn, "tasks_in_turn") and tasks_per_episode is None:
            raise ValueError("tasks_in_turn=True needs tasks_per_episode, the number of tasks that an episode asks for")
        if checks.boolean(tasks_in_order, "tasks_in_order") and tasks_per_episode is not None:
            raise ValueError("tasks_in_order=True and tasks_per_episode exclude each other: give one of them")
        draw = None if tasks_per_episode is None else TaskDraw.make(tasks_per_episode, count)
        return cls(draw=draw, in_turn=tasks_in_turn, in_order=tasks_in_order)


def order_of(indices: Sequence[int] | NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """Returns the order `(count,)` that asks for the tasks of some indices, in their sequence."""
    order = np.full(count, -1)
    order[indices] = np.arange(len(indices))
    return order


def order_info(order: NDArray[np.int64]) -> dict[str, NDArray]:
    """Returns the infos on the tasks that an order `(..., n)` asks for: fresh arrays `(..., n)`."""
    return {f"{REQUESTED}_mask": order >= 0, REQUESTED_ORDER: order.copy()}


def next_in_turn(order: NDArray[np.int64], completed: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Returns which task `(..., n)` of an order is next: the first that is not `completed`; the last one if all are."""
    places = np.where((order >= 0) & ~completed, order, order.shape[-1])
    place: NDArray[np.int64] = np.minimum(places.min(axis=-1), order.max(axis=-1))
    return order == place[..., np.newaxis]


def counted_in_order(within: NDArray[np.bool_], completed: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Returns which tasks `(..., n)` within their thresholds count where tasks count in their sequence.

    A task counts if all tasks before it have been `completed`, or are within theirs now.
    """
    count = within.shape[-1]
    places = np.arange(count)
    missing = np.where(within | completed, count, places).min(axis=-1, initial=count)
    return within & (places < missing[..., np.newaxis])


def sequence_of(order: NDArray[np.int64]) -> list[int]:
    """Returns the indices of the tasks that an order `(n,)` asks for, in their sequence."""
    return [int(index) for index in np.argsort(order, kind="stable") if order[index] >= 0]


def checked_order(order: NDArray[np.int64], count: int, name: str) -> NDArray[np.int64]:
    """Returns an order of `count` tasks, or raises a ValueError if it is none; `name` is for messages."""
    places = np.sort(order[order >= 0]) if order.shape == (count,) else np.zeros(0)
    if not places.size or not np.array_equal(places, np.arange(places.size)) or order.min() < -1:
        raise ValueError(
            f"{name} must hold the place of each of {count} tasks, from 0, or -1, got {checks.shown(order)}"
        )
    return order


def requested_order(value: object, tasks: Sequence[str]) -> NDArray[np.int64]:
    """Returns the order that a request asks for.

    Args:
      value: names of tasks, in the order requested; or a mask `(n,)` of bools, with the configured order.
      tasks: the `n` configured tasks.
    """
    if isinstance(value, np.ndarray):
        if value.dtype != bool:
            raise TypeError(f"{REQUESTED} must be a list of tasks, or a mask of bools, got {checks.shown(value)}")
        if value.shape != (len(tasks),) or not value.any():
            raise ValueError(
                f"{REQUESTED} needs a mask ({len(tasks)},) of at least one task, got {checks.shown(value)}"
            )
        return order_of(np.flatnonzero(value), len(tasks))
    names = [checks.choice(name, tasks, REQUESTED) for name in checks.unique_names(value, REQUESTED)]
    return order_of([tasks.index(name) for name in names], len(tasks))


def checked_weights(value: object, tasks: Sequence[str]) -> Array:
    """Returns the weights `(n,)` of tasks, given by task, where those left out have 1, or as a vector."""
    name = "task_weights"
    if isinstance(value, Mapping):
        by_task: dict[str, Any] = {checks.choice(task, tasks, f"{name} of task"): each for task, each in value.items()}
        return np.array([checks.number(by_task.get(task, 1.0), f"{name} of {task!r}") for task in tasks])
    weights = checks.vector(value, len(tasks), name).copy()  # type: ignore[arg-type]
    if (weights < 0.0).any():
        raise ValueError(f"{name} must be non-negative, got {checks.shown(value)}")
    return weights
