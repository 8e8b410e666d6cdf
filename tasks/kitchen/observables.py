"""The kitchen's observation as composer observables: 59 noisy numbers in four parts, then the goals."""

import collections
import functools
from collections.abc import Callable, Mapping

import numpy as np
from dm_control import mjcf
from dm_control.composer.observation import observable
from numpy.typing import NDArray

from kitchen_suite.entities import Scene
from kitchen_suite.entities.joints import JointPositions, JointVelocities
from kitchen_suite.tasks.goals import GoalSet
from kitchen_suite.tasks.kitchen import noise
from kitchen_suite.tasks.kitchen.requested import REQUESTED


class KitchenObservables:
    """The enabled observables of the kitchen.

    - `franka/joint_positions` `(9,)` [rad, m] and `franka/joint_velocities` `(9,)` [rad/s, m/s]: the robot's own
      observables; noise by `robot_noise_ratio`.
    - `object_positions` `(21,)` [rad, m, quaternion] and `object_velocities` `(20,)` [rad/s, m/s]: qpos and qvel of the
      objects' joints; noise by `object_noise_ratio`.
    - `achieved_goal/<task>` and `desired_goal/<task>` `(m,)` [rad, m, quaternion]: present positions of the joints that
      a task's goal is set for, from qpos, and the goal; no noise.
    - `requested_tasks` `(n,)`, with `tasks_per_episode` only: 1 where a task is asked, 0 elsewhere.

    The task draws the noise of all parts at once and writes it to `noise`, from which each part's corruptor reads.

    Attributes:
      by_name: the observables by observation key. The robot's own are included to be first in order: composer adds
        those of the entities after them.
      noise: `(59,)`, noise of the present observation.
    """

    def __init__(
        self,
        scene: Scene,
        goals: GoalSet,
        extra: Mapping[str, observable.Observable],
        requested: Callable[[], NDArray[np.float64]] | None = None,
    ) -> None:
        """Builds the observables.

        Args:
          scene: the kitchen.
          goals: the tasks.
          extra: observables that come between state and goals.
          requested: returns the last observable, `requested_tasks`; None for none.
        """
        self.noise = np.zeros(noise.AMPLITUDES.size)
        prefix, robot = scene.robot.mjcf_model.full_identifier, scene.robot.observables
        state = {
            f"{prefix}joint_positions": robot.joint_positions,
            f"{prefix}joint_velocities": robot.joint_velocities,
            "object_positions": JointPositions(lambda: scene.object_joints),
            "object_velocities": JointVelocities(lambda: scene.object_joints),
        }
        for part, indices in zip(state.values(), noise.SLICES, strict=True):
            part.corruptor = noise.AddNoise(self.noise[indices])
        achieved = {
            f"achieved_goal/{task}": JointPositions(functools.partial(goal.joints_in, scene))
            for task, goal in zip(goals.tasks, goals.goals, strict=True)
        }
        desired = {
            f"desired_goal/{task}": observable.Generic(functools.partial(_constant, goal))
            for task, goal in goals.split(goals.desired).items()
        }
        self.by_name: collections.OrderedDict[str, observable.Observable] = collections.OrderedDict(
            {**state, **extra, **achieved, **desired}
        )
        if requested is not None:
            self.by_name[REQUESTED] = observable.Generic(lambda physics: requested())
        for part in self.by_name.values():
            part.enabled = True


def _constant(value: NDArray[np.float64], physics: mjcf.Physics) -> NDArray[np.float64]:
    del physics
    return value
