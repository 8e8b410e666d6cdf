"""The kitchen's observations as composer observables: 59 noisy numbers in four parts, then the goals."""

import collections
import functools

import numpy as np
from dm_control import mjcf
from dm_control.composer.observation import observable
from numpy.typing import NDArray

from kitchen_suite.entities import Kitchen
from kitchen_suite.tasks import noise
from kitchen_suite.tasks.goals import GoalSet
from kitchen_suite.tasks.kitchen_layout import KitchenLayout


class KitchenObservables:
    """What is seen in the kitchen; all of it enabled.

    Attributes:
      by_name: the observables by public key. The robot's own are among them: composer adds the entities' later, and a
        key keeps its first place.
      noise: `(59,)`, what is added to the present observation; the task writes it.
    """

    def __init__(self, kitchen: Kitchen, goals: GoalSet) -> None:
        """Builds the observables."""
        self.noise = np.zeros(noise.AMPLITUDES.size)
        self._desired = goals.split(goals.desired)
        self._goals = goals
        prefix, robot = kitchen.robot.mjcf_model.full_identifier, kitchen.robot.observables
        state = {
            f"{prefix}joint_positions": robot.joint_positions,
            f"{prefix}joint_velocities": robot.joint_velocities,
            "object_positions": observable.Generic(self._object_positions),
            "object_velocities": observable.Generic(self._object_velocities),
        }
        for shown, part in zip(state.values(), noise.PARTS, strict=True):
            shown.corruptor = noise.AddNoise(self.noise[part])
        achieved = {f"achieved_goal/{task}": functools.partial(self._achieved_goal, task) for task in goals.tasks}
        desired = {f"desired_goal/{task}": functools.partial(self._desired_goal, task) for task in goals.tasks}
        self.by_name: collections.OrderedDict[str, observable.Observable] = collections.OrderedDict(state)
        self.by_name.update((key, observable.Generic(function)) for key, function in {**achieved, **desired}.items())
        for shown in self.by_name.values():
            shown.enabled = True

    def bind(self, layout: KitchenLayout) -> None:
        """Notes where things stand in a compiled model."""
        self._object_qpos, self._object_qvel = layout.object_qpos, layout.object_qvel
        self._task_qpos = self._goals.split(layout.goal_qpos)

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
