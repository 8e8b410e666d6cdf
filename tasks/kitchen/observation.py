"""The kitchen's observation, its noise and its sensors: 59 noisy numbers in four parts, then the goals."""

import collections
import functools
import itertools
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import NamedTuple, Self

import mujoco
import numpy as np
from dm_control import mjcf
from dm_control.composer.observation import observable
from numpy.typing import NDArray

from kitchen_suite.entities import Scene
from kitchen_suite.entities.assets import Array
from kitchen_suite.entities.joints import JointState
from kitchen_suite.entities.scenes import OBSERVED_PROPS, in_observed_order
from kitchen_suite.tasks import rotations
from kitchen_suite.tasks.goals import GoalSet
from kitchen_suite.tasks.observables import joined
from kitchen_suite.tasks.sensors import SceneIndices
from kitchen_suite.tasks.simulation import Simulation

# Amplitudes of the noise [rad, m, rad/s, m/s], 0.1 for the robot. The reference has them from a table for another
# scene, hence no pattern.
_OBJECT_POSITIONS = {
    "oven": [0.1, *[0.005] * 2, *[0.0005] * 5],
    "hood": [0.0005, 0.005],
    "slide_cabinet": [0.005],
    "hinge_cabinet": [0.005, 0.1],
    "microwave": [0.1],
    "kettle": [0.1, *[0.005] * 3, *[0.1] * 3],
}
_OBJECT_VELOCITIES = {
    "oven": [0.005] * 8,
    "hood": [0.005] * 2,
    "slide_cabinet": [0.005],
    "hinge_cabinet": [0.1] * 2,
    "microwave": [0.1],
    "kettle": [*[0.005] * 3, *[0.1] * 3],
}

_OBJECTS = (*in_observed_order(_OBJECT_POSITIONS), *in_observed_order(_OBJECT_VELOCITIES))
ROUNDING = 1e-6  # Greatest rounding error of recorded numbers, in single precision.


class Parts(NamedTuple):
    """Parts of the observation, in order, for a robot of some number of joints.

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
        stops = (0, joints, 2 * joints, 2 * joints + 21, 2 * joints + 41)
        return cls(*(slice(start, stop) for start, stop in itertools.pairwise(stops)))

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


# Those of the Franka.
ROBOT_POSITIONS, ROBOT_VELOCITIES, OBJECT_POSITIONS, OBJECT_VELOCITIES = FRANKA_PARTS = Parts.of(9)

SIZE = FRANKA_PARTS.size  # Number of elements of the observation, with the Franka.


def noise_scale(parts: Parts = FRANKA_PARTS, *, robot_ratio: float, object_ratio: float) -> Array:
    """Returns the greatest noise of each element of the observation, in its unit."""
    ratios = np.full(parts.size, object_ratio)
    robot = parts.noise["robot_noise"]
    ratios[robot] = robot_ratio
    return ratios * np.array([*[0.1] * robot.stop, *_OBJECTS])


AMPLITUDES = noise_scale(robot_ratio=1.0, object_ratio=1.0)


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
      parts: of the observation.
      robot: whose joints are read.
      indices: of the joints in the compiled model.
      measures_hand: whether the distances of the hand from the tasks' handles are read, as dense rewards need.
      ctrl, stage: see `Sensors`.
    """

    def __init__(self, scene: Scene, goals: GoalSet, *, measures_hand: bool = False) -> None:
        """Stores the kitchen, and the tasks whose joints are read."""
        # The tables of initial state and noise are made for the props of the kitchen, in its order.
        observed = tuple(name for name, prop in scene.props.items() if prop.joints)
        if observed != OBSERVED_PROPS:
            raise ValueError(f"the kitchen's props with joints must be {OBSERVED_PROPS}, in this order, got {observed}")
        self._scene = scene
        self._goals = goals
        self.measures_hand = measures_hand
        self.robot, self.parts = scene.robot, Parts.of(len(scene.robot.joints))
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
        positions, achieved = simulation.read("qpos", indices.robot_qpos), simulation.read("qpos", indices.goal_qpos)
        if not self.measures_hand:
            return KitchenReading(positions, achieved)
        sites = simulation.read("site_xpos", self._sites)
        hand_distances = np.sqrt(rotations.squared_length(sites[..., 1:, :] - sites[..., :1, :]))
        return KitchenReading(positions, achieved, hand_distances)

    def observed(self, simulation: Simulation) -> Array:
        """Returns the elements of the observation, `(..., 59)` with the Franka, without noise."""
        indices = self.indices
        robot = simulation.read("qpos", indices.robot_qpos), simulation.read("qvel", indices.robot_qvel)
        objects = simulation.read("qpos", indices.object_qpos), simulation.read("qvel", indices.object_qvel)
        return np.concatenate([*robot, *objects], axis=-1)


class KitchenObservables:
    """The enabled observables of the kitchen.

    - `franka/joint_positions` `(9,)` [rad, m] and `franka/joint_velocities` `(9,)` [rad/s, m/s]: the robot's own
      observables; noise by `robot_noise_ratio`.
    - `object_positions` `(21,)` [rad, m, quaternion] and `object_velocities` `(20,)` [rad/s, m/s]: qpos and qvel of the
      objects' joints; noise by `object_noise_ratio`.
    - `achieved_goal/<task>` and `desired_goal/<task>` `(m,)` [rad, m, quaternion]: present positions of the joints that
      a task's goal is set for, from qpos, and the goal; no noise.
    - `goal_states` `(30 k,)` [rad, m, quaternion], with `goal_states=k` only: positions of robot and objects that are
      wanted, end to end; no noise.
    - `requested_tasks` `(n,)`, with `tasks_per_episode` only: 1 where a task is requested, 0 elsewhere.
    - `goal_pixels/<camera>` `(height, width, 3)` uint8, with goal states and cameras only: pictures of the last state.

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
        requests: Mapping[str, Callable[[], NDArray]],
    ) -> None:
        """Builds the observables.

        Args:
          scene: the kitchen.
          goals: the tasks.
          extra: observables that come between state and goals.
          requests: functions that return what is observed of the request of an episode, by key, in order.
        """
        where = Parts.of(len(scene.robot.joints))
        self.noise = np.zeros(where.size)
        prefix, robot = scene.robot.mjcf_model.full_identifier, scene.robot.observables
        parts = {
            f"{prefix}joint_positions": (robot.joint_positions, where.robot_positions),
            f"{prefix}joint_velocities": (robot.joint_velocities, where.robot_velocities),
            "object_positions": (JointState("qpos", lambda: scene.object_joints), where.object_positions),
            "object_velocities": (JointState("qvel", lambda: scene.object_joints), where.object_velocities),
        }
        for part, indices in parts.values():
            part.corruptor = lambda clean, random_state=None, noise=self.noise[indices]: clean + noise
        state = {name: part for name, (part, _) in parts.items()}
        achieved = {
            f"achieved_goal/{task}": JointState("qpos", functools.partial(goal.joints_in, scene))
            for task, goal in zip(goals.tasks, goals.goals, strict=True)
        }
        desired = {
            f"desired_goal/{task}": observable.Generic(lambda physics, goal=goal: goal)
            for task, goal in goals.split(goals.desired).items()
        }
        requested = {name: observable.Generic(lambda physics, read=read: read()) for name, read in requests.items()}
        self.by_name: collections.OrderedDict[str, observable.Observable] = collections.OrderedDict(
            joined(state, extra, achieved, desired, requested)
        )
        for part in self.by_name.values():
            part.enabled = True
