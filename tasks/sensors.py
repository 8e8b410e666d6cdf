"""Sensors of tasks: what an MDP reads from the physics after every control step."""

from collections.abc import Iterable
from typing import Any, Protocol, TypeVar

import mujoco
import numpy as np
from dm_control import mjcf

from kitchen_suite.entities.joints import addresses
from kitchen_suite.entities.robot import Robot
from kitchen_suite.entities.scenes import Scene
from kitchen_suite.tasks.goals import GoalSet
from kitchen_suite.tasks.simulation import Columns, Simulation, as_columns
from kitchen_suite.types import Array

Reading_co = TypeVar("Reading_co", covariant=True)


class Sensors(Protocol[Reading_co]):
    """Values that a task reads from the physics, and columns to which the targets of the actuators are written.

    Attributes:
      ctrl: columns of the robot's actuators in ctrl.
      stage: stage of MuJoCo's pipeline up to which the state after a control step is evaluated before `read`.
    """

    stage: mujoco.mjtStage

    @property
    def ctrl(self) -> Columns: ...

    def bind(self, physics: mjcf.Physics) -> None:
        """Looks up all addresses in a compiled scene."""

    def refresh(self, physics: mjcf.Physics) -> None:
        """Evaluates a single physics up to `stage`."""

    def read(self, simulation: Simulation) -> Reading_co:
        """Returns the current values, in fresh arrays `(..., k)`."""


class FeatureSensors:
    """Sensors that a task adds to its scene; each feature is read by one or more of them.

    Attributes:
      columns: `(k,)`, indices of the features in `sensordata`, end to end.
      indices: slice of each feature among the columns, in the order in which features were added.
      ctrl: columns of the robot's actuators in ctrl.
    """

    # Sensors are evaluated from the positions and velocities after the step.
    stage = mujoco.mjtStage.mjSTAGE_VEL

    def __init__(self, root: mjcf.RootElement, robot: Robot) -> None:
        """Prepares to add sensors to the model of an arena, which is not yet compiled, with the robot that acts."""
        self._sensors = root.sensor
        self._robot = robot
        self._by_feature: dict[str, tuple[list[mjcf.Element], slice]] = {}

    def add_joints(self, feature: str, kind: str, joints: Iterable[mjcf.Element]) -> None:
        """Adds a feature of some joints, such as `jointpos` or `jointvel`."""
        self._by_feature[feature] = [self._add(kind, joint=joint) for joint in joints], slice(None)

    def add_frame(self, feature: str, kind: str, element: mjcf.Element, part: slice = slice(None)) -> None:
        """Adds a feature of a site, geom or body, such as `framepos` or `framequat`, or a part of its elements."""
        # MuJoCo's "body" is the frame of the body's inertia.
        frame = "xbody" if element.tag == "body" else element.tag
        self._by_feature[feature] = [self._add(kind, objtype=frame, objname=element)], part

    def bind(self, physics: mjcf.Physics) -> None:
        """Looks up all addresses in the compiled scene."""
        found: list[int] = []
        self.indices: dict[str, slice] = {}
        for feature, (sensors, part) in self._by_feature.items():
            bound, start = physics.bind(sensors), len(found)
            for address, size in zip(bound.adr, bound.dim, strict=True):
                found += range(address, address + size)[part]
            self.indices[feature] = slice(start, len(found))
        self.columns = np.array(found)
        self.ctrl = as_columns(physics.bind(self._robot.actuators).element_id)

    def refresh(self, physics: mjcf.Physics) -> None:
        """Updates kinematics and sensors from the joint positions and velocities."""
        model, data = physics.model.ptr, physics.data.ptr
        mujoco.mj_kinematics(model, data)
        mujoco.mj_sensorPos(model, data)
        mujoco.mj_sensorVel(model, data)

    def read(self, simulation: Simulation) -> Array:
        """Returns the present features' values `(..., k)`; the sensors must be up to date (see `refresh`)."""
        # MDPs compute with columns, which are contiguous in Fortran order.
        return simulation.read("sensordata", self.columns, order="F")

    def _add(self, kind: str, **attributes: Any) -> mjcf.Element:
        return self._sensors.add(kind, name=f"feature_{len(self._sensors.all_children())}", **attributes)


class SceneIndices:
    """Indices of robot, objects and goals in MuJoCo's arrays; valid for one compiled model.

    Attributes:
      robot_qpos: `(9,)`, qpos of the robot's joints.
      robot_qvel: `(9,)`, qvel of the robot's joints.
      object_qpos: qpos of the objects' joints, in the order of observation; `(21,)` in the kitchen.
      object_qvel: qvel of the objects' joints, in the order of observation; `(20,)` in the kitchen.
      state_qpos: qpos of the robot's joints, then of the objects'; `(30,)` in the kitchen.
      goal_qpos: `(k,)`, qpos that the goals are set for, end to end.
      ctrl: `(9,)`, ctrl of the robot's actuators.
    """

    def __init__(self, scene: Scene, goals: GoalSet, physics: mjcf.Physics) -> None:
        """Looks up all indices; raises a ValueError if a goal has not as many values as its joints."""
        self.robot_qpos, self.robot_qvel = addresses(physics, scene.robot.joints)
        self.object_qpos, self.object_qvel = addresses(physics, scene.object_joints)
        self.state_qpos = np.concatenate([self.robot_qpos, self.object_qpos])
        goal_qpos = [addresses(physics, goal.joints_in(scene))[0] for goal in goals.goals]
        for task, goal, indices in zip(goals.tasks, goals.goals, goal_qpos, strict=True):
            if indices.size != len(goal.value):
                raise ValueError(f"goal of {task!r} must have {indices.size} values, got {goal.value}")
        self.goal_qpos = np.concatenate(goal_qpos)
        self.ctrl = physics.bind(scene.robot.actuators).element_id
