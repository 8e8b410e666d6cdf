"""The kitchen as a Gymnasium environment with the interface of FrankaKitchen-v1."""

import contextlib
import functools
import io
import math
import types
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks
from kitchen_suite.gymnasium_env import observations, original
from kitchen_suite.gymnasium_env.base import VARIATION_SPLIT, SuiteEnv
from kitchen_suite.kitchen_tasks import DEFAULT_TASKS
from kitchen_suite.tasks.kitchen import goal_rewards
from kitchen_suite.tasks.kitchen.control_modes import CONTROL_TIMESTEP
from kitchen_suite.tasks.kitchen.goal_rewards import (
    EPISODE_COMPLETIONS,
    STEP_COMPLETIONS,
    TO_COMPLETE,
    GoalArrays,
    Infos,
)
from kitchen_suite.tasks.kitchen.observation import StateSlices
from kitchen_suite.tasks.kitchen.requests import RENDER_GOAL, TASK_ID
from kitchen_suite.tasks.orders import REQUESTED
from kitchen_suite.tasks.pictures import shown_at

with contextlib.redirect_stderr(io.StringIO()):
    # The import prints a notice about environments of gymnasium-robotics.
    from gymnasium_robotics.core import GoalEnv


class GoalMethod:
    """A method that an environment has only where its observations hold goals, by its attribute `has_goals`.

    Others take each environment with `compute_reward` for a goal environment, as Stable-Baselines3 does, whatever it
    observes. Without goals `hasattr` is therefore False, and the AttributeError names the observation type with goals.
    """

    def __init__(self, method: Callable[..., Any]) -> None:
        """Takes the method; used as a decorator."""
        self._method = method
        self.__doc__ = method.__doc__

    def __get__(self, instance: Any, owner: type | None = None) -> Any:
        if instance is None:
            return self._method
        if not instance.has_goals:
            name = self._method.__name__
            raise AttributeError(f"there is no {name} without goals in the observations: build with obs_type='goal'")
        return types.MethodType(self._method, instance)


