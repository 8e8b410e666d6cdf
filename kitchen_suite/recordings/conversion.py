"""Converts demonstrations of other programs to episodes as the kitchen's environments record them."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.recordings.human_data import OBJECTS, ROBOT, Demonstration
from kitchen_suite.rollouts.episode import EpisodeArrays, EpisodeBuffer
from kitchen_suite.tasks import GOALS, KitchenTask
from kitchen_suite.tasks.kitchen.requested import REQUESTED, in_order, order_of
from kitchen_suite.tasks.kitchen.sensors import KitchenReading
from kitchen_suite.tasks.kitchen.state import KitchenState
from kitchen_suite.tasks.measured import Metrics


def convert(task: KitchenTask, index: int, shown: Demonstration) -> tuple[EpisodeArrays, Metrics, list[str]]:
    """Converts a demonstration to an episode that asks for the tasks that it completes, in the order of completion.

    Rewards, completions and infos are those that the task's MDP computes from the recorded positions.

    Args:
      task: the kitchen's, with `tasks_per_episode`.
      index: number of the episode.
      shown: the demonstration.

    Returns:
      The episode; its metrics, without success where it completes nothing; and the tasks that it completes, in order.
    """
    achieved, mdp = _achieved(task, shown), task.mdp
    order = _completion_order(task, achieved)
    noise, robot = np.zeros(mdp.noise_draws), shown.observations[:, ROBOT]
    readings = [KitchenReading(*rows) for rows in zip(robot, achieved, strict=True)]
    state = mdp.asked(mdp.initial_state(readings[0], noise), order)
    buffer = EpisodeBuffer(_observation(task, state, shown.observations[0]), _info(task, state, 0))
    for step, action in enumerate(shown.actions, start=1):
        reading = readings[step]
        state = mdp.step(state, action=action, target=reading.positions, reading=reading, draws=noise)
        is_last = step == len(shown.actions)
        buffer.add(
            np.asarray(action, np.float32),
            _observation(task, state, shown.observations[step]),
            float(mdp.reward(state)),
            False,
            is_last,
            _info(task, state, step),
        )
    completed = task.tasks_in(order)
    instruction = task.instructions_in(order)[0] if completed else ""
    episode = EpisodeArrays(index=index, seed=None, arrays=buffer.arrays(), instruction=instruction)
    return episode, {**task.metrics(episode.last_info), "success": bool(completed)}, completed


def _achieved(task: KitchenTask, shown: Demonstration) -> NDArray[np.float64]:
    """Returns the achieved goals `(T + 1, k)`: those recorded, or else the positions observed."""
    objects = shown.observations[:, OBJECTS]
    parts = []
    for name in task.task_names:
        goal = GOALS[name]
        parts.append(shown.achieved.get(name, objects[:, task.scene.elements(goal.prop, goal.joints)]))
    return np.concatenate(parts, axis=1)


def _completion_order(task: KitchenTask, achieved: NDArray[np.float64]) -> NDArray[np.int64]:
    """Returns the order `(n,)` in which the tasks are first complete after a step; -1 for those that never are."""
    mdp = task.mdp
    within = mdp.success.within(achieved, mdp.goals.distances(achieved))[1:]
    first = np.where(within.any(axis=0), within.argmax(axis=0), -1)
    return order_of(in_order(first), first.size)


def _observation(task: KitchenTask, state: KitchenState, observed: NDArray[np.float64]) -> dict[str, Any]:
    """Returns the observation as `FrankaKitchen` lays it out."""
    goals = task.mdp.goals
    return {
        "observation": observed,
        "achieved_goal": goals.split(state.achieved),
        "desired_goal": goals.split(goals.desired),
        REQUESTED: task.mdp.shown_mask(state).astype(np.float64),
    }


def _info(task: KitchenTask, state: KitchenState, step: int) -> dict[str, Any]:
    info = task.mdp.info(state)
    return {**info, "is_success": np.array(info["is_success"]), "episode_step": np.array(step)}
