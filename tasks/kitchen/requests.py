"""Requests of an episode in the kitchen: the tasks and their order, the goal states, and the state at the start.

A state of the kitchen `(30,)` has the positions of the robot's joints, then of the objects' [rad, m, quaternion].
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks
from kitchen_suite.tasks.goals import GoalSet
from kitchen_suite.tasks.orders import (
    REQUESTED,
    REQUESTED_ORDER,
    TaskDraw,
    checked_order,
    checked_weights,
    order_of,
    requested_order,
    sequence_of,
)
from kitchen_suite.tasks.requests import Requests
from kitchen_suite.types import Array

GOAL_STATES = "goal_states"  # Option of a reset and observation: states of the kitchen that are wanted.
START_STATE = "start_state"  # Option of a reset: state of the kitchen at the start.

# Options of a reset, named as in OGBench.
TASK_ID = "task_id"  # Number of the only task that is requested, from 1.
RENDER_GOAL = "render_goal"  # Whether infos have a picture of the goal.

_GREATEST = 10.0  # Greatest magnitude of an element of a state of the kitchen in a request.


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


class TaskRequests(Requests):
    """The requests of the episodes of a kitchen task: tasks are drawn at a reset unless its options name them.

    Attributes:
      order: `(n,)`, of the episode that starts; without draws that of all tasks.
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
        self.request = Request()
        self.order = order_of(range(count), count)
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

    def draw(self, random_state: np.random.RandomState, request: Request | None) -> None:
        self.request = Request() if request is None else request
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

    def tasks_in(self, order: NDArray[np.int64]) -> list[str]:
        """Returns the tasks that an order `(n,)` asks for."""
        return [self._goals.tasks[index] for index in sequence_of(order)]

    def instructions_in(self, order: NDArray[np.int64]) -> tuple[str, ...]:
        """Returns the instructions of the tasks that an order `(n,)` asks for."""
        return self._goals.instructions(sequence_of(order))

    def saved(self) -> dict[str, NDArray]:
        """Returns what the task's state holds for draws of later episodes."""
        return {} if self._draw is None else {"task_weights": self.weights}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Sets what `saved` returned, after checking the order of the present episode."""
        if self._draw is not None:
            checked_order(state["requested_order"], len(self._goals.tasks), "state's requested_order")
            self.weights = state["task_weights"]
