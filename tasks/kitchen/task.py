"""The task of the kitchen domain: bring the objects of some tasks to their goals."""

import collections
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from dm_control import mjcf
from dm_control.composer.observation import observable
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks
from kitchen_suite.entities import Scene
from kitchen_suite.entities.franka import Franka
from kitchen_suite.entities.scenes import SiteArena
from kitchen_suite.names import DEFAULT_TASKS
from kitchen_suite.tasks.control_modes.modes import make_mode, split_options
from kitchen_suite.tasks.episode import scaled, sensing_parameters
from kitchen_suite.tasks.goals import Goal, Progress
from kitchen_suite.tasks.instructions import joined
from kitchen_suite.tasks.kitchen import observation as noise
from kitchen_suite.tasks.kitchen.action import CONTROL_MODES, CONTROL_TIMESTEP, PHYSICS_TIMESTEP
from kitchen_suite.tasks.kitchen.goals import (
    GOALS,
    INITIAL_QPOS,
    OUT_OF_REACH,
    THRESHOLD,
    Start,
    build_goals,
    starts,
)
from kitchen_suite.tasks.kitchen.mdp import REQUESTED_ORDER, KitchenMDP, KitchenState, as_dict, from_dict
from kitchen_suite.tasks.kitchen.observation import KitchenObservables, KitchenSensors
from kitchen_suite.tasks.kitchen.requests import (
    REQUESTED,
    TaskDraw,
    checked_in_turn,
    checked_limit,
    checked_order,
    checked_weights,
    in_order,
    order_of,
    requested_order,
)
from kitchen_suite.tasks.kitchen.reward import REWARDS
from kitchen_suite.tasks.kitchen.variations import VARIED, done_parameter, may_be_done
from kitchen_suite.tasks.sensors import SceneIndices
from kitchen_suite.tasks.success import Thresholds, ThresholdSuccess, make_success
from kitchen_suite.tasks.task import Completions, GoalHighlighting, Metrics, SuiteTask
from kitchen_suite.tasks.variations.distributions import Variation
from kitchen_suite.tasks.variations.randomizer import Values
from kitchen_suite.tasks.variations.variations import START_DISTANCE, Variations


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


class KitchenProgress(RequestingTask):
    """A task of the kitchen's MDP that reports how far its episode has come."""

    _reward_name: str
    _success_options: Mapping[str, Any]

    @property
    def success_options(self) -> dict[str, Any]:
        """The arguments `success` and `threshold` that the task was given."""
        return dict(self._success_options)

    @property
    def threshold(self) -> float | dict[str, float] | None:
        """Distance from the goal below which a task is complete [rad, m], by task if they differ; None if `strict`."""
        if not isinstance(self._mdp.success, ThresholdSuccess):
            return None
        thresholds = self._mdp.success.thresholds
        if isinstance(thresholds, float):
            return thresholds
        return dict(zip(self._mdp.goals.tasks, thresholds.tolist(), strict=True))

    @property
    def reward_name(self) -> str:
        """Key of the reward function in `REWARDS`."""
        return self._reward_name

    @property
    def reward_terms(self) -> dict[str, float]:
        """The terms of the last step's reward by name; zeros before the first step of an episode."""
        return {name: float(term) for name, term in self._mdp.terms(self._state).items()}

    @property
    def progress(self) -> Progress:
        """Completion of the tasks; arrays of shape `(n,)`, in configured order."""
        return self._state.progress

    @property
    def task_distances(self) -> NDArray[np.float64]:
        """Distance of each task from its goal, in configured order [rad, m]."""
        return self._state.distances.copy()

    @property
    def tasks_to_complete(self) -> list[str]:
        """Tasks still to be completed, in configured order."""
        return self._mdp.goals.names(self.progress.remaining)

    @property
    def step_task_completions(self) -> list[str]:
        """Tasks rewarded in the last step, in configured order."""
        return self._mdp.goals.names(self.progress.completions)

    @property
    def episode_task_completions(self) -> list[str]:
        """Tasks completed in this episode, in order of completion."""
        return list(self.completion_steps)

    @property
    def completion_steps(self) -> dict[str, int]:
        """Control step, from 1, at which each task was first completed, in order of completion."""
        return self._mdp.goals.by_completion(self.progress.completion_steps)

    def metrics(self, infos: Mapping[str, Any]) -> Metrics:
        """Returns whether all tasks asked were completed, and the control step of each completion."""
        completions = self.completions_in(infos)
        steps = self._mdp.goals.by_completion(completions.steps)
        return {"success": len(steps) == int(completions.asked.sum()), "tasks_completed": steps}

    def progress_in(self, infos: Mapping[str, Any]) -> NDArray[np.int64]:
        """Returns the number of completed tasks."""
        return infos["episode_task_completions_mask"].sum(axis=-1)

    def completions_in(self, infos: Mapping[str, Any]) -> Completions:
        tasks = self._mdp.goals.tasks
        asked = infos.get(f"{REQUESTED}_mask", np.full(len(tasks), True))
        return Completions(tuple(tasks), asked, infos["completion_steps"])

    def goals_reached(self, arrays: Mapping[str, NDArray]) -> tuple[tuple[str, ...], NDArray[np.bool_]] | None:
        achieved, goals = self._recorded_goals(arrays), self._mdp.goals
        distances = arrays.get("info/task_distances") if achieved is None else goals.distances(achieved)
        within = None if distances is None else self._mdp.success.within_recorded(achieved, distances)
        if within is None:
            return None
        asked = arrays.get(f"info/{REQUESTED}_mask", arrays.get(f"observation/{REQUESTED}"))
        return goals.tasks, within if asked is None else within & (asked > 0)

    def _recorded_goals(self, arrays: Mapping[str, NDArray]) -> NDArray[np.float64] | None:
        """Returns the achieved goals `(T + 1, k)` in a recording, if it has them."""
        key = "observation/achieved_goal"
        by_task = [f"{key}/{task}" for task in self._mdp.goals.tasks]
        if arrays.keys() >= {*by_task}:
            return np.concatenate([arrays[name] for name in by_task], axis=1)
        return arrays.get(key)


