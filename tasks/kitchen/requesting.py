"""Tasks of the kitchen of which each episode asks for some: draws, requests and weights."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kitchen_suite.tasks.base import SuiteTask
from kitchen_suite.tasks.goals import Goal
from kitchen_suite.tasks.instructions import joined
from kitchen_suite.tasks.kitchen.done import may_be_done
from kitchen_suite.tasks.kitchen.mdp import REQUESTED_ORDER, KitchenMDP
from kitchen_suite.tasks.kitchen.requested import (
    REQUESTED,
    checked_order,
    checked_weights,
    in_order,
    order_of,
    requested_order,
)
from kitchen_suite.tasks.kitchen.state import KitchenState


class RequestingTask(SuiteTask):
    """A task of the kitchen's MDP that asks for some of its configured tasks in each episode, or for all of them."""

    reset_options = (REQUESTED,)
    _mdp: KitchenMDP
    _state: KitchenState
    # Order of the episode that starts; `()` if all tasks are asked.
    _start_order: NDArray[np.int64] | tuple[()] = ()
    _requested: NDArray[np.int64] | None = None
    _task_weights: NDArray[np.float64] | None = None

    @property
    def drawn_tasks(self) -> tuple[str, ...]:
        return self._mdp.goals.tasks if self._mdp.task_draw else ()

    @property
    def task_names(self) -> tuple[str, ...]:
        return self._mdp.goals.tasks

    def policy_inputs(self, observation: Mapping[str, NDArray], tasks: Sequence[str]) -> NDArray[np.float64]:
        state, names = super().policy_inputs(observation, tasks), self.task_names
        # The observation of the tasks asked is the last one, or the end of a flat one.
        requested = [*observation.values()][-1][-len(names) :] if self._mdp.task_draw else np.ones(len(names))
        asked = {name for name, is_asked in zip(names, requested > 0.5, strict=True) if is_asked}
        return np.concatenate([state, [float(task in asked) for task in tasks]])

    @property
    def requested_tasks(self) -> list[str]:
        """Tasks that the episode asks for, in the order asked; all in configured order without `tasks_per_episode`."""
        return self.tasks_in(self._state.requested_order)

    def tasks_in(self, order: NDArray[np.int64] | tuple[()]) -> list[str]:
        """Returns the tasks that an order `(n,)` asks for; all for `()`."""
        tasks = self._mdp.goals.tasks
        return [*tasks] if isinstance(order, tuple) else [tasks[index] for index in in_order(order)]

    def instructions_in(self, order: NDArray[np.int64] | tuple[()]) -> tuple[str, ...]:
        """Returns the instructions of the tasks that an order `(n,)` asks for; those of all for `()`."""
        goals = self._mdp.goals
        if isinstance(order, tuple):
            return goals.instructions
        return joined(goals.goals[index].instructions for index in in_order(order))

    @property
    def instructions(self) -> tuple[str, ...]:
        return self.instructions_in(self._mdp.shown_order(self._state) if self._state else ())

    @property
    def task_weights(self) -> NDArray[np.float64]:
        """Weights `(n,)` with which later episodes draw the tasks that they ask for, in configured order; 1 by default.

        May be set to an array, or to numbers by task; tasks left out have the weight 1. The same random numbers are
        drawn, whatever the weights. Part of the task's state.

        Raises:
          TypeError: the weights are no numbers.
          ValueError: the task was built without `tasks_per_episode`, a task is unknown, a weight is negative or not
            finite, or fewer tasks have a positive weight than an episode may ask for.
        """
        return np.ones(len(self._mdp.goals.tasks)) if self._task_weights is None else self._task_weights.copy()

    @task_weights.setter
    def task_weights(self, value: ArrayLike | Mapping[str, float]) -> None:
        draw = self._mdp.task_draw
        if draw is None:
            raise ValueError("every task is asked in every episode: build the environment with tasks_per_episode")
        weights = checked_weights(value, self._mdp.goals.tasks)
        if np.count_nonzero(weights) < draw.most:
            raise ValueError(f"task_weights must be positive for at least {draw.most} tasks, got {weights}")
        self._task_weights = weights

    def reset_request(self, options: Mapping[str, Any]) -> NDArray[np.int64] | None:
        if options.get(REQUESTED) is None:
            return None
        if self._mdp.task_draw is None:
            raise ValueError(
                f"{REQUESTED} cannot be chosen, as every episode asks for all tasks: build the environment with "
                "tasks_per_episode"
            )
        return requested_order(options[REQUESTED], self._mdp.goals.tasks)

    def request_reset(self, request: NDArray[np.int64] | None) -> None:
        self._requested = request

    def recorded_options(self, arrays: Mapping[str, NDArray]) -> dict[str, Any]:
        orders = arrays.get(f"info/{REQUESTED_ORDER}")
        if orders is None or self._mdp.task_draw is None:
            return {}
        order = checked_order(orders[0], len(self._mdp.goals.tasks), f"recorded {REQUESTED_ORDER}")
        return {REQUESTED: self.tasks_in(order)}

    def _observed_requests(self) -> NDArray[np.float64]:
        """Returns the observation `requested_tasks`, `(n,)`."""
        return self._mdp.shown_mask(self._state).astype(np.float64)

    def _may_be_done(self) -> dict[str, Goal]:
        """Returns the goals of the tasks that may be done at the start of the episode that starts."""
        return may_be_done(self.tasks_in(self._start_order))

    def _saved_requests(self) -> dict[str, NDArray]:
        """Returns what the task's state holds for draws of later episodes."""
        return {} if self._mdp.task_draw is None else {"task_weights": self.task_weights}

    def _restore_requests(self, state: Mapping[str, Any]) -> None:
        """Sets what `_saved_requests` returned, after checking the order of the present episode."""
        if self._mdp.task_draw is not None:
            checked_order(state["requested_order"], len(self._mdp.goals.tasks), "state's requested_order")
            self.task_weights = state["task_weights"]

    def _draw_tasks(self, random_state: np.random.RandomState) -> None:
        """Draws the tasks that the episode asks for, or discards the draw for a request."""
        if self._mdp.task_draw is None:
            return
        drawn = self._mdp.task_draw.draw(random_state, self.task_weights)
        self._start_order = drawn if self._requested is None else self._requested
        self._requested = None

    def _initial_state(self, draws: NDArray[np.float64]) -> KitchenState:
        state: KitchenState = super()._initial_state(draws)
        return state if isinstance(self._start_order, tuple) else self._mdp.asked(state, self._start_order)

    def _prepare_requests(self) -> None:
        """Makes the state before the first reset ask for all tasks."""
        if self._mdp.task_draw is not None:
            count = len(self._mdp.goals.tasks)
            self._start_order = order_of(range(count), count)

    def _is_asked(self) -> NDArray[np.bool_]:
        """Returns which tasks `(n,)` the episode that starts asks for."""
        if isinstance(self._start_order, tuple):
            return np.full(len(self._mdp.goals.tasks), True)
        return self._start_order >= 0
