"""The kitchen as a Gymnasium environment with the interface of FrankaKitchen-v1."""

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
from kitchen_suite.gymnasium_env import observations
from kitchen_suite.gymnasium_env.base import VARIATION_SPLIT, SuiteEnv
from kitchen_suite.gymnasium_env.observations import ObservationConfig
from kitchen_suite.tasks import DEFAULT_TASKS
from kitchen_suite.tasks.goals import GoalSet
from kitchen_suite.tasks.kitchen import goal_rewards
from kitchen_suite.tasks.kitchen.action import CONTROL_TIMESTEP
from kitchen_suite.tasks.kitchen.goal_rewards import EPISODE_COMPLETIONS, STEP_COMPLETIONS, TO_COMPLETE, Goal, Infos
from kitchen_suite.tasks.kitchen.mdp import KitchenState
from kitchen_suite.tasks.kitchen.requests import REQUESTED
from kitchen_suite.tasks.success import Thresholds

with contextlib.redirect_stderr(io.StringIO()):
    # The import prints a notice about environments of gymnasium-robotics.
    from gymnasium_robotics.core import GoalEnv

# Key of the task's sentence in infos.
INSTRUCTION = "instruction"

_GOALS = ("achieved_goal", "desired_goal")


class FrankaKitchenEnv(SuiteEnv, GoalEnv):
    """FrankaKitchen-v1, keyword for keyword and key for key, over `KitchenTask`.

    Observation: a dict of `observation` (59 numbers, float64; table in docs/kitchen.md), `achieved_goal` and
      `desired_goal`. Each goal is a dict by task, or one array with `goal_format="flat"`. With `tasks_per_episode` also
      `requested_tasks` `(n,)` float64, 1 where a task is asked and 0 elsewhere.
    Action: nine joint velocities in [-1, 1], float32; float64 actions are used unrounded.
    Info, `info_format="lists"` only: lists of task names, `tasks_to_complete` and `step_task_completions` in configured
      order, `episode_task_completions` in order of completion. With `instructions=True` also `instruction`, the task's
      sentence; with `variations` also `variation_split`; with `tasks_per_episode` also `requested_tasks`, in the order
      asked.
    Info, always, in configured order: these three as masks `(n,)` bool, under their names with `_mask` appended;
      `completion_steps` `(n,)` int64, -1 for tasks not yet completed; `task_distances` `(n,)` float64 [rad, m].
    Info, with `tasks_per_episode`: `requested_tasks_mask` `(n,)` bool, and `requested_order` `(n,)` int64, the place of
      each task in the order asked, from 0, and -1 where it is not asked. All other infos concern the tasks asked. With
      `tasks_in_turn` also `attempted_tasks_mask` `(n,)` bool: the task asked before the step, and those completed.
    Info, with a dense reward: its terms, such as `reward/approach`, and under `reward_state/...` what `compute_reward`
      needs of the episode.
    Info, always: `is_success`, whether all tasks asked have been completed, and `episode_step`; numbers, or arrays of
      shape `()` with `info_format="arrays"`.
    """

    metadata = {**SuiteEnv.metadata, "render_fps": 1 / CONTROL_TIMESTEP}
    observed = ObservationConfig(
        obs_types=observations.GOAL_LAYOUTS,
        default_cameras=("workspace",),
        robot_keys=("franka/joint_positions", "franka/joint_velocities"),
        dtype=np.float64,
    )

    def __init__(
        self,
        tasks_to_complete: Sequence[str] = DEFAULT_TASKS,
        terminate_on_tasks_completed: bool | None = None,
        remove_task_when_completed: bool = True,
        object_noise_ratio: float = 0.0005,
        robot_noise_ratio: float = 0.01,
        *,
        velocity_scale: float | None = None,
        goals: Mapping[str, ArrayLike] | None = None,
        threshold: Thresholds | None = None,
        success: str | None = None,
        reward: str = "sparse",
        tasks_per_episode: int | Sequence[int] | None = None,
        tasks_in_turn: bool = False,
        max_task_steps: int | None = None,
        feedback: str | None = None,
        sleep: bool = False,
        goal_format: str = "dict",
        info_format: str = "lists",
        instructions: bool = False,
        **settings: Any,
    ) -> None:
        """Builds the environment.

        Args:
          tasks_to_complete: names of the tasks, spelt as in `tasks.GOALS`; infos and flat goals keep the order. The
            seven of FrankaKitchen-v1 by default.
          terminate_on_tasks_completed: whether the episode terminates once every task has been completed; when
            omitted, unless the reward is `dense`.
          remove_task_when_completed: whether a task is rewarded once, or in every step within its threshold.
          object_noise_ratio: scale of the noise on the observed state of the objects.
          robot_noise_ratio: scale of the noise on the observed state of the robot.
          velocity_scale: of the control mode `joint_velocity`: joint velocity for an action of 1, by default 2 rad/s
            and 2 m/s.
          goals: goals that replace the default ones, by task.
          threshold: distance from the goal below which a task is complete, of all tasks or by task [rad, m]; 0.3 when
            omitted. Not together with `success`.
          success: `original`, by the threshold, or `strict`: every joint within 0.05 rad or 0.01 m, the kettle within
            3 cm and upright; see `StrictSuccess`.
          reward: `sparse`; `dense`, the approach to the handles and the progress of the joints, and 1 for each task
            from its completion on; or `dense_gain`, the gain of that in the step. See `tasks.kitchen.reward`.
          tasks_per_episode: number of tasks that an episode asks for, or a pair of the least and greatest number; each
            reset draws which of `tasks_to_complete`, and their order. `reset(options={"requested_tasks": names})` asks
            for given ones, in the order of the names. Every episode asks for all when omitted.
          tasks_in_turn: whether the next of these tasks is asked only once the one before has been completed.
          max_task_steps: control steps after which an episode truncates unless a task has been completed, counted from
            the reset, and again from each task completed for the first time. No such limit when omitted.
          feedback: of `joint_velocity` and `joint_position`: joint positions from which the action starts, `observed`
            (the default), `true` or `target`; see `KitchenTask`.
          sleep: whether MuJoCo may put resting objects to sleep; faster, but only nearly equal to FrankaKitchen-v1.
          goal_format: `dict` for goals by task; `flat` for the goals of all tasks concatenated in configured order.
          info_format: `lists` for FrankaKitchen-v1's lists of names beside the arrays; `arrays` for arrays of fixed
            shape only, which recorders can stack.
          instructions: whether infos have the task's sentence as `instruction`; with `info_format="lists"` only.
          **settings: of rendering, of the observation type and of the control mode, such as `render_mode`, `obs_type`
            and `control_mode`; and `max_episode_steps`. See `SuiteEnv`.

        Raises:
          TypeError: an argument of the wrong type, or an unknown one.
          ValueError: an unknown name, or a number out of range.
        """
        self._goal_format = checks.choice(goal_format, ("dict", "flat"), "goal_format")
        self._info_format = checks.choice(info_format, ("lists", "arrays"), "info_format")
        self._instructed = checks.boolean(instructions, "instructions")
        if self._instructed and info_format == "arrays":
            raise ValueError("instructions=True needs info_format='lists': infos of 'arrays' hold no strings")
        task_options = {
            "tasks_to_complete": tasks_to_complete,
            "terminate_on_tasks_completed": terminate_on_tasks_completed,
            "remove_task_when_completed": remove_task_when_completed,
            "object_noise_ratio": object_noise_ratio,
            "robot_noise_ratio": robot_noise_ratio,
            "velocity_scale": velocity_scale,
            "goals": goals,
            "threshold": threshold,
            "success": success,
            "reward": reward,
            "tasks_per_episode": tasks_per_episode,
            "tasks_in_turn": tasks_in_turn,
            "max_task_steps": max_task_steps,
            "feedback": feedback,
            "sleep": sleep,
        }
        super().__init__(task_options=task_options, **settings)
        if self._instructed and not self.instruction:
            name = type(self._task).__name__
            raise ValueError(f"instructions=True needs a task with a sentence: {name} has no instructions")

    def _make_environment(self, task_options: Mapping[str, Any]) -> Environment:
        environment = suite.kitchen(**task_options)
        # Goals are read from the task's state: faster than one observable for each task.
        for key, part in environment.task.task_observables.items():
            part.enabled = not key.startswith((*_GOALS, REQUESTED))
        return environment

    def _default_camera_config(self) -> dict[str, Any]:
        # As FrankaKitchen-v1's.
        return {"distance": 2.2, "azimuth": 70.0, "elevation": -35.0, "lookat": np.array([-0.2, 0.5, 2.0])}

    @property
    def info_format(self) -> str:
        """`lists` or `arrays`."""
        return self._info_format

    @property
    def has_instructions(self) -> bool:
        """Whether infos have the task's sentence."""
        return self._instructed

    def format_goal(self, flat: NDArray) -> dict[str, NDArray] | NDArray:
        """Returns concatenated goals `(..., k)` in the `goal_format`."""
        return self._goals.split(flat) if self._goal_format == "dict" else flat

    def _goals_of(self, state: KitchenState) -> dict[str, NDArray]:
        """Returns the achieved and the desired goals `(..., k)` of a state, in fresh arrays."""
        desired = np.broadcast_to(self._goals.desired, state.achieved.shape)
        return dict(zip(_GOALS, (state.achieved.copy(), desired.copy()), strict=True))

    def _goals_by_key(self, state: KitchenState) -> dict[str, NDArray]:
        split, goals = self._goals.split, self._goals_of(state)
        parts = {f"{kind}/{task}": part for kind, flat in goals.items() for task, part in split(flat).items()}
        return {**parts, **self._requests_of(state)}

    def _requests_of(self, state: KitchenState) -> dict[str, NDArray]:
        """Returns the observation of the tasks asked `(..., n)`; empty if every episode asks for all."""
        mdp = self._task.mdp
        return {REQUESTED: mdp.shown_mask(state).astype(np.float64)} if mdp.task_draw else {}

    def _make_goals(self) -> observations.Goals:
        mask = spaces.Box(0.0, 1.0, (len(self._goals.tasks),), np.float64)
        return observations.Goals(
            space=self._goal_space(),
            lay_out=self._lay_goals_out,
            by_key=self._goals_by_key,
            further={REQUESTED: mask} if self._task.mdp.task_draw else {},
            lay_further_out=self._requests_of,
        )

    def _lay_goals_out(self, state: KitchenState) -> dict[str, Any]:
        return {kind: self.format_goal(goal) for kind, goal in self._goals_of(state).items()}

    @property
    def _goals(self) -> GoalSet:
        return self._task.mdp.goals

    def _get_info(self) -> dict[str, Any]:
        task = self._task
        info = task.mdp.info(task.state)
        names = {
            TO_COMPLETE: task.tasks_to_complete,
            STEP_COMPLETIONS: task.step_task_completions,
            EPISODE_COMPLETIONS: task.episode_task_completions,
            **({INSTRUCTION: self.instruction} if self._instructed else {}),
            **({VARIATION_SPLIT: task.variations.split} if task.variations.wanted else {}),
            **({REQUESTED: task.requested_tasks} if task.mdp.task_draw else {}),
        }
        return {
            **(names if self._info_format == "lists" else {}),
            **info,
            "is_success": self._number(bool(info["is_success"])),
            "episode_step": self._number(self._episode_step),
        }

    def compute_reward(self, achieved_goal: Goal, desired_goal: Goal, info: Infos) -> float | NDArray[np.float64]:
        """Returns the reward of a step that led to `achieved_goal`, from goals and info alone.

        Args:
          achieved_goal: dict by task or flat, with any leading axes.
          desired_goal: dict by task or flat, with the same leading axes.
          info: one dict, or a list of dicts for a batch; an info without lists and masks of tasks rewards every task;
            with `tasks_per_episode` only those listed under `requested_tasks`, or its mask, are rewarded, with
            `tasks_in_turn` those of `attempted_tasks_mask`.
            A dense reward needs its infos under `reward_state/...`.

        Returns:
          A float, or a float64 array of the leading axes' shape.

        Raises:
          TypeError: the goals hold no numbers.
          ValueError: a task is missing, shapes do not fit, or a dense reward lacks infos.
        """
        achieved, desired = self._flatten_goals(achieved_goal, desired_goal)
        return _item(goal_rewards.reward(achieved, desired, info, self._task.mdp))

    def compute_terminated(self, achieved_goal: Goal, desired_goal: Goal, info: Infos) -> bool | NDArray[np.bool_]:
        """Returns whether a step that led to `achieved_goal` terminates.

        Arguments and errors as of `compute_reward`.
        """
        achieved, desired = self._flatten_goals(achieved_goal, desired_goal)
        completed = goal_rewards.terminated(achieved, desired, info, self._task.mdp)
        return _item(completed & self._task.mdp.terminate_on_tasks_completed)

    def compute_truncated(self, achieved_goal: Goal, desired_goal: Goal, info: Infos) -> bool | NDArray[np.bool_]:
        """Returns whether a step truncates, by the info's `episode_step` and `completion_steps`.

        It does not know a time limit that `gymnasium.make` counts. Arguments and errors as of `compute_reward`.
        """
        achieved, _ = self._flatten_goals(achieved_goal, desired_goal)
        shape, task_limit = achieved.shape[:-1], self._task.mdp.max_task_steps
        limit = math.inf if self.max_episode_steps is None else self.max_episode_steps
        truncated = goal_rewards.episode_steps(info, shape) >= limit
        if task_limit is not None:
            truncated |= goal_rewards.steps_since_completion(info, shape) >= task_limit
        return _item(truncated)

    def _flatten_goals(self, achieved: Goal, desired: Goal) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        flat = goal_rewards.flatten
        return flat(achieved, self._goals, "achieved_goal"), flat(desired, self._goals, "desired_goal")

    def _number(self, value: int) -> int | NDArray:
        """Returns a number of the info in the `info_format`."""
        return np.array(value) if self._info_format == "arrays" else value

    def _goal_space(self) -> spaces.Space:
        if self._goal_format == "flat":
            return _unbounded(self._goals.desired.shape)
        return spaces.Dict({task: _unbounded(goal.shape) for task, goal in self._task.goals.items()})


def _item(value: NDArray) -> Any:
    """Returns an array, or the number in an array without axes."""
    return value if value.ndim else value.item()


def _unbounded(shape: tuple[int, ...]) -> spaces.Box:
    return spaces.Box(-np.inf, np.inf, shape, np.float64)