class FrankaKitchenEnv(SuiteEnv, GoalEnv):
    """FrankaKitchen-v1, keyword for keyword and key for key, over `KitchenTask`.

    Observation: a dict of `observation` (59 numbers, float64; table in docs/domains/kitchen.md), `achieved_goal` and
      `desired_goal`. Each goal is a dict by task, or one array with `goal_format="flat"`. With `tasks_per_episode` also
      `requested_tasks` `(n,)` float64, 1 where a task is requested and 0 elsewhere; with `goal_states=k` before it
      `goal_states` `(30 k,)` float64, and with pictures `goal_pixels`, those of the last goal state, in the form of
      `pixels`.
    Action: nine joint velocities in [-1, 1], float32; float64 actions are used unrounded.
    Info, `info_format="lists"` only: lists of task names, `tasks_to_complete` and `step_task_completions` in configured
      order, `episode_task_completions` in order of completion. With `variations` also `variation_split`; with
      `tasks_per_episode` also `requested_tasks`, in their order; with `instructions=True` also `instruction`, the
      task's sentence.
    Info, always, in configured order: these three as masks `(n,)` bool, under their names with `_mask` appended;
      `completion_steps` `(n,)` int64, -1 for tasks not yet completed; `task_distances` `(n,)` float64 [rad, m].
    Info, with `tasks_per_episode`: `requested_tasks_mask` `(n,)` bool, and `requested_order` `(n,)` int64, the place of
      each requested task, from 0, and -1 for the others. All other infos concern the requested tasks. With
      `tasks_in_turn` also `attempted_tasks_mask` `(n,)` bool: the task requested before the step, and those completed.
    Info, with a dense reward: its terms, such as `reward/approach`, and under `reward_state/...` what `compute_reward`
      needs of the episode.
    Info, after a reset with the option `task_id` or `render_goal`, as in OGBench: `goal` `(59,)`, the observation of
      the goal state, at rest and without noise; with `render_goal=True` also `goal_rendered`, its picture as of
      `render`.
    Info, always: `is_success`, whether all tasks that the episode asks for have been completed, and `episode_step`;
      numbers, or arrays of shape `()` with `info_format="arrays"`.

    Attributes, beside those of the original, which are in `gymnasium_env/original.py`:
      info_format: `lists` or `arrays`.
    """

    metadata = {**SuiteEnv.metadata, "render_fps": 1 / CONTROL_TIMESTEP}
    default_domain = "kitchen"
    obs_types = tuple(observations.OBS_TYPES)
    default_cameras = ("workspace",)
    observation_dtype = np.float64
    # The same as in FrankaKitchen-v1.
    free_camera = {"distance": 2.2, "azimuth": 70.0, "elevation": -35.0, "lookat": np.array([-0.2, 0.5, 2.0])}
    array_options = {"info_format": "arrays"}
    flat_options = {"goal_format": "flat"}
    goal_options = ("tasks_to_complete", "tasks_per_episode", "tasks_in_turn", "goal_states", "goals")
    environment_options = {"further_names": original.NAMES}

    # Attributes of the original; assigning one sets it, or raises an error that names what sets it.
    model = original.model
    data = original.data
    mujoco_renderer = original.mujoco_renderer
    init_qpos = original.init_qpos
    init_qvel = original.init_qvel
    dt = original.dt
    goal = original.goal
    tasks_to_complete = original.tasks_to_complete
    step_task_completions = original.step_task_completions
    episode_task_completions = original.episode_task_completions
    terminate_on_tasks_completed = original.terminate_on_tasks_completed
    remove_task_when_completed = original.remove_task_when_completed
    object_noise_ratio = original.object_noise_ratio
    robot_noise_ratio = original.robot_noise_ratio

    # Not for type checkers, which would believe that every attribute exists.
    if not TYPE_CHECKING:
        __getattr__ = original.explained

    def __init__(
        self,
        tasks_to_complete: Sequence[str] = DEFAULT_TASKS,
        terminate_on_tasks_completed: bool | None = None,
        remove_task_when_completed: bool = True,
        object_noise_ratio: float = 0.0005,
        robot_noise_ratio: float = 0.01,
        *,
        goal_format: str = "dict",
        info_format: str = "lists",
        instructions: bool = False,
        **arguments: Any,
    ) -> None:
        """Builds the environment.

        Args:
          tasks_to_complete: see `KitchenTask`; infos and flat goals keep the order.
          terminate_on_tasks_completed: see `KitchenTask`.
          remove_task_when_completed: see `KitchenTask`.
          object_noise_ratio: see `KitchenTask`.
          robot_noise_ratio: see `KitchenTask`.
          goal_format: `dict` for goals by task; `flat` for the goals of all tasks concatenated in configured order.
          info_format: `lists` for FrankaKitchen-v1's lists of names beside the arrays; `arrays` for arrays of fixed
            shape only, which recorders can stack.
          instructions: whether infos have the task's sentence as `instruction`; with `info_format="lists"` only.
          **arguments: others of `KitchenTask`, and those of `build_kitchen_scene` and of `SuiteEnv`.
        """
        self._goal_format = checks.choice(goal_format, ("dict", "flat"), "goal_format")
        self.info_format = checks.choice(info_format, ("lists", "arrays"), "info_format")
        if checks.boolean(instructions, "instructions") and info_format == "arrays":
            raise ValueError("instructions=True needs info_format='lists': infos of 'arrays' hold no strings")
        super().__init__(
            tasks_to_complete=tasks_to_complete,
            terminate_on_tasks_completed=terminate_on_tasks_completed,
            remove_task_when_completed=remove_task_when_completed,
            object_noise_ratio=object_noise_ratio,
            robot_noise_ratio=robot_noise_ratio,
            instructions=instructions,
            **arguments,
        )

    @property
    def has_goals(self) -> bool:
        """Whether observations hold goals; only then is there `compute_reward`, as of a goal environment."""
        return self.observations.has_goals

    def _make_observations(self, obs_type: str, flat_goals: bool = False) -> observations.Observations:
        return super()._make_observations(obs_type, flat_goals=self._goal_format == "flat")

    def _get_info(self) -> dict[str, Any]:
        task = self.composer_task
        info = task.runner.mdp_info(task.episode)
        return {
            **(self._names() if self.info_format == "lists" else {}),
            **info,
            "is_success": self._number(bool(info["is_success"])),
            "episode_step": self._number(self._episode_step),
        }

    def _names(self) -> dict[str, Any]:
        """Returns the infos that are no arrays: fresh lists of task names, and the split of variations."""
        task = self.composer_task
        return {
            TO_COMPLETE: task.tasks_to_complete,
            STEP_COMPLETIONS: task.step_task_completions,
            EPISODE_COMPLETIONS: task.episode_task_completions,
            **({VARIATION_SPLIT: task.variations.split} if self.varies else {}),
            **({REQUESTED: task.requested_tasks} if task.mdp.ordering.draw else {}),
        }

    def _infos_of_reset(self, options: Mapping[str, Any]) -> dict[str, Any]:
        if options.get(TASK_ID) is None and options.get(RENDER_GOAL) is None:
            return {}
        goal = self.composer_task.mdp.goal_state(self.composer_task.state)
        pictures = {"goal_rendered": self.render_goal(goal)} if options.get(RENDER_GOAL) else {}
        return {"goal": goal_observation(goal, self.composer_task.mdp.sensors.slices), **pictures}

    def check_pictures(self, options: Mapping[str, Any]) -> None:
        if np.any(options.get(RENDER_GOAL)) and self.render_mode not in ("rgb_array", "depth_array"):
            raise ValueError(f"{RENDER_GOAL} needs an environment with render_mode='rgb_array' or 'depth_array'")

    def render_goal(self, goal: NDArray[np.float64]) -> NDArray:
        """Returns what `render` would show of a state of the kitchen `(30,)`."""
        with shown_at(self.environment.physics, self.composer_task.mdp.sensors.indices.state_qpos, goal):
            return np.asarray(self.render())

    @GoalMethod
    def compute_reward(
        self, achieved_goal: GoalArrays, desired_goal: GoalArrays, info: Infos
    ) -> float | NDArray[np.float64]:
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
          ValueError: a task is missing, shapes do not fit, or a dense reward lacks infos.
        """
        achieved, desired = self._flatten_goals(achieved_goal, desired_goal)
        return _item(goal_rewards.reward(achieved, desired, info, self.composer_task.mdp))

    @GoalMethod
    def compute_terminated(
        self, achieved_goal: GoalArrays, desired_goal: GoalArrays, info: Infos
    ) -> bool | NDArray[np.bool_]:
        """Returns whether a step that led to `achieved_goal` terminates.

        Arguments and errors as in `compute_reward`.
        """
        achieved, desired = self._flatten_goals(achieved_goal, desired_goal)
        completed = goal_rewards.terminated(achieved, desired, info, self.composer_task.mdp)
        return _item(completed & self.composer_task.mdp.terminate_on_tasks_completed)

    @GoalMethod
    def compute_truncated(
        self, achieved_goal: GoalArrays, desired_goal: GoalArrays, info: Infos
    ) -> bool | NDArray[np.bool_]:
        """Returns whether a step truncates, by the info's `episode_step` and `completion_steps`.

        It does not know a time limit that `gymnasium.make` counts. Arguments and errors as in `compute_reward`.
        """
        achieved, _ = self._flatten_goals(achieved_goal, desired_goal)
        shape, task_limit = achieved.shape[:-1], self.composer_task.mdp.max_task_steps
        limit = math.inf if self.max_episode_steps is None else self.max_episode_steps
        truncated = goal_rewards.episode_steps(info, shape) >= limit
        if task_limit is not None:
            truncated |= goal_rewards.steps_since_completion(info, shape) >= task_limit
        return _item(truncated)

    def _flatten_goals(
        self, achieved: GoalArrays, desired: GoalArrays
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        flat, goals = goal_rewards.flatten, self.composer_task.mdp.goals
        return flat(achieved, goals, "achieved_goal"), flat(desired, goals, "desired_goal")

    def _number(self, value: float) -> Any:
        return np.array(value) if self.info_format == "arrays" else value

    @functools.cached_property
    def robot_env(self) -> original.RobotEnv:
        """The original's environment of the robot, with `data`, `model`, `set_state` and others."""
        return original.RobotEnv(self)

    @property
    def _robot_env_in_use(self) -> original.RobotEnv | None:
        """`robot_env` once a program has read it, and may write to model and data; None before."""
        return self.__dict__.get("robot_env")

    def reset(self, *, seed: int | None = None, options: Mapping[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Starts an episode, from `init_qpos` where a program has changed it; arguments as in `SuiteEnv.reset`."""
        robot_env = self._robot_env_in_use
        if robot_env is None:
            return super().reset(seed=seed, options=options)
        result = super().reset(seed=seed, options=robot_env.start_options(options))
        robot_env.derive()
        return result

    def step(self, action: ArrayLike) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Makes one control step; see `SuiteEnv.step`."""
        robot_env = self._robot_env_in_use
        if robot_env is None:
            return super().step(action)
        robot_env.apply_writes()
        result = super().step(action)
        robot_env.derive()
        return result

    def _get_obs(self, observation: Any) -> Any:
        """Returns an observation of the suite's environment in the observation space; stores it.

        Given an array of `robot_env._get_obs()`, as programs do after they have set a state, returns as the original
        the observation of the present state, with fresh noise of the objects' part.
        """
        if not isinstance(observation, np.ndarray):
            return super()._get_obs(observation)
        return self.robot_env.observation_with(observation)

    def __getstate__(self) -> dict[str, Any]:
        robot_env = self._robot_env_in_use
        start = None if robot_env is None else robot_env.changed_init_qpos
        return {**super().__getstate__(), **({} if start is None else {"init_qpos": start})}

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        super().__setstate__(state)
        if "init_qpos" in state:
            self.init_qpos = state["init_qpos"]


def goal_observation(goal: NDArray[np.float64], parts: StateSlices) -> NDArray[np.float64]:
    """Returns the observation `(..., n)` of states of the kitchen `(..., k)`, at rest and without noise."""
    observation = np.zeros((*goal.shape[:-1], parts.size))
    observation[..., parts.positions] = goal
    return observation


def _item(value: NDArray) -> Any:
    return value if value.ndim else value.item()
