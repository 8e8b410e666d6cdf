"""The task of the kitchen domain: bring the objects of some tasks to their goals."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from dm_control import mjcf
from numpy.typing import ArrayLike

from kitchen_suite import checks
from kitchen_suite.entities import Scene
from kitchen_suite.entities.arms import FRANKA
from kitchen_suite.environment_classes import KITCHEN_ENVIRONMENT
from kitchen_suite.kitchen_tasks import DEFAULT_TASKS
from kitchen_suite.tasks.control_modes.registry import make_mode, names_for_any_robot, split_options
from kitchen_suite.tasks.goals import Progress, Thresholds, ThresholdSuccess, make_success
from kitchen_suite.tasks.highlighting import Highlighting
from kitchen_suite.tasks.kitchen.control_modes import CONTROL_MODES, CONTROL_TIMESTEP
from kitchen_suite.tasks.kitchen.goals import GOALS, OUT_OF_REACH, THRESHOLD, Start, build_goals, initial_qpos, starts
from kitchen_suite.tasks.kitchen.mdp import KitchenMDP, KitchenState, as_dict, from_dict
from kitchen_suite.tasks.kitchen.metrics import KitchenRecords
from kitchen_suite.tasks.kitchen.observation import KitchenSensors, noise_scale
from kitchen_suite.tasks.kitchen.requests import GOAL_STATES, TaskRequests
from kitchen_suite.tasks.kitchen.variations import VARIED, done_parameter
from kitchen_suite.tasks.orders import REQUESTED, Ordering
from kitchen_suite.tasks.pictures import shown_at
from kitchen_suite.tasks.policy_inputs import PolicyInputs
from kitchen_suite.tasks.rewards import CONTINUING, DENSE, REWARDS
from kitchen_suite.tasks.task import SuiteTask
from kitchen_suite.tasks.variations.randomizer import Values
from kitchen_suite.tasks.variations.variations import START_DISTANCE
from kitchen_suite.types import Array


class KitchenTask(SuiteTask):
    """Complete a set of tasks in the kitchen.

    Start: the robot bent over the counter, everything closed and off, the kettle on the bottom left burner; tasks that
      close, turn off or return a prop start, where they are requested, with it at the goal of the task that they undo.
      Always the same except for the observation noise, and for the tasks requested with `tasks_per_episode`.
    Reward: at each step, the number of tasks complete after it, among those still to be completed; or a dense one.
    End: discount 0 once every task has been completed at some step (see `terminate_on_tasks_completed`); discount 1 at
      the time limit, and after `max_task_steps` without a completed task.
    Observations: noisy joint positions and velocities of robot and objects, 59 numbers; goals without noise; with
      `goal_states` these; with `tasks_per_episode` the requested tasks.
    Source: FrankaKitchen-v1 of gymnasium-robotics 1.4.2 (Relay Policy Learning, D4RL).

    Attributes:
      mdp: the task's settings.
      requests: the tasks that episodes ask for.
      reward_name: key of the reward in `tasks.rewards.REWARDS`.
      success_options: the arguments `success` and `threshold` that the task was given.
      noise_ratios: the arguments `robot_noise_ratio` and `object_noise_ratio`, by name.
    """

    mdp: KitchenMDP
    requests: TaskRequests

    default_control_timestep = CONTROL_TIMESTEP
    domain_name = "kitchen"
    environment_classes = KITCHEN_ENVIRONMENT
    control_modes = CONTROL_MODES
    varied = VARIED

    def __init__(
        self,
        scene: Scene,
        *,
        tasks_to_complete: Sequence[str] = DEFAULT_TASKS,
        terminate_on_tasks_completed: bool | None = None,
        remove_task_when_completed: bool = True,
        object_noise_ratio: float = 0.0005,
        robot_noise_ratio: float = 0.01,
        goals: Mapping[str, ArrayLike] | None = None,
        threshold: Thresholds | None = None,
        success: str | None = None,
        reward: str = "sparse",
        tasks_per_episode: int | Sequence[int] | None = None,
        tasks_in_turn: bool = False,
        tasks_in_order: bool = False,
        max_task_steps: int | None = None,
        goal_states: int = 0,
        control_mode: str = "joint_velocity",
        **options: Any,
    ) -> None:
        """Sets the task up in a kitchen.

        Args:
          scene: the furnished kitchen; each task needs a scene of its own.
          tasks_to_complete: names of tasks, of the twenty in docs/domains/kitchen.md; by default the seven of
            FrankaKitchen-v1; lists keep this order.
          terminate_on_tasks_completed: whether the episode terminates once every task has been completed; when
            omitted, unless the reward is `dense`.
          remove_task_when_completed: whether a task is rewarded once (`True`), or in every step within its threshold.
          object_noise_ratio: scale of the noise of the objects' part of the observation; 0 for none.
          robot_noise_ratio: scale of the noise of the robot's part of the observation; 0 for none.
          goals: goals that override the default ones, by task.
          threshold: distance from the goal below which a task is complete, of all tasks or by task [rad, m]; 0.3 when
            omitted. Not together with `success`.
          success: `original`, by the threshold, or `strict`, by joint; see docs/domains/kitchen.md.
          reward: `sparse`, `dense` or `dense_gain`; see docs/domains/kitchen.md.
          tasks_per_episode: number of the tasks that an episode asks for, or a pair of the least and greatest number;
            each reset draws which of `tasks_to_complete`, and their order. Only these count for the start, the reward,
            the end and the infos. Every episode asks for all when omitted.
          tasks_in_turn: whether the next of these tasks is requested only once the one before has been completed;
            observation and instruction show one task, and only this one can be completed. Needs `tasks_per_episode`.
          tasks_in_order: whether a task counts only once all tasks before it in `tasks_to_complete` have been
            completed; those that follow may count in the same step. All tasks are requested from the start. Not
            together with `tasks_per_episode`.
          max_task_steps: control steps after which the episode is truncated unless a task has been completed for the
            first time; counted from the reset, and again from each completion. No such limit when omitted.
          goal_states: number of goal states that are observed: positions of robot and objects that are wanted, which
            do not change reward and success. The option `goal_states` of a reset gives them, `(k, 30)`; otherwise all
            are the start of the kitchen with the requested tasks done. With `cameras` also pictures of the last one.
          control_mode: meaning of the action: a name in `control_modes`; see docs/guide/control_modes.md.
          **options: those of `SuiteTask`, and arguments of the control mode. `joint_velocity` has `velocity_scale`,
            velocity that a unit of action stands for, by default 2 rad/s and 2 m/s. `joint_velocity` and
            `joint_position` have `feedback`, positions from which the action starts: the positions last `observed`,
            with their noise (as in the reference); the `true` positions; or the last `target`, with which the robot
            stands still under zero actions. The others have `linear_speed`, `angular_speed`, `joint_speed` and `frame`;
            see `tasks.control_modes`.

        Raises:
          TypeError: an argument of the wrong type.
          ValueError: an unknown, repeated or missing name, two tasks that exclude each other, a goal of the wrong
            length, or a number that is negative or not finite.
        """
        if max_task_steps is not None:
            checks.integer(max_task_steps, "max_task_steps", minimum=1)
        checks.integer(goal_states, "goal_states", minimum=0, maximum=16)
        control, observables = split_options(options, self.control_modes)
        goal_set = build_goals(tasks_to_complete, goals)
        self.reward_name = checks.choice(reward, REWARDS, "reward")
        criteria: dict[str, Any] = {"success": success, "threshold": threshold}
        self.success_options = {name: value for name, value in criteria.items() if value is not None}
        terminates = reward not in CONTINUING if terminate_on_tasks_completed is None else terminate_on_tasks_completed
        is_dense = reward in DENSE
        sensors = KitchenSensors(scene, goal_set, measures_hand=is_dense)
        robot_ratio = checks.number(robot_noise_ratio, "robot_noise_ratio")
        object_ratio = checks.number(object_noise_ratio, "object_noise_ratio")
        self.noise_ratios = {"robot_noise_ratio": robot_ratio, "object_noise_ratio": object_ratio}
        mode = make_mode(control_mode, self.control_modes, control)
        if not (scene.robot.specification.name == FRANKA or mode.suits_any_robot):
            modes = names_for_any_robot(self.control_modes)
            name = scene.robot.mjcf_model.model
            raise ValueError(f"robot {name!r} needs one of the control modes {modes}, got {control_mode!r}")
        mdp = KitchenMDP(
            sensors=sensors,
            action_mode=mode,
            goals=goal_set,
            rewards=REWARDS[reward],
            is_dense=is_dense,
            noise_scale=noise_scale(sensors.slices, robot_ratio=robot_ratio, object_ratio=object_ratio),
            initial_qpos=initial_qpos(scene.robot),
            success=make_success(goal_set, scene, default=THRESHOLD, **self.success_options),
            terminate_on_tasks_completed=checks.boolean(terminates, "terminate_on_tasks_completed"),
            remove_task_when_completed=checks.boolean(remove_task_when_completed, "remove_task_when_completed"),
            ordering=Ordering.make(
                tasks_per_episode=tasks_per_episode,
                tasks_in_turn=tasks_in_turn,
                tasks_in_order=tasks_in_order,
                count=len(goal_set.tasks),
            ),
            max_task_steps=max_task_steps,
            goal_states=goal_states,
        )
        super().__init__(scene, mdp, **observables)
        self.requests = TaskRequests(goal_set, mdp.ordering.draw, goal_states, mdp.initial_qpos.size)
        handles = (goal.handle_in(scene) for goal in goal_set.goals)
        self.vary(
            handles=[handle for handle in handles if handle.name not in OUT_OF_REACH],
            parameters=[done_parameter(scene, lambda: self.requests.tasks)],
            home=np.array(scene.robot.home),
            correct=self._away_from_goals,
        )

    def __repr__(self) -> str:
        return f"{type(self).__name__}(tasks_to_complete={list(self.mdp.goals.tasks)})"

    def make_records(self) -> KitchenRecords:
        return KitchenRecords(self)

    def make_policy_inputs(self, state_size: int) -> PolicyInputs:
        mdp = self.mdp
        goal_size = 2 * mdp.goals.desired.size + mdp.initial_qpos.size * mdp.goal_states
        return PolicyInputs(
            names=_policy_names(mdp, self.reward_name, sees=bool(self.pictures.by_name)),
            state_size=state_size,
            goal_size=goal_size,
            tasks=mdp.goals.tasks,
            observes_requests=mdp.ordering.draw is not None,
            keys=("achieved_goal", "desired_goal", GOAL_STATES, REQUESTED),
        )

    @property
    def instructions(self) -> tuple[str, ...]:
        return self.requests.instructions_in(self.mdp.current_order(self.state) if self.state else self.requests.order)

    @property
    def goals(self) -> dict[str, Array]:
        """Goal of each task, in configured order."""
        return self.mdp.goals.split(self.mdp.goals.desired.copy())

    @property
    def requested_tasks(self) -> list[str]:
        """Tasks that the episode asks for, in their order; all in configured order without `tasks_per_episode`."""
        return self.requests.tasks_in(self.state.requested_order)

    @property
    def task_weights(self) -> Array:
        """Weights `(n,)` with which later episodes draw the tasks that they ask for, in configured order; 1 by default.

        May be set to an array, or to numbers by task; tasks left out have the weight 1. They are not negative, and
        positive for as many tasks as an episode may ask for. The same random numbers are drawn, whatever the weights.
        Part of the task's state.
        """
        return self.requests.weights

    @task_weights.setter
    def task_weights(self, value: ArrayLike | Mapping[str, float]) -> None:
        self.requests.weights = value

    @property
    def threshold(self) -> float | dict[str, float] | None:
        """Distance from the goal below which a task is complete [rad, m], by task if they differ; None if `strict`."""
        if not isinstance(self.mdp.success, ThresholdSuccess):
            return None
        thresholds = self.mdp.success.thresholds
        if isinstance(thresholds, float):
            return thresholds
        return dict(zip(self.mdp.goals.tasks, thresholds.tolist(), strict=True))

    @property
    def progress(self) -> Progress:
        """Completion of the tasks; arrays of shape `(n,)`, in configured order."""
        return self.state.progress

    @property
    def task_distances(self) -> Array:
        """Distance of each task from its goal, in configured order [rad, m]."""
        return self.state.distances.copy()

    @property
    def tasks_to_complete(self) -> list[str]:
        """Tasks still to be completed, in configured order."""
        return self.mdp.goals.names(self.progress.remaining)

    @property
    def step_task_completions(self) -> list[str]:
        """Tasks rewarded in the last step, in configured order."""
        return self.mdp.goals.names(self.progress.completions)

    @property
    def episode_task_completions(self) -> list[str]:
        """Tasks completed in this episode, in order of completion."""
        return list(self.completion_steps)

    @property
    def completion_steps(self) -> dict[str, int]:
        """Control step, from 1, at which each task was first completed, in order of completion."""
        return self.mdp.goals.by_completion(self.progress.completion_steps)

    def initial_state(self, draws: Array) -> KitchenState:
        state: KitchenState = super().initial_state(draws)
        state = self.mdp.with_request(state, self.requests.order, self.requests.request.goal_states)
        if state.goal_states is None or not self.pictures.colour:
            return state
        # Taken once the episode has started, and the physics can be rendered.
        blank = [np.zeros(picture.taker.array_spec.shape, np.uint8) for picture in self.pictures.colour]
        return state._replace(goal_pictures=np.stack(blank))

    def initialize_episode(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        super().initialize_episode(physics, random_state)
        state = self.state
        if state.goal_pictures is not None:
            columns, goal = self.mdp.sensors.indices.state_qpos, state.goal_states[-self.mdp.initial_qpos.size :]
            with shown_at(physics, columns, goal):
                taken = [picture.taker.observation_callable(physics)() for picture in self.pictures.colour]
            self.set_mdp_state(state._replace(goal_pictures=np.stack(taken)), physics)

    def bind(self, physics: mjcf.Physics) -> None:
        self._highlighting = Highlighting(physics, (goal.geoms_in(self.scene) for goal in self.mdp.goals.goals))
        self._starts = starts(self.mdp.goals, self.scene, physics)

    def reset_physics(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        indices, data = self.mdp.sensors.indices, physics.data
        data.qpos[indices.state_qpos] = self.mdp.initial_qpos
        for start in self._requested_starts():
            data.qpos[start.columns] = start.positions
        if self.requests.request.start_state is not None:
            data.qpos[indices.state_qpos] = self.requests.request.start_state
        data.qvel[:] = 0.0
        data.ctrl[:] = 0.0

    def _requested_starts(self) -> list[Start]:
        return [start for task, start in self._starts.items() if task in self.requests.tasks]

    def _away_from_goals(self, values: Values) -> Values:
        """Returns values with which props that start near a requested goal, or out of bounds, start as by default."""
        goals, achieved = self.mdp.goals, self.mdp.sensors.read(self.simulation).achieved
        near = self.mdp.success.within(achieved, factor=START_DISTANCE) & np.isin(goals.tasks, self.requests.tasks)
        qpos = self.simulation.read("qpos", slice(None))
        props = {GOALS[task].prop for task in goals.names(near)}
        props |= {start.prop for start in self._requested_starts() if not start.allows(qpos)}
        if not props:
            return values
        moved = [name for name in self.variations.randomizer.displacements if name.partition("/")[0] in props]
        return {**values, **{name: self.variations.randomizer.defaults[name] for name in moved}}

    def state_definition(self) -> dict[str, Any]:
        mdp, ordering = self.mdp, self.mdp.ordering
        thresholds = mdp.success.thresholds if isinstance(mdp.success, ThresholdSuccess) else ()
        return {
            **super().state_definition(),
            "tasks_to_complete": mdp.goals.tasks,
            "goals": mdp.goals.desired,
            "success": type(mdp.success).__qualname__,
            "threshold": np.broadcast_to(thresholds, len(mdp.goals.tasks)) if np.size(thresholds) else None,
            "reward": self.reward_name,
            "terminate_on_tasks_completed": mdp.terminate_on_tasks_completed,
            "remove_task_when_completed": mdp.remove_task_when_completed,
            **self.noise_ratios,
            "tasks_per_episode": ordering.draw,
            "tasks_in_turn": ordering.in_turn,
            "tasks_in_order": ordering.in_order,
            "max_task_steps": mdp.max_task_steps,
            "goal_states": mdp.goal_states,
        }

    def saved_state(self) -> dict[str, Any]:
        goals = self.mdp.goals
        tasks = {"tasks": ", ".join(goals.tasks), "desired": goals.desired.copy()}
        state = as_dict(self.state)
        if self.mdp.ordering.draw is None:
            del state["requested_order"]
        return {**tasks, **state, **self.requests.saved()}

    def restore_state(self, state: Mapping[str, Any]) -> None:
        goals = self.mdp.goals
        if not np.array_equal(state["desired"], goals.desired):
            raise ValueError(f"the state has other goals, {state['desired']}, than the task, {goals.desired}")
        self.requests.restore(state)
        self.set_mdp_state(from_dict(state))

    def publish(self, physics: mjcf.Physics | None) -> None:
        """Updates the colours of objects."""
        if self._visualize_reward:
            self._highlighting.update(self.state.progress.within)


def _policy_names(mdp: KitchenMDP, reward: str, *, sees: bool) -> tuple[str, ...]:
    """Returns the names of trained policies, the most specific one first; `sees`: whether pictures are observed."""
    tasks = mdp.goals.tasks
    own = "seven" if tasks == DEFAULT_TASKS else "_".join(tasks).replace(" ", "_")
    if mdp.ordering.draw is not None:
        own += "_in_turn" if mdp.ordering.in_turn or mdp.ordering.draw.most == 1 else "_random"
    own += "" if reward == "sparse" else f"_{reward}"
    general = (*(("pixels",) if sees else ()), "kitchen") if set(tasks) <= set(DEFAULT_TASKS) else ()
    return (own, *general)
