"""Indices of the kitchen's joints and actuators in MuJoCo's arrays."""

import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities import KitchenScene
from kitchen_suite.entities.joints import addresses, owners
from kitchen_suite.tasks.kitchen import noise
from kitchen_suite.tasks.kitchen.goals import GOALS, GoalSet
from kitchen_suite.tasks.kitchen.initial_state import PROPS


class KitchenIndices:
    """Indices of robot, objects and goals in MuJoCo's arrays; valid for one compiled model.

    Attributes:
      robot_qpos: `(9,)`, qpos of the robot's joints.
      robot_qvel: `(9,)`, qvel of the robot's joints.
      object_qpos: `(21,)`, qpos of the objects' joints, in the order of the observation.
      object_qvel: `(20,)`, qvel of the objects' joints, in the order of the observation.
      goal_qpos: `(k,)`, qpos that the goals are set for, end to end.
      ctrl: `(9,)`, ctrl of the robot's actuators.
    """

    def __init__(self, scene: KitchenScene, goals: GoalSet, physics: mjcf.Physics) -> None:
        """Looks up all indices.

        Raises:
          ValueError: the scene's objects or their joints are not in the order that start, noise and goals assume.
        """
        _check_order(scene, goals, physics)
        self.robot_qpos, self.robot_qvel = addresses(physics, scene.robot.joints)
        self.object_qpos, self.object_qvel = addresses(physics, scene.object_joints)
        self.goal_qpos = self.object_qpos[goals.elements]
        self.ctrl = physics.bind(scene.robot.actuators).element_id

    def observed(self, qpos: NDArray[np.float64], qvel: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the 59 elements of the observation, `(..., 59)`, without noise."""
        parts = qpos[..., self.robot_qpos], qvel[..., self.robot_qvel]
        return np.concatenate([*parts, qpos[..., self.object_qpos], qvel[..., self.object_qvel]], axis=-1)

    def write(self, physics: mjcf.Physics, observation: NDArray[np.float64]) -> None:
        """Sets qpos and qvel to those of an observation `(59,)`."""
        robot_qpos, robot_qvel, object_qpos, object_qvel = (observation[part] for part in noise.SLICES)
        data = physics.data
        data.qpos[self.robot_qpos], data.qvel[self.robot_qvel] = robot_qpos, robot_qvel
        data.qpos[self.object_qpos], data.qvel[self.object_qvel] = object_qpos, object_qvel


def _check_order(scene: KitchenScene, goals: GoalSet, physics: mjcf.Physics) -> None:
    props = tuple(name for name, prop in scene.props.items() if prop.joints)
    if props != PROPS:
        raise ValueError(f"the kitchen's props with joints must be {PROPS}, in this order, got {props}")
    joint_of_element = owners(physics, scene.object_joints)
    for task in goals.tasks:
        goal, indices = GOALS[task], joint_of_element[list(GOALS[task].elements)]
        joints = tuple(dict.fromkeys(scene.object_joints[i].full_identifier for i in indices))
        if joints != goal.joints:
            raise ValueError(f"elements {goal.elements} of task {task!r} must belong to {goal.joints}, got {joints}")
