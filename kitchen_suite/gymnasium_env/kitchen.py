"""The kitchen as a Gymnasium environment: FrankaKitchen-v1's contract."""

import contextlib
import io
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks, suite
from kitchen_suite.environment import Environment
from kitchen_suite.gymnasium_env import goal_rewards
from kitchen_suite.gymnasium_env.base import SuiteEnv
from kitchen_suite.gymnasium_env.goal_rewards import EPISODE_COMPLETIONS, STEP_COMPLETIONS, TO_COMPLETE, Goal, Infos
from kitchen_suite.tasks import GOALS
from kitchen_suite.tasks.kitchen.mdp import CONTROL_TIMESTEP, KitchenState

with contextlib.redirect_stderr(io.StringIO()):
    # It prints a notice about environments of its own.
    from gymnasium_robotics.core import GoalEnv

_STATE_KEYS = ("franka/joint_positions", "franka/joint_velocities", "object_positions", "object_velocities")


class FrankaKitchenEnv(SuiteEnv, GoalEnv):
    """FrankaKitchen-v1, keyword for keyword and key for key, over `KitchenTask`.

    Observation: a dict of `observation` (59 numbers, float64; docs/kitchen.md has the table), `achieved_goal` and
      `desired_goal`, each a dict by task, or one array with `goal_format="flat"`.
    Action: nine joint velocities in [-1, 1], float32; float64 actions are used unrounded.
    Info: see `info`.
    """

    metadata = {**SuiteEnv.metadata, "render_fps": 1 / CONTROL_TIMESTEP}

    def __init__(
        self,
        tasks_to_complete: Sequence[str] = tuple(GOALS),
        terminate_on_tasks_completed: bool = True,
        remove_task_when_completed: bool = True,
        object_noise_ratio: float = 0.0005,
        robot_noise_ratio: float = 0.01,
        *,
        velocity_scale: float = 2.0,
        goals: Mapping[str, ArrayLike] | None = None,
        threshold: float = 0.3,
        feedback: str = "observed",
        sleep: bool = False,
        goal_format: str = "dict",
        info_format: str = "lists",
        **settings: Any,
    ) -> None:
        """Builds the environment.

        Args:
          tasks_to_complete: see `KitchenTask`, as for all arguments down to `feedback`.
          terminate_on_tasks_completed: whether the episode terminates once every task has been completed.
          remove_task_when_completed: whether a task pays once, or in every step within its threshold.
          object_noise_ratio: scale of the noise on what is seen of the things.
          robot_noise_ratio: scale of the noise on what is seen of the robot.
          velocity_scale: velocity that a unit of action stands for [rad/s, m/s].
          goals: goals that replace the usual ones, by task.
          threshold: distance from the goal below which a task is complete [rad, m].
          feedback: what velocities are integrated from: `observed`, `true` or `target`.
          sleep: whether things at rest may fall asleep; faster, and nearly but not exactly the original.
          goal_format: `dict` gives goals by task; `flat` lays them end to end in configured order.
          info_format: `lists` gives the original's lists of names and masks beside them; `arrays` gives arrays of fixed
            shape alone, which recorders can stack.
          **settings: `max_episode_steps`, `render_mode`, `width`, `height`, `camera_id`, `camera_name`,
            `default_camera_config`, `max_geom`, `visual_options` and `visuals`; see `SuiteEnv`.

        Raises:
          TypeError: an argument of the wrong type, or an unknown one.
          ValueError: an unknown name, or a number out of range.
        """
        self._goal_format = checks.choice(goal_format, ("dict", "flat"), "goal_format")
        self._info_format = checks.choice(info_format, ("lists", "arrays"), "info_format")
        self._terminates = terminate_on_tasks_completed
        task_options = {
            "tasks_to_complete": tasks_to_complete,
            "terminate_on_tasks_completed": terminate_on_tasks_completed,
            "remove_task_when_completed": remove_task_when_completed,
            "object_noise_ratio": object_noise_ratio,
            "robot_noise_ratio": robot_noise_ratio,
            "velocity_scale": velocity_scale,
            "goals": goals,
            "threshold": threshold,
            "feedback": feedback,
            "sleep": sleep,
        }
        super().__init__(task_options=task_options, **settings)
        self._task = self._environment.task
        self._goals = self._task.mdp.goals
        self.action_space = spaces.Box(-1.0, 1.0, (9,), np.float32)
        self.observation_space = spaces.Dict(
            observation=_unbounded((59,)), achieved_goal=self._goal_space(), desired_goal=self._goal_space()
        )

    def _make_environment(self, task_options: Mapping[str, Any]) -> Environment:
        environment = suite.kitchen(**task_options)
        # Goals are read from the task's state, all at once.
        for key, shown in environment.task.task_observables.items():
            shown.enabled = key in _STATE_KEYS
        return environment

    def _default_camera_config(self) -> dict[str, Any]:
        # The original's.
        return {"distance": 2.2, "azimuth": 70.0, "elevation": -35.0, "lookat": np.array([-0.2, 0.5, 2.0])}

    @property
    def info_format(self) -> str:
        """`lists` or `arrays`."""
        return self._info_format

    def format_goal(self, flat: NDArray) -> dict[str, NDArray] | NDArray:
        """Goals laid end to end, `(..., k)`, in the `goal_format`."""
        return self._goals.split(flat) if self._goal_format == "dict" else flat

    def _get_obs(self, observation: Mapping[str, NDArray]) -> dict[str, Any]:
        return {
            "observation": np.concatenate([observation[key] for key in _STATE_KEYS]),
            "achieved_goal": self.format_goal(self._task.state.achieved.copy()),
            "desired_goal": self.format_goal(self._goals.desired.copy()),
        }

    def _get_info(self) -> dict[str, Any]:
        """Makes the info of the last step or reset.

        With `info_format="lists"`: `tasks_to_complete` and `step_task_completions` in configured order,
        `episode_task_completions` in order of completion. Always, in configured order: the same three as `_mask`s
        `(n,)` bool, `completion_steps` `(n,)` int64 (-1: not yet), `task_distances` `(n,)` float64; and `is_success`
        (all tasks completed) and `episode_step`, which `arrays` gives as arrays of shape `()`.
        """
        task = self._task
        names = {
            TO_COMPLETE: task.tasks_to_complete,
            STEP_COMPLETIONS: task.step_task_completions,
            EPISODE_COMPLETIONS: task.episode_task_completions,
        }
        return {
            **(names if self._info_format == "lists" else {}),
            **progress_arrays(task.state),
            "is_success": self._number(bool(task.progress.all_completed)),
            "episode_step": self._number(self._episode_step),
        }

    def compute_reward(self, achieved_goal: Goal, desired_goal: Goal, info: Infos) -> float | NDArray[np.float64]:
        """Reward of a step that led to `achieved_goal`, from goals and info alone.

        Args:
          achieved_goal: dict by task or flat, with any leading axes.
          desired_goal: likewise.
          info: one dict, or a list of dicts for a batch; without the lists or masks of tasks every task may pay.

        Returns:
          A float, or float64 of the leading axes.

        Raises:
          TypeError: the goals hold no numbers.
          ValueError: a task is missing, or shapes do not fit.
        """
        return self._of_goals(goal_rewards.reward, achieved_goal, desired_goal, info)

    def compute_terminated(self, achieved_goal: Goal, desired_goal: Goal, info: Infos) -> bool | NDArray[np.bool_]:
        """Whether a step that led to `achieved_goal` terminates; arguments, shapes and errors as `compute_reward`."""
        ended = self._of_goals(goal_rewards.terminated, achieved_goal, desired_goal, info)
        return ended if self._terminates else np.zeros_like(ended)[()] if np.ndim(ended) else False

    def compute_truncated(self, achieved_goal: Goal, desired_goal: Goal, info: Infos) -> bool | NDArray[np.bool_]:
        """Whether the step truncates, by the info's `episode_step`; False where `gymnasium.make` counts the steps."""
        limit = math.inf if self.max_episode_steps is None else self.max_episode_steps

        def truncated(achieved: NDArray, desired: NDArray, info: Infos, *rules: Any) -> NDArray[np.bool_]:
            del desired, rules
            infos = goal_rewards.broadcast_infos(info, achieved.shape[:-1])
            steps = [one.get("episode_step", 0) for one in infos.ravel()]
            return np.array(steps).reshape(infos.shape) >= limit

        return self._of_goals(truncated, achieved_goal, desired_goal, info)

    def _number(self, value: int) -> int | NDArray:
        """A single number of the info; where recorders stack it, with a dtype and the shape ()."""
        return np.array(value) if self._info_format == "arrays" else value

    def _of_goals(self, function: Any, achieved_goal: Goal, desired_goal: Goal, info: Infos) -> Any:
        achieved = goal_rewards.flatten(achieved_goal, self._goals, "achieved_goal")
        desired = goal_rewards.flatten(desired_goal, self._goals, "desired_goal")
        value = function(achieved, desired, info, self._goals, self._task.threshold)
        return value if value.ndim else value.item()

    def _goal_space(self) -> spaces.Space:
        if self._goal_format == "flat":
            return _unbounded(self._goals.desired.shape)
        return spaces.Dict({task: _unbounded(goal.shape) for task, goal in self._task.goals.items()})


def progress_arrays(state: KitchenState) -> dict[str, NDArray]:
    """What infos say of the tasks, in fresh arrays `(..., n)` in configured order."""
    progress = state.progress
    return {
        f"{TO_COMPLETE}_mask": progress.remaining.copy(),
        f"{STEP_COMPLETIONS}_mask": progress.completions.copy(),
        f"{EPISODE_COMPLETIONS}_mask": progress.completed,
        "completion_steps": progress.completion_steps.copy(),
        "task_distances": state.distances.copy(),
    }


def _unbounded(shape: tuple[int, ...]) -> spaces.Box:
    return spaces.Box(-np.inf, np.inf, shape, np.float64)
