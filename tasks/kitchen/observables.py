"""The kitchen's observations as composer observables: 59 noisy numbers in four parts, then the goals."""

import collections
import functools

import numpy as np
from dm_control import mjcf
from dm_control.composer.observation import observable
from numpy.typing import NDArray

from kitchen_suite.entities import KitchenScene
from kitchen_suite.entities.joint_observables import JointPositions, JointVelocities
from kitchen_suite.tasks.kitchen import noise
from kitchen_suite.tasks.kitchen.goals import GOALS, GoalSet


class KitchenObservables:
    """What is seen in the kitchen; all of it enabled.

    - `franka/joint_positions` `(9,)` [rad, m] and `franka/joint_velocities` `(9,)` [rad/s, m/s]: the robot's own
      observables; noise by `robot_noise_ratio`.
    - `object_positions` `(21,)` [rad, m, quaternion] and `object_velocities` `(20,)` [rad/s, m/s]: qpos and qvel of the
      things' joints; noise by `object_noise_ratio`.
    - `achieved_goal/<task>` and `desired_goal/<task>` `(m,)` [rad, m, quaternion]: present values of what a task's goal
      is about, from qpos, and its goal, from the configuration; no noise.

    Attributes:
      by_name: the observables by public key. The robot's own are among them: composer adds the entities' later, and a
        key keeps its first place.
      noise: `(59,)`, what is added to the present observation; the task writes it.
    """

    def __init__(self, scene: KitchenScene, goals: GoalSet) -> None:
        """Builds the observables."""
        self.noise = np.zeros(noise.AMPLITUDES.size)
        prefix, robot = scene.robot.mjcf_model.full_identifier, scene.robot.observables
        state = {
            f"{prefix}joint_positions": robot.joint_positions,
            f"{prefix}joint_velocities": robot.joint_velocities,
            "object_positions": JointPositions(lambda: scene.object_joints),
            "object_velocities": JointVelocities(lambda: scene.object_joints),
        }
        for shown, part in zip(state.values(), noise.PARTS, strict=True):
            shown.corruptor = noise.AddNoise(self.noise[part])
        achieved = {
            f"achieved_goal/{task}": JointPositions(lambda: scene.object_joints, GOALS[task].elements)
            for task in goals.tasks
        }
        desired = {
            f"desired_goal/{task}": observable.Generic(functools.partial(_constant, goal))
            for task, goal in goals.split(goals.desired).items()
        }
        self.by_name: collections.OrderedDict[str, observable.Observable] = collections.OrderedDict(
            {**state, **achieved, **desired}
        )
        for shown in self.by_name.values():
            shown.enabled = True


def _constant(value: NDArray[np.float64], physics: mjcf.Physics) -> NDArray[np.float64]:
    del physics
    return value
