"""Indices of a scene's joints and actuators in MuJoCo's arrays."""

import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities.joints import addresses
from kitchen_suite.entities.scenes.scene import Scene
from kitchen_suite.tasks.goals import GoalSet


class SceneIndices:
    """Indices of robot, objects and goals in MuJoCo's arrays; valid for one compiled model.

    Attributes:
      robot_qpos: `(9,)`, qpos of the robot's joints.
      robot_qvel: `(9,)`, qvel of the robot's joints.
      object_qpos: qpos of the objects' joints, in the order of observation; `(21,)` in the kitchen.
      object_qvel: qvel of the objects' joints, in the order of observation; `(20,)` in the kitchen.
      goal_qpos: `(k,)`, qpos that the goals are set for, end to end.
      ctrl: `(9,)`, ctrl of the robot's actuators.
    """

    def __init__(self, scene: Scene, goals: GoalSet, physics: mjcf.Physics) -> None:
        """Looks up all indices.

        Raises:
          ValueError: the scene lacks a prop or a joint of a goal, or a goal has not as many values as its joints.
        """
        self.robot_qpos, self.robot_qvel = addresses(physics, scene.robot.joints)
        self.object_qpos, self.object_qvel = addresses(physics, scene.object_joints)
        goal_qpos = [addresses(physics, goal.joints_in(scene))[0] for goal in goals.goals]
        for task, goal, indices in zip(goals.tasks, goals.goals, goal_qpos, strict=True):
            if indices.size != len(goal.value):
                raise ValueError(f"goal of {task!r} must have {indices.size} values, got {goal.value}")
        self.goal_qpos = np.concatenate(goal_qpos)
        self.ctrl = physics.bind(scene.robot.actuators).element_id

    def write(self, physics: mjcf.Physics, observation: NDArray[np.float64]) -> None:
        """Sets qpos and qvel to those of an observation: positions and velocities of robot, then of objects."""
        data, start = physics.data, 0
        parts = (
            ("qpos", self.robot_qpos),
            ("qvel", self.robot_qvel),
            ("qpos", self.object_qpos),
            ("qvel", self.object_qvel),
        )
        for field, indices in parts:
            getattr(data, field)[indices] = observation[start : start + indices.size]
            start += indices.size