# Greatest rounding error of a recorded observation beside its noise [rad, m].
_ROUNDING = 1e-6


class KitchenTask(KitchenProgress):
    """Complete a set of tasks in the kitchen.

    Start: the robot bent over the counter, everything closed and off, the kettle on the bottom left burner; tasks that
      close, turn off or return a prop start, where they are asked, with it at the goal of the task that they undo.
      Always the same except for the observation noise, and for the tasks asked with `tasks_per_episode`.
    Reward: at each step, the number of tasks complete after it, among those still to be completed; or a dense one.
    End: discount 0 once every task has been completed at some step (see `terminate_on_tasks_completed`); discount 1 at
      the time limit, and after `max_task_steps` without a completed task.
    Observations: noisy joint positions and velocities of robot and objects, 59 numbers; goals without noise; with
      `tasks_per_episode` the tasks asked.
    Source: FrankaKitchen-v1 of gymnasium-robotics 1.4.2 (Relay Policy Learning, D4RL).
    """

    domain_name = "kitchen"
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
        max_task_steps: int | None = None,
        control_mode: str = "joint_velocity",
        variations: str | Sequence[str] | Mapping[str, Variation] | None = None,
        variation_split: str = "seen",
        **options: Any,
    ) -> None:
        """Sets the task up in a kitchen.

        Args:
          scene: the furnished kitchen; each task needs a scene of its own.
          tasks_to_complete: keys of `goals.GOALS`, by default the reference's; lists keep this order.
          terminate_on_tasks_completed: whether the episode terminates once every task has been completed; when
            omitted, unless the reward is `dense`.
          remove_task_when_completed: whether a task is rewarded once (`True`), or in every step within its threshold.
          object_noise_ratio: scale of the noise of the objects' part of the observation; 0 for none.
          robot_noise_ratio: scale of the noise of the robot's part of the observation; 0 for none.
          goals: goals that override the default ones, by task.
          threshold: distance from the goal below which a task is complete, of all tasks or by task [rad, m]; 0.3 when
            omitted. Not together with `success`.
          success: `original`, by the threshold, or `strict`, by joint; see `StrictSuccess`.
          reward: `sparse`, `dense` or `dense_gain`; see `kitchen.reward`.
          tasks_per_episode: number of the tasks that an episode asks for, or a pair of the least and greatest number;
            each reset draws which of `tasks_to_complete`, and their order. Only these count for the start, the reward,
            the end and the infos. Every episode asks for all when omitted.
          tasks_in_turn: whether the next of these tasks is asked only once the one before has been completed;
            observation and instruction show one task, and only this one can be completed. Needs `tasks_per_episode`.
          max_task_steps: control steps after which the episode is truncated unless a task has been completed for the
            first time; counted from the reset, and again from each completion. No such limit when omitted.
          control_mode: meaning of the action, one of `action.CONTROL_MODES`.
          variations: groups of parameters that vary, or distributions by parameter; see `Variations`.
          variation_split: which distributions of the groups are drawn from, `seen` or `held_out`.
          **options: observables that `SuiteTask` adds, and arguments of the control mode. `joint_velocity` has
            `velocity_scale`, velocity that a unit of action stands for, by default 2 rad/s and 2 m/s. `joint_velocity`
            and `joint_position` have `feedback`, positions from which the action starts: the positions last
            `observed`, with their noise (as in the reference); the `true` positions; or the last `target`, with which
            the robot stands still under zero actions. The others have `linear_speed`, `angular_speed`, `joint_speed`
            and `frame`; see `tasks.control_modes`.

        Raises:
          TypeError: an argument of the wrong type.
          ValueError: an unknown, repeated or missing name, two tasks that exclude each other, a goal of the wrong
            length, or a number that is negative or not finite.
        """
        ratios = {
            "robot_ratio": checks.number(robot_noise_ratio, "robot_noise_ratio"),
            "object_ratio": checks.number(object_noise_ratio, "object_noise_ratio"),
        }
        control, observables = split_options(options, CONTROL_MODES)
        goal_set = build_goals(tasks_to_complete, goals)
        self._reward_name = checks.choice(reward, REWARDS, "reward")
        given = {"success": success, "threshold": threshold}
        self._success_options = {name: value for name, value in given.items() if value is not None}
        terminates = reward != "dense" if terminate_on_tasks_completed is None else terminate_on_tasks_completed
        self._mdp = KitchenMDP(
            sensors=KitchenSensors(scene, goal_set, measures_hand=reward != "sparse"),
            action_mode=make_mode(control_mode, CONTROL_MODES, control),
            goals=goal_set,
            reward_terms=REWARDS[reward](),
            noise_scale=noise.scale(**ratios),
            success=make_success(goal_set, scene, default=THRESHOLD, **self._success_options),
            terminate_on_tasks_completed=checks.boolean(terminates, "terminate_on_tasks_completed"),
            remove_task_when_completed=checks.boolean(remove_task_when_completed, "remove_task_when_completed"),
            task_draw=None if tasks_per_episode is None else TaskDraw.make(tasks_per_episode, len(goal_set.tasks)),
            tasks_in_turn=checked_in_turn(tasks_in_turn, tasks_per_episode),
            max_task_steps=checked_limit(max_task_steps),
        )
        super().__init__(scene, **observables)
        self._scene = scene
        handles = (goal.handle_in(scene) for goal in goal_set.goals)
        self.variations = Variations(
            scene,
            self.varied,
            variations,
            variation_split,
            handles=[handle for handle in handles if handle.name not in OUT_OF_REACH],
            parameters=(*sensing_parameters(self._mdp.noise_parts), done_parameter(scene, self._may_be_done)),
            home=INITIAL_QPOS[: len(scene.robot.joints)],
            correct=self._corrected,
        )
        self._prepare_requests()
        requested = self._observed_requests if self._mdp.task_draw else None
        self._observables = KitchenObservables(scene, self._mdp.goals, self.extra_observables, requested)
        self.set_timesteps(control_timestep=CONTROL_TIMESTEP, physics_timestep=PHYSICS_TIMESTEP)

    def __repr__(self) -> str:
        return f"KitchenTask(tasks_to_complete={list(self._mdp.goals.tasks)})"

    @property
    def root_entity(self) -> SiteArena:
        return self._scene.arena

    @property
    def scene(self) -> Scene:
        """Arena, robot and props."""
        return self._scene

    @property
    def task_observables(self) -> collections.OrderedDict[str, observable.Observable]:
        return self._observables.by_name.copy()

    @property
    def robot(self) -> Franka:
        return self._scene.robot

    @property
    def mdp(self) -> KitchenMDP:
        return self._mdp

    @property
    def indices(self) -> SceneIndices:
        """Indices of robot, objects and goals in the compiled model."""
        return self._mdp.sensors.indices

    @property
    def state(self) -> KitchenState:
        return self._state

    @property
    def goals(self) -> dict[str, NDArray[np.float64]]:
        """Goal of each task, in configured order."""
        return self._mdp.goals.split(self._mdp.goals.desired.copy())

    @property
    def observation_size(self) -> int:
        goals = self._mdp.goals
        requested = len(goals.tasks) if self._mdp.task_draw else 0
        return self._mdp.noise_scale.size + self.extra_size + 2 * goals.desired.size + requested

    @property
    def state_size(self) -> int:
        return self._mdp.noise_scale.size + self.extra_size

    @property
    def policy_key(self) -> str:
        goals, reward = self._mdp.goals.tasks, self._reward_name
        names = "seven" if goals == DEFAULT_TASKS else "_".join(goals).replace(" ", "_")
        return f"{names}{self._mdp.request_key}{'' if reward == 'sparse' else f'_{reward}'}"

    @property
    def general_policy_keys(self) -> tuple[str, ...]:
        return ("kitchen",) if set(self._mdp.goals.tasks) <= set(DEFAULT_TASKS) else ()

    def is_initial(self, physics: mjcf.Physics, observation: NDArray[np.float64]) -> bool:
        del physics
        present = self._mdp.sensors.observed(self._simulation)
        greatest = scaled(self.sensing, self._mdp.noise_scale)
        return bool((np.abs(observation - present) <= greatest + _ROUNDING).all())

    def restore(self, physics: mjcf.Physics, observation: NDArray[np.float64]) -> None:
        self.indices.write(physics, observation)
        self._mdp.sensors.refresh(physics)
        reading = self._mdp.sensors.read(self._simulation)
        self._set_state(
            self._state._replace(
                positions=reading.positions,
                target=reading.positions,
                achieved=reading.achieved,
                distances=self._mdp.goals.distances(reading.achieved),
                shaping=self._mdp.start_shaping(reading),
            )
        )
        self._start_command(physics)

    def set_observed_positions(self, observation: NDArray[np.float64]) -> None:
        robot, changed = noise.SLICES[0], self._state.noise.copy()
        changed[robot] = observation[robot] - self._state.positions
        self._set_state(self._state._replace(noise=changed))

    def _bind(self, physics: mjcf.Physics) -> None:
        self._highlighting = GoalHighlighting(physics, self._scene, self._mdp.goals)
        goals = dict(zip(self._mdp.goals.tasks, self._mdp.goals.goals, strict=True))
        self._starts = starts(goals, self._scene, physics)

    def _reset_physics(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        self._draw_tasks(random_state)
        indices, data = self.indices, physics.data
        data.qpos[indices.robot_qpos] = INITIAL_QPOS[: indices.robot_qpos.size]
        data.qpos[indices.object_qpos] = INITIAL_QPOS[indices.robot_qpos.size :]
        for start in self._asked_starts():
            data.qpos[start.columns] = start.positions
        data.qvel[:] = 0.0
        data.ctrl[:] = 0.0

    def _asked_starts(self) -> list[Start]:
        """Returns the starts of the tasks that the episode that starts asks for."""
        return [start for task, start in self._starts.items() if task in self.tasks_in(self._start_order)]

    def _corrected(self, values: Values) -> Values:
        """Returns values with which props that start near an asked goal, or out of bounds, start as by default."""
        goals, achieved = self._mdp.goals, self._mdp.sensors.read(self._simulation).achieved
        near = self._mdp.success.within(achieved, goals.distances(achieved), factor=START_DISTANCE) & self._is_asked()
        qpos = self._simulation.read("qpos", slice(None))
        props = {GOALS[task].prop for task in goals.names(near)}
        props |= {start.prop for start in self._asked_starts() if not start.allows(qpos)}
        if not props:
            return values
        moved = [name for name in self.variations.randomizer.displacements if name.partition("/")[0] in props]
        return {**values, **{name: self.variations.randomizer.defaults[name] for name in moved}}

    def _saved_state(self) -> dict[str, Any]:
        goals = self._mdp.goals
        tasks = {"tasks": ", ".join(goals.tasks), "desired": goals.desired.copy()}
        return {**tasks, **as_dict(self._state), **self._saved_requests()}

    def _restore_state(self, state: Mapping[str, Any]) -> None:
        goals = self._mdp.goals
        if not np.array_equal(state["desired"], goals.desired):
            raise ValueError(f"the state has other goals, {state['desired']}, than the task, {goals.desired}")
        self._restore_requests(state)
        self._set_state(from_dict(state))

    def _show(self, physics: mjcf.Physics | None) -> None:
        """Updates observation noise and colours."""
        del physics
        self._observables.noise[:] = self._state.noise
        if self._visualize_reward:
            self._highlighting.update(self._state.progress.within)
