"""Sensors of the kitchen: joint positions and velocities, achieved goals, distances of the hand from handles."""

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
    """Joint positions after a control step, and distances in space where they are asked for.

    Attributes:
      positions: `(..., 9)`, of the robot [rad, m].
      achieved: `(..., k)`, those that goals are set for, end to end [rad, m, quaternion].
      hand_distances: `(..., n)`, distance of the hand from the handle of each task; None if it is not measured [m].
    """

    positions: NDArray[np.float64]
    achieved: NDArray[np.float64]
    hand_distances: NDArray[np.float64] | None = None


class KitchenSensors:
    """Reads the joints of robot and objects.

    Attributes:
      indices: of the joints in the compiled model.
      stage: see `Sensors`.
    """

    def __init__(self, scene: Scene, goals: GoalSet, *, measures_hand: bool = False) -> None:
        """Stores robot and objects, and the tasks whose joints are read.

        Args:
          scene: the kitchen.
          goals: the tasks.
          measures_hand: whether the distances of the hand from the tasks' handles are read, too.

        Raises:
          ValueError: the scene's props with joints are not those of the kitchen, in its order, for which the tables of
            initial state and noise are made.
        """
        observed = tuple(name for name, prop in scene.props.items() if prop.joints)
        if observed != OBSERVED_PROPS:
            raise ValueError(f"the kitchen's props with joints must be {OBSERVED_PROPS}, in this order, got {observed}")
        self._scene, self._goals, self._measures_hand = scene, goals, measures_hand
        # Joint positions and velocities are up to date after every physics step, positions in space are not.
        self.stage = mujoco.mjtStage.mjSTAGE_POS if measures_hand else mujoco.mjtStage.mjSTAGE_NONE

    def bind(self, physics: mjcf.Physics) -> None:
        self.indices = SceneIndices(self._scene, self._goals, physics)
        if self._measures_hand:
            sites = [self._scene.robot.end_effector, *(goal.handle_in(self._scene) for goal in self._goals.goals)]
            self._sites = np.array([physics.bind(site).element_id for site in sites])

    @property
    def ctrl(self) -> NDArray[np.int64]:
        """`(9,)`, indices of the robot's actuators in ctrl."""
        return self.indices.ctrl

    def refresh(self, physics: mjcf.Physics) -> None:
        """Updates positions in space if they are read; joints need no evaluation."""
        if self._measures_hand:
            mujoco.mj_kinematics(physics.model.ptr, physics.data.ptr)

    def read(self, simulation: Simulation) -> KitchenReading:
        """Returns the positions of the robot's joints, the achieved goals and, if measured, the hand's distances."""
        indices = self.indices
        positions, achieved = simulation.read("qpos", indices.robot_qpos), simulation.read("qpos", indices.goal_qpos)
        return KitchenReading(positions, achieved, self._hand_distances(simulation) if self._measures_hand else None)

    def _hand_distances(self, simulation: Simulation) -> NDArray[np.float64]:
        sites = simulation.read("site_xpos", self._sites)
        # In C order, a row has the same sum alone and among many.
        squares = np.square(sites[..., 1:, :] - sites[..., :1, :], order="C")
        distances: NDArray[np.float64] = np.sqrt(np.add.reduce(squares, axis=-1))
        return distances

    def observed(self, simulation: Simulation) -> NDArray[np.float64]:
        """Returns the 59 elements of the observation, `(..., 59)`, without noise."""
        indices = self.indices
        robot = simulation.read("qpos", indices.robot_qpos), simulation.read("qvel", indices.robot_qvel)
        objects = simulation.read("qpos", indices.object_qpos), simulation.read("qvel", indices.object_qvel)
        return np.concatenate([*robot, *objects], axis=-1)
