"""The kitchen's multitask goal: bring some of seven things to where they should be."""

import collections
import functools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from dm_control import mjcf
from dm_control.composer.observation import observable
from dm_env import specs
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks
from kitchen_suite.entities import Kitchen, KitchenArena
from kitchen_suite.tasks import noise
from kitchen_suite.tasks.goal_colours import GoalColours
from kitchen_suite.tasks.goals import GOALS, THRESHOLD, GoalSet, Progress
from kitchen_suite.tasks.joints import addresses
from kitchen_suite.tasks.kitchen_start import INITIAL_QPOS
from kitchen_suite.tasks.suite_task import SuiteTask
from kitchen_suite.tasks.velocity_control import position_target

PHYSICS_TIMESTEP = 0.002  # [s]
CONTROL_TIMESTEP = 0.08  # [s]
TIME_LIMIT = 22.4  # [s], 280 control steps
FEEDBACKS = ("observed", "true", "target")


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

    _progress: Progress

    def __init__(
        self,
        kitchen: Kitchen,
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
          kitchen: where it takes place; one kitchen serves one task.
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
        self._goals = GoalSet.build(tasks_to_complete, goals)
        self._terminate_on_tasks_completed = checks.flag(terminate_on_tasks_completed, "terminate_on_tasks_completed")
        self._remove_task_when_completed = checks.flag(remove_task_when_completed, "remove_task_when_completed")
        self._velocity_scale = checks.number(velocity_scale, "velocity_scale")
        self._threshold = checks.number(threshold, "threshold")
        self._feedback = checks.choice(feedback, FEEDBACKS, "feedback")
        self._noise_scale = noise.scale(
            robot_ratio=checks.number(robot_noise_ratio, "robot_noise_ratio"),
            object_ratio=checks.number(object_noise_ratio, "object_noise_ratio"),
        )
        self._desired = self._goals.split(self._goals.desired)
        self._kitchen = kitchen
        self._noise = np.zeros(self._noise_scale.size)
        self._observables = self._build_observables()
        self.set_timesteps(control_timestep=CONTROL_TIMESTEP, physics_timestep=PHYSICS_TIMESTEP)

    def _build_observables(self) -> collections.OrderedDict[str, observable.Observable]:
        """All observables by public key: the 59 numbers in their order, then the goals."""
        prefix = self._kitchen.robot.mjcf_model.full_identifier
        robot = self._kitchen.robot.observables
        state = {
            f"{prefix}joint_positions": robot.joint_positions,
            f"{prefix}joint_velocities": robot.joint_velocities,
            "object_positions": observable.Generic(self._object_positions),
            "object_velocities": observable.Generic(self._object_velocities),
        }
        for shown, part in zip(state.values(), noise.PARTS, strict=True):
            shown.corruptor = noise.AddNoise(self._noise[part])
        goals = {
            **{f"achieved_goal/{task}": functools.partial(self._achieved_goal, task) for task in self._goals.tasks},
            **{f"desired_goal/{task}": functools.partial(self._desired_goal, task) for task in self._goals.tasks},
        }
        observables = collections.OrderedDict(state)
        observables.update((key, observable.Generic(function)) for key, function in goals.items())
        for shown in observables.values():
            shown.enabled = True
        return observables

    @property
    def root_entity(self) -> KitchenArena:
        return self._kitchen.arena

    @property
    def kitchen(self) -> Kitchen:
        """Where the task takes place."""
        return self._kitchen

    @property
    def task_observables(self) -> collections.OrderedDict[str, observable.Observable]:
        # The robot's own are among them: composer adds the entities' later, and a key keeps its first place.
        return self._observables.copy()

    @property
    def goals(self) -> dict[str, NDArray[np.float64]]:
        """Goal of each task, in configured order."""
        return self._goals.split(self._goals.desired.copy())

    @property
    def threshold(self) -> float:
        """Distance from the goal below which a task is complete [rad, m]."""
        return self._threshold

    @property
    def velocity_scale(self) -> float:
        """Velocity that a unit of action stands for [rad/s, m/s]."""
        return self._velocity_scale

    @property
    def feedback(self) -> str:
        """What the action's velocities are integrated from, one of `FEEDBACKS`."""
        return self._feedback

    @property
    def goal_set(self) -> GoalSet:
        """The configured tasks, with their goals laid end to end."""
        return self._goals

    @property
    def progress(self) -> Progress:
        """How far the tasks are; arrays of shape `(n,)`, in configured order."""
        return self._progress

    @property
    def task_distances(self) -> NDArray[np.float64]:
        """Distance of each task from its goal, in configured order [rad, m]."""
        return self._distances.copy()

    @property
    def tasks_to_complete(self) -> list[str]:
        """Tasks still to be completed, in configured order."""
        return self._names(self._progress.remaining)

    @property
    def step_task_completions(self) -> list[str]:
        """Tasks that paid in the last step, in configured order."""
        return self._names(self._progress.completions)

    @property
    def episode_task_completions(self) -> list[str]:
        """Tasks completed in this episode, in order of completion."""
        return list(self.completion_steps)

    @property
    def completion_steps(self) -> dict[str, int]:
        """Control step, from 1, at which each task was first completed, in order of completion."""
        steps = zip(self._goals.tasks, self._progress.completion_steps.tolist(), strict=True)
        return dict(sorted(((task, step) for task, step in steps if step > 0), key=lambda item: item[1]))

    @property
    def episode_results(self) -> dict[str, bool | float | dict[str, int]]:
        steps = self.completion_steps
        return {"success": len(steps) == len(self._goals.tasks), "tasks_completed": steps}

    def action_spec(self, physics: mjcf.Physics) -> specs.BoundedArray:
        """Nine joint velocities, as a share of `velocity_scale`; values outside [-1, 1] are clipped."""
        del physics
        names = [actuator.full_identifier for actuator in self._kitchen.robot.actuators]
        ones = np.ones(len(names))
        return specs.BoundedArray(ones.shape, ones.dtype, minimum=-ones, maximum=ones, name="\t".join(names))

    def after_compile(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        self._random = random_state
        robot, objects = self._kitchen.robot.joints, self._kitchen.object_joints
        self._robot_qpos, _ = addresses(physics, robot)
        self._object_qpos, self._object_qvel = addresses(physics, objects)
        self._ctrl = physics.bind(self._kitchen.robot.actuators).element_id
        self._goal_qpos = self._object_qpos[self._goals.elements]
        self._task_qpos = self._goals.split(self._goal_qpos)
        self._colours = GoalColours(physics, self._goals.tasks, objects)
        self._start(physics)

    def initialize_episode(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        physics.data.qpos[self._robot_qpos] = INITIAL_QPOS[: self._robot_qpos.size]
        physics.data.qpos[self._object_qpos] = INITIAL_QPOS[self._robot_qpos.size :]
        physics.data.qvel[:] = 0.0
        physics.data.ctrl[:] = 0.0
        self._observe(physics, random_state)
        self._start(physics)

    def before_step(self, physics: mjcf.Physics, action: ArrayLike, random_state: np.random.RandomState) -> None:
        """Sets the servos' targets for the whole control step.

        Raises:
          TypeError: the action does not hold real numbers.
          ValueError: the action has another shape than (9,), or holds NaN or inf.
        """
        velocities = checks.vector(action, self._ctrl.size, "action")
        self._random = random_state
        self._target = position_target(
            self._feedback_positions, velocities, velocity_scale=self._velocity_scale, timestep=CONTROL_TIMESTEP
        )
        physics.data.ctrl[self._ctrl] = self._target

    def after_step(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        self._observe(physics, random_state)
        self._distances = self._goals.distances(physics.data.qpos[self._goal_qpos])
        self._progress = self._progress.advance(
            self._distances < self._threshold, remove_task_when_completed=self._remove_task_when_completed
        )
        self._paint()

    def get_reward(self, physics: mjcf.Physics) -> float:
        del physics
        return float(self._progress.reward)

    def should_terminate_episode(self, physics: mjcf.Physics) -> bool:
        del physics
        return self._terminate_on_tasks_completed and bool(self._progress.completed.all())

    def get_state(self) -> dict[str, Any]:
        return {
            "tasks": ", ".join(self._goals.tasks),
            "desired": self._goals.desired.copy(),
            "noise": self._noise.copy(),
            "positions": self._positions.copy(),
            "target": self._target.copy(),
            "distances": self._distances.copy(),
            "progress": {name: array.copy() for name, array in vars(self._progress).items()},
        }

    def set_state(self, state: Mapping[str, Any]) -> None:
        state = checks.like(state, self.get_state(), "task state")
        if not np.array_equal(state["desired"], self._goals.desired):
            raise ValueError(f"the state is of other goals, {state['desired']}, than {self._goals.desired}")
        self._noise[:] = state["noise"]
        self._positions, self._target = state["positions"], state["target"]
        self._distances, self._progress = state["distances"], Progress(**state["progress"])
        self._paint()

    def _start(self, physics: mjcf.Physics) -> None:
        """Nothing has been completed or commanded yet."""
        self._target = self._positions = self._true_positions(physics)
        self._distances = self._goals.distances(physics.data.qpos[self._goal_qpos])
        self._progress = Progress.start((len(self._goals.tasks),))
        self._paint()

    def _observe(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        """Draws the noise of this control step, and notes what the robot sees of itself."""
        self._random = random_state
        self._noise[:] = self._noise_scale * random_state.uniform(-1.0, 1.0, self._noise.size)
        self._positions = self._true_positions(physics)

    def _paint(self) -> None:
        if self._visualize_reward:
            self._colours.paint(self._progress.within)

    @property
    def _feedback_positions(self) -> NDArray[np.float64]:
        """What the velocities of the next action are integrated from."""
        if self._feedback == "target":
            return self._target
        return self._positions + self._noise[noise.PARTS[0]] if self._feedback == "observed" else self._positions

    def _true_positions(self, physics: mjcf.Physics) -> NDArray[np.float64]:
        return physics.data.qpos[self._robot_qpos]

    def _object_positions(self, physics: mjcf.Physics) -> NDArray[np.float64]:
        """Positions of the things' joints: `(21,)` float64 [rad, m]; qpos; noise by `object_noise_ratio`."""
        return physics.data.qpos[self._object_qpos]

    def _object_velocities(self, physics: mjcf.Physics) -> NDArray[np.float64]:
        """Velocities of the things' joints: `(20,)` float64 [rad/s, m/s]; qvel; noise by `object_noise_ratio`."""
        return physics.data.qvel[self._object_qvel]

    def _achieved_goal(self, task: str, physics: mjcf.Physics) -> NDArray[np.float64]:
        """Present values of what a task's goal is about: `(m,)` float64 [rad, m, quaternion]; qpos; no noise."""
        return physics.data.qpos[self._task_qpos[task]]

    def _desired_goal(self, task: str, physics: mjcf.Physics) -> NDArray[np.float64]:
        """Goal of a task: `(m,)` float64 [rad, m, quaternion]; configuration; no noise."""
        del physics
        return self._desired[task]

    def _names(self, mask: NDArray[np.bool_]) -> list[str]:
        return [task for task, chosen in zip(self._goals.tasks, mask, strict=True) if chosen]
