"""Sensors of the kitchen: positions of the robot's joints, achieved goals, positions and velocities of all joints."""

from typing import NamedTuple

import mujoco
import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities import Scene
from kitchen_suite.entities.scenes.kitchen import OBSERVED_PROPS
from kitchen_suite.tasks.goals import GoalSet
from kitchen_suite.tasks.indices import SceneIndices
from kitchen_suite.tasks.simulation import Simulation


class KitchenReading(NamedTuple):
    """Joint positions after a control step.

    Attributes:
      positions: `(..., 9)`, of the robot [rad, m].
      achieved: `(..., k)`, those that goals are set for, end to end [rad, m, quaternion].
    """

    positions: NDArray[np.float64]
    achieved: NDArray[np.float64]


class KitchenSensors:
    """Reads the joints of robot and objects.

    Attributes:
      indices: of the joints in the compiled model.
    """

    # Joint positions and velocities are up to date after every physics step.
    stage = mujoco.mjtStage.mjSTAGE_NONE

    def __init__(self, scene: Scene, goals: GoalSet) -> None:
        """Stores robot and objects, and the tasks whose joints are read.

        Raises:
          ValueError: the scene's props with joints are not those of the kitchen, in its order, for which the tables of
            initial state and noise are made.
        """
        observed = tuple(name for name, prop in scene.props.items() if prop.joints)
        if observed != OBSERVED_PROPS:
            raise ValueError(f"the kitchen's props with joints must be {OBSERVED_PROPS}, in this order, got {observed}")
        self._scene, self._goals = scene, goals

    def bind(self, physics: mjcf.Physics) -> None:
        self.indices = SceneIndices(self._scene, self._goals, physics)

    @property
    def ctrl(self) -> NDArray[np.int64]:
        """`(9,)`, indices of the robot's actuators in ctrl."""
        return self.indices.ctrl

    def refresh(self, physics: mjcf.Physics) -> None:
        """Does nothing: joints need no evaluation."""

    def read(self, simulation: Simulation) -> KitchenReading:
        """Returns the positions of the robot's joints and the achieved goals."""
        indices = self.indices
        return KitchenReading(simulation.read("qpos", indices.robot_qpos), simulation.read("qpos", indices.goal_qpos))

    def observed(self, simulation: Simulation) -> NDArray[np.float64]:
        """Returns the 59 elements of the observation, `(..., 59)`, without noise."""
        indices = self.indices
        robot = simulation.read("qpos", indices.robot_qpos), simulation.read("qvel", indices.robot_qvel)
        objects = simulation.read("qpos", indices.object_qpos), simulation.read("qvel", indices.object_qvel)
        return np.concatenate([*robot, *objects], axis=-1)
