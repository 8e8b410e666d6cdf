"""The kitchen's observation, its noise and its sensors: 59 noisy numbers in four parts, then the goals."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple, Self

import mujoco
import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities import Scene
from kitchen_suite.tasks import rotations
from kitchen_suite.tasks.goals import GoalSet
from kitchen_suite.tasks.kitchen.observed_props import POSITION_NOISE, VELOCITY_NOISE, check_observed
from kitchen_suite.tasks.sensors import SceneIndices
from kitchen_suite.tasks.simulation import Simulation
from kitchen_suite.tasks.terms import Observation, end_to_end
from kitchen_suite.types import Array

# Greatest noise of the robot's positions [rad, m] and velocities [rad/s, m/s] at a noise ratio of 1.
_ROBOT_AMPLITUDE = 0.1

ROUNDING = 1e-6  # Greatest rounding error of recorded numbers, in single precision.


class StateSlices(NamedTuple):
    """Places of the parts of the observation, in order, for a robot of some number of joints.

    Attributes:
      robot_positions: of the robot's joints.
      robot_velocities: of the robot's joints.
      object_positions: of the objects' joints.
      object_velocities: of the objects' joints.
    """

    robot_positions: slice
    robot_velocities: slice
    object_positions: slice
    object_velocities: slice

    @classmethod
    def of(cls, joints: int) -> Self:
        """Returns the parts for a robot of as many joints."""
        sizes = {
            "robot_positions": joints,
            "robot_velocities": joints,
            "object_positions": len(POSITION_NOISE),
            "object_velocities": len(VELOCITY_NOISE),
        }
        return cls(**end_to_end(sizes))

    @property
    def size(self) -> int:
        """Number of elements of the observation."""
        return int(self.object_velocities.stop)

    @property
    def positions(self) -> NDArray[np.int64]:
        """Indices of all positions: a state of the kitchen."""
        return np.r_[self.robot_positions, self.object_positions]

    @property
    def noise(self) -> Mapping[str, slice]:
        """Parts whose noise varies as one."""
        robot = self.robot_velocities.stop
        return MappingProxyType({"robot_noise": slice(0, robot), "object_noise": slice(robot, self.size)})


FRANKA_SLICES = StateSlices.of(9)
SIZE = FRANKA_SLICES.size  # Number of elements of the observation, with the Franka.


def noise_scale(parts: StateSlices = FRANKA_SLICES, *, robot_ratio: float, object_ratio: float) -> Array:
    """Returns the greatest noise of each element of the observation, in its unit."""
    ratios = np.full(parts.size, object_ratio)
    robot = parts.noise["robot_noise"]
    ratios[robot] = robot_ratio
    return ratios * np.array([*[_ROBOT_AMPLITUDE] * robot.stop, *POSITION_NOISE, *VELOCITY_NOISE])


class KitchenReading(NamedTuple):
    """Joint positions after a control step, and distances in space where they are measured.

    Attributes:
      positions: `(..., 9)`, of the robot [rad, m].
      achieved: `(..., k)`, those that goals are set for, end to end [rad, m, quaternion].
      hand_distances: `(..., n)`, distance of the hand from the handle of each task; None if it is not measured [m].
    """

    positions: Array
    achieved: Array
    hand_distances: Array | None = None


class KitchenSensors:
    """Reads the joints of robot and objects.

    Attributes:
      slices: places of the parts of the observation.
      robot: whose joints are read.
      indices: of the joints in the compiled model.
      measures_hand: whether the distances of the hand from the tasks' handles are read, as dense rewards need.
      ctrl, stage: see `Sensors`.
    """

    def __init__(self, scene: Scene, goals: GoalSet, *, measures_hand: bool = False) -> None:
        """Stores the kitchen, and the tasks whose joints are read."""
        check_observed(scene.props)
        self._scene = scene
        self._goals = goals
        self.measures_hand = measures_hand
        self.robot = scene.robot
        self.slices = StateSlices.of(len(scene.robot.joints))
        # Joint positions and velocities are up to date after every physics step, positions in space are not.
        self.stage = mujoco.mjtStage.mjSTAGE_POS if measures_hand else mujoco.mjtStage.mjSTAGE_NONE

    def bind(self, physics: mjcf.Physics) -> None:
        self.indices = SceneIndices(self._scene, self._goals, physics)
        self.ctrl = self.indices.ctrl
        if self.measures_hand:
            sites = [self._scene.robot.end_effector, *(goal.handle_in(self._scene) for goal in self._goals.goals)]
            self._sites = np.array([physics.bind(site).element_id for site in sites])

    def refresh(self, physics: mjcf.Physics) -> None:
        """Updates positions in space if they are read; joints need no evaluation."""
        if self.measures_hand:
            mujoco.mj_kinematics(physics.model.ptr, physics.data.ptr)

    def read(self, simulation: Simulation) -> KitchenReading:
        """Returns the positions of the robot's joints, the achieved goals and, if measured, the hand's distances."""
        indices = self.indices
        positions = simulation.read("qpos", indices.robot_qpos)
        achieved = simulation.read("qpos", indices.goal_qpos)
        if not self.measures_hand:
            return KitchenReading(positions, achieved)
        sites = simulation.read("site_xpos", self._sites)
        hand_distances = np.sqrt(rotations.squared_length(sites[..., 1:, :] - sites[..., :1, :]))
        return KitchenReading(positions, achieved, hand_distances)

    @property
    def observations(self) -> dict[str, Observation]:
        """The state of the kitchen, by observation key; its noise is the MDP's.

        - `franka/joint_positions` `(9,)` [rad, m] and `franka/joint_velocities` `(9,)` [rad/s, m/s]: of the robot's
          joints, from qpos and qvel; noise by `robot_noise_ratio`.
        - `object_positions` `(21,)` [rad, m, quaternion] and `object_velocities` `(20,)` [rad/s, m/s]: of the objects'
          joints, from qpos and qvel; noise by `object_noise_ratio`.
        """
        robot = self.robot.mjcf_model.full_identifier
        return {
            f"{robot}joint_positions": Observation(
                lambda simulation, _: simulation.read("qpos", self.indices.robot_qpos), of_robot=True
            ),
            f"{robot}joint_velocities": Observation(
                lambda simulation, _: simulation.read("qvel", self.indices.robot_qvel), of_robot=True
            ),
            "object_positions": Observation(lambda simulation, _: simulation.read("qpos", self.indices.object_qpos)),
            "object_velocities": Observation(lambda simulation, _: simulation.read("qvel", self.indices.object_qvel)),
        }

    @property
    def noisy_observations(self) -> dict[str, slice]:
        """Place of the noise of each of these observations that has noise, in that of the state, by key."""
        robot = self.robot.mjcf_model.full_identifier
        return {
            f"{robot}joint_positions": self.slices.robot_positions,
            f"{robot}joint_velocities": self.slices.robot_velocities,
            "object_positions": self.slices.object_positions,
            "object_velocities": self.slices.object_velocities,
        }
