"""Where things of the kitchen stand in MuJoCo's arrays."""

import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities import KitchenScene
from kitchen_suite.entities.joints import addresses
from kitchen_suite.tasks.kitchen.goals import GoalSet


class KitchenIndices:
    """Where robot, things and goals stand in MuJoCo's arrays; good for one compiled model.

    Attributes:
      robot_qpos: `(9,)`, of the robot's joints.
      robot_qvel: `(9,)`, likewise.
      object_qpos: `(21,)`, of the things', in the order of the observation.
      object_qvel: `(20,)`, likewise.
      goal_qpos: `(k,)`, of what the goals are about, end to end.
      ctrl: `(9,)`, of the robot's joint_actuators.
    """

    def __init__(self, scene: KitchenScene, goals: GoalSet, physics: mjcf.Physics) -> None:
        """Looks everything up."""
        self.robot_qpos, self.robot_qvel = addresses(physics, scene.robot.joints)
        self.object_qpos, self.object_qvel = addresses(physics, scene.object_joints)
        self.goal_qpos = self.object_qpos[goals.elements]
        self.ctrl = physics.bind(scene.robot.actuators).element_id

    def observed(self, qpos: NDArray[np.float64], qvel: NDArray[np.float64]) -> NDArray[np.float64]:
        """The 59 numbers of the observation, `(..., 59)`, without noise."""
        parts = qpos[..., self.robot_qpos], qvel[..., self.robot_qvel]
        return np.concatenate([*parts, qpos[..., self.object_qpos], qvel[..., self.object_qvel]], axis=-1)
