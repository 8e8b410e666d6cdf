"""The kitchen's multitask goal: bring some of seven things to where they should be."""

import collections
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from dm_control import mjcf
from dm_control.composer.observation import observable
from dm_env import specs
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks
from kitchen_suite.entities import KitchenArena, KitchenScene
from kitchen_suite.tasks.base import SuiteTask
from kitchen_suite.tasks.kitchen import noise
from kitchen_suite.tasks.kitchen.goals import GOALS, THRESHOLD, GoalSet, Progress
from kitchen_suite.tasks.kitchen.highlighting import GoalHighlighting
from kitchen_suite.tasks.kitchen.indices import KitchenIndices
from kitchen_suite.tasks.kitchen.initial_state import INITIAL_QPOS
from kitchen_suite.tasks.kitchen.mdp import (
    CONTROL_TIMESTEP,
    FEEDBACKS,
    PHYSICS_TIMESTEP,
    KitchenMDP,
    KitchenState,
    as_dict,
)
from kitchen_suite.tasks.kitchen.observables import KitchenObservables

TIME_LIMIT = 22.4  # [s], 280 control steps


class KitchenTask(SuiteTask):
    """Complete a set of tasks in the kitchen.

    Start: the robot bent over the counter, everything closed and off, the kettle on the bottom left burner; always the
      same but for the observation noise.
    Reward: of each step, the number of tasks within their threshold after it, among those still to be completed.
    End: discount 0 once every task has been completed at some step (unless told otherwise); at the time limit
      discount 1.
    Observations: noisy joint positions and velocities of robot and things, 59 numbers; goals without noise.
    Source: FrankaKitchen-v1 of gymnasium-robotics 1.4.2 (Relay Policy Learning, D4RL).
    """

    def __init__(
        self,
        scene: KitchenScene,
        *,
        tasks_to_complete: Sequence[str] = tuple(GOALS),
        terminate_on_tasks_completed: bool = True,
        remove_task_when_completed: bool = True,
        object_noise_ratio: float = 0.0005,
        robot_noise_ratio: float = 0.01,
        velocity_scale: float = 2.0,
        goals: Mapping[str, ArrayLike] | None = None,
        threshold: float = THRESHOLD,
        feedback: str = "observed",
    ) -> None:
        """Sets the task up in a kitchen.

        Args:
          scene: the furnished kitchen; one scene serves one task.
          tasks_to_complete: names of the tasks, spelt as in `goals.GOALS`; the order is kept wherever they are listed.
          terminate_on_tasks_completed: whether the episode terminates once every task has been completed.
          remove_task_when_completed: whether a task pays once (`True`), or in every step within its threshold.
          object_noise_ratio: scale of the noise on what is seen of the things; 0 for none.
          robot_noise_ratio: scale of the noise on what is seen of the robot; 0 for none.
          velocity_scale: velocity that a unit of action stands for [rad/s, m/s].
          goals: goals that replace the usual ones, by task.
          threshold: distance from the goal below which a task is complete [rad, m].
          feedback: what the action's velocities are integrated from: the positions last `observed`, noise included
            (as the reference does); the `true` positions; or the last `target`, so that zero action holds still.

        Raises:
          TypeError: an argument of the wrong type.
          ValueError: an unknown, repeated or missing name, a goal of the wrong length, or a number that is negative or
            not finite.
        """
        ratios = {
            "robot_ratio": checks.number(robot_noise_ratio, "robot_noise_ratio"),
            "object_ratio": checks.number(object_noise_ratio, "object_noise_ratio"),
        }
        self._mdp = KitchenMDP(
            goals=GoalSet.build(tasks_to_complete, goals),
            noise_scale=noise.scale(**ratios),
            threshold=checks.number(threshold, "threshold"),
            velocity_scale=checks.number(velocity_scale, "velocity_scale"),
            feedback=checks.choice(feedback, FEEDBACKS, "feedback"),
            terminate_on_tasks_completed=checks.boolean(terminate_on_tasks_completed, "terminate_on_tasks_completed"),
            remove_task_when_completed=checks.boolean(remove_task_when_completed, "remove_task_when_completed"),
        )
        self._scene = scene
        self._observables = KitchenObservables(scene, self._mdp.goals)
        self.set_timesteps(control_timestep=CONTROL_TIMESTEP, physics_timestep=PHYSICS_TIMESTEP)

    @property
    def root_entity(self) -> KitchenArena:
        return self._scene.arena

    @property
    def scene(self) -> KitchenScene:
        """Where the task takes place."""
        return self._scene

    @property
    def task_observables(self) -> collections.OrderedDict[str, observable.Observable]:
        return self._observables.by_name.copy()

    @property
    def mdp(self) -> KitchenMDP:
        """The task's settings, and the mathematics of an episode under them."""
        return self._mdp

    @property
    def indices(self) -> KitchenIndices:
        """Where things stand in the arrays of the compiled model."""
        return self._indices

    @property
    def state(self) -> KitchenState:
        """What the episode remembers; arrays without leading axes, not to be written to."""
        return self._state

    @property
    def goals(self) -> dict[str, NDArray[np.float64]]:
        """Goal of each task, in configured order."""
        return self._mdp.goals.split(self._mdp.goals.desired.copy())

    @property
    def threshold(self) -> float:
        """Distance from the goal below which a task is complete [rad, m]."""
        return self._mdp.threshold

    @property
    def progress(self) -> Progress:
        """How far the tasks are; arrays of shape `(n,)`, in configured order."""
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
        """Tasks that paid in the last step, in configured order."""
        return self._mdp.goals.names(self.progress.completions)

    @property
    def episode_task_completions(self) -> list[str]:
        """Tasks completed in this episode, in order of completion."""
        return list(self.completion_steps)

    @property
    def completion_steps(self) -> dict[str, int]:
        """Control step, from 1, at which each task was first completed, in order of completion."""
        return self._mdp.goals.by_completion(self.progress.completion_steps)

    @property
    def episode_results(self) -> dict[str, bool | float | dict[str, int]]:
        steps = self.completion_steps
        return {"success": len(steps) == len(self._mdp.goals.tasks), "tasks_completed": steps}

    def action_spec(self, physics: mjcf.Physics) -> specs.BoundedArray:
        """Nine joint velocities, as a share of `velocity_scale`; values outside [-1, 1] are clipped."""
        del physics
        names = [actuator.full_identifier for actuator in self._scene.robot.actuators]
        ones = np.ones(len(names))
        return specs.BoundedArray(ones.shape, ones.dtype, minimum=-ones, maximum=ones, name="\t".join(names))

    def after_compile(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        self._random = random_state
        self._indices = KitchenIndices(self._scene, self._mdp.goals, physics)
        self._highlighting = GoalHighlighting(physics, self._mdp.goals.tasks, self._scene.object_joints)
        self._show(self._mdp.initial_state(*self._positions(physics)))

    def initialize_episode(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        layout, data = self._indices, physics.data
        data.qpos[layout.robot_qpos] = INITIAL_QPOS[: layout.robot_qpos.size]
        data.qpos[layout.object_qpos] = INITIAL_QPOS[layout.robot_qpos.size :]
        data.qvel[:] = 0.0
        data.ctrl[:] = 0.0
        self._show(self._mdp.initial_state(*self._positions(physics), self._draw(random_state)))

    def before_step(self, physics: mjcf.Physics, action: ArrayLike, random_state: np.random.RandomState) -> None:
        """Sets the servos' targets for the whole control step.

        Raises:
          TypeError: the action does not hold real numbers.
          ValueError: the action has another shape than (9,), or holds NaN or inf.
        """
        velocities = checks.vector(action, self._indices.ctrl.size, "action")
        self._random = random_state
        self._target = self._mdp.compute_control(self._state, velocities)
        physics.data.ctrl[self._indices.ctrl] = self._target

    def after_step(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        positions, achieved = self._positions(physics)
        draw = self._draw(random_state)
        self._show(self._mdp.step(self._state, target=self._target, positions=positions, achieved=achieved, draw=draw))

    def get_reward(self, physics: mjcf.Physics) -> float:
        del physics
        return float(self.progress.reward)

    def should_terminate_episode(self, physics: mjcf.Physics) -> bool:
        del physics
        return self._terminates

    def get_state(self) -> dict[str, Any]:
        goals = self._mdp.goals
        return {"tasks": ", ".join(goals.tasks), "desired": goals.desired.copy(), **as_dict(self._state)}

    def set_state(self, state: Mapping[str, Any]) -> None:
        state, goals = checks.matching(state, self.get_state(), "task state"), self._mdp.goals
        if not np.array_equal(state["desired"], goals.desired):
            raise ValueError(f"the state is of other goals, {state['desired']}, than {goals.desired}")
        arrays = {name: state[name] for name in KitchenState._fields}
        self._show(KitchenState(**{**arrays, "progress": Progress(**state["progress"])}))

    def _show(self, state: KitchenState) -> None:
        """Takes up a state; things show it by their noise and colour."""
        self._state = state
        self._terminates = bool(self._mdp.terminates(state))
        self._observables.noise[:] = state.noise
        if self._visualize_reward:
            self._highlighting.paint(state.progress.within)

    def _draw(self, random_state: np.random.RandomState) -> NDArray[np.float64]:
        """Draws for the noise of one control step."""
        self._random = random_state
        return random_state.uniform(-1.0, 1.0, self._mdp.noise_scale.size)

    def _positions(self, physics: mjcf.Physics) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Where the robot's joints are, and what the goals are about; copies."""
        qpos = physics.data.qpos
        return qpos[self._indices.robot_qpos], qpos[self._indices.goal_qpos]
