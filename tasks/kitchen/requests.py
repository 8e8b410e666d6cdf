"""Requests of an episode: the tasks and their order, the goal states that are observed, and the state at the start.

An order is an array `(..., n)` int64 over the configured tasks: the place of each requested task, from 0, and -1 for
the other tasks. A state of the kitchen `(30,)` has the positions of the robot's joints, then of the objects'
[rad, m, quaternion].
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks
from kitchen_suite.entities.assets import Array
from kitchen_suite.tasks.goals import GoalSet
from kitchen_suite.tasks.requests import ResetRequests

REQUESTED = "requested_tasks"  # Option of a reset, observation and info.
REQUESTED_ORDER = "requested_order"  # Name of the info on the order of the requested tasks.

GOAL_STATES = "goal_states"  # Option of a reset and observation: states of the kitchen that are wanted.
START_STATE = "start_state"  # Option of a reset: state of the kitchen at the start.

# Options of a reset, named as in OGBench.
TASK_ID = "task_id"  # Number of the only task that is requested, from 1.
RENDER_GOAL = "render_goal"  # Whether infos have a picture of the goal.

_GREATEST = 10.0  # Greatest magnitude of an element of a state of the kitchen in a request.


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


def order_of(indices: Sequence[int] | NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """Returns the order `(count,)` that asks for the tasks of some indices, in their sequence."""
    order = np.full(count, -1)
    order[indices] = np.arange(len(indices))
    return order


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


def in_order(order: NDArray[np.int64]) -> list[int]:
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


def checked_states(value: object, count: int, size: int, name: str) -> Array:
    """Returns `count` states of the kitchen end to end, `(size count,)`, given as rows `(count, size)`."""
    rows = value if isinstance(value, list | tuple | np.ndarray) else ()
    if len(rows) != count:
        raise ValueError(f"{name} must be an array ({count}, {size}), got {checks.shown(value)}")
    states = np.concatenate([checks.vector(row, size, name) for row in rows])
    if np.abs(states).max() > _GREATEST:
        raise ValueError(f"{name} must be positions within {_GREATEST:g} rad or m, got {checks.shown(value)}")
    return states


class Request(NamedTuple):
    """The options of a reset, checked; an option that was not given is None.

    Attributes:
      order: `(n,)`, of the tasks.
      goal_states: `(30 k,)`, end to end.
      start_state: `(30,)`.
    """

    order: NDArray[np.int64] | None = None
    goal_states: Array | None = None
    start_state: Array | None = None


class TaskRequests(ResetRequests):
    """The requests of the episodes of a kitchen task: tasks are drawn at a reset unless its options name them.

    Attributes:
      order: `(n,)`, of the episode that starts; None if every episode asks for all tasks.
      request: options of its reset.
    """

    options = (REQUESTED, GOAL_STATES, START_STATE, TASK_ID, RENDER_GOAL)

    def __init__(self, goals: GoalSet, draw: TaskDraw | None, goal_states: int, state_size: int) -> None:
        """Makes the first episode ask for all tasks.

        Args:
          goals: the `n` configured tasks.
          draw: how many of them an episode asks for; None for all.
          goal_states: number of goal states that are observed.
          state_size: number of elements of a state of the kitchen; 30 with the Franka.
        """
        count = len(goals.tasks)
        self._goals = goals
        self._draw = draw
        self._weights = np.ones(count)
        self._goal_states = goal_states
        self._state_size = state_size
        self._next = Request()
        self.request = Request()
        self.order = None if draw is None else order_of(range(count), count)
        self.drawn_tasks = () if draw is None else goals.tasks

    @property
    def weights(self) -> Array:
        """Weights `(n,)` with which later episodes draw their tasks; see `KitchenTask.task_weights`."""
        return self._weights.copy()

    @weights.setter
    def weights(self, value: ArrayLike | Mapping[str, float]) -> None:
        if self._draw is None:
            raise ValueError("every task is asked in every episode: build the environment with tasks_per_episode")
        weights = checked_weights(value, self._goals.tasks)
        if np.count_nonzero(weights) < self._draw.most:
            raise ValueError(
                f"task_weights must be positive for at least {self._draw.most} tasks, got {checks.shown(value)}"
            )
        self._weights = weights

    def checked(self, options: Mapping[str, Any]) -> Request:
        tasks, goal_states, start, task_id, shown = (options.get(name) for name in self.options)
        if shown is not None:
            checks.boolean(shown, RENDER_GOAL)
        if task_id is not None:
            if tasks is not None:
                raise ValueError(f"{TASK_ID} and {REQUESTED} exclude each other: give one of them")
            number = checks.integer(task_id, TASK_ID, minimum=1, maximum=len(self._goals.tasks))
            tasks = [self._goals.tasks[number - 1]]
        if tasks is not None and self._draw is None:
            name = REQUESTED if task_id is None else TASK_ID
            raise ValueError(
                f"{name} cannot be chosen, as every episode asks for all tasks: build the environment with "
                "tasks_per_episode"
            )
        if goal_states is not None and not self._goal_states:
            raise ValueError(
                f"{GOAL_STATES} cannot be chosen, as none is observed: build the environment with goal_states, their "
                "number"
            )
        count, size = self._goal_states, self._state_size
        return Request(
            order=None if tasks is None else requested_order(tasks, self._goals.tasks),
            goal_states=None if goal_states is None else checked_states(goal_states, count, size, GOAL_STATES),
            start_state=None if start is None else checked_states([start], 1, size, START_STATE),
        )

    def follow(self, request: Request) -> None:
        self._next = request

    def draw(self, random_state: np.random.RandomState) -> None:
        self.request, self._next = self._next, Request()
        if self._draw is not None:
            drawn = self._draw.draw(random_state, self._weights)
            self.order = drawn if self.request.order is None else self.request.order

    def recorded(self, arrays: Mapping[str, NDArray]) -> dict[str, Any]:
        orders = arrays.get(f"info/{REQUESTED_ORDER}")
        if orders is None or self._draw is None:
            return {}
        order = checked_order(orders[0], len(self._goals.tasks), f"recorded {REQUESTED_ORDER}")
        return {REQUESTED: self.tasks_in(order)}

    @property
    def tasks(self) -> list[str]:
        """The tasks that the episode that starts asks for."""
        return self.tasks_in(self.order)

    def tasks_in(self, order: NDArray[np.int64] | None) -> list[str]:
        """Returns the tasks that an order `(n,)` asks for; all for None."""
        return [self._goals.tasks[index] for index in self._indices(order)]

    def instructions_in(self, order: NDArray[np.int64] | None) -> tuple[str, ...]:
        """Returns the instructions of the tasks that an order `(n,)` asks for; those of all for None."""
        return self._goals.instructions(self._indices(order))

    def _indices(self, order: NDArray[np.int64] | None) -> list[int]:
        return [*range(len(self._goals.tasks))] if order is None else in_order(order)

    def saved(self) -> dict[str, NDArray]:
        """Returns what the task's state holds for draws of later episodes."""
        return {} if self._draw is None else {"task_weights": self.weights}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Sets what `saved` returned, after checking the order of the present episode."""
        if self._draw is not None:
            checked_order(state["requested_order"], len(self._goals.tasks), "state's requested_order")
            self.weights = state["task_weights"]
