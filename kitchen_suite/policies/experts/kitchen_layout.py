"""Layout of the kitchen as its expert observes it: poses of the furniture and of the robot's base."""

import functools
from collections.abc import Collection, Mapping, Sequence

import mink
import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities import KITCHEN_FRANKA, KitchenArena, Scene, build_kitchen_scene
from kitchen_suite.policies.experts.encoders import ArmModel
from kitchen_suite.policies.experts.kinematics import ArmKinematics
from kitchen_suite.tasks import observables
from kitchen_suite.tasks.kitchen.action import CONTROL_TIMESTEP
from kitchen_suite.tasks.kitchen.goals import GOALS
from kitchen_suite.tasks.kitchen.observation import SLICES

BASE = "franka/base_pose"

# The observable of the object that each task moves and that stands on the floor, the counter or the wall; the kettle's
# pose is part of the kitchen's observation.
POSES = {task: f"{goal.prop}/pose" for task, goal in GOALS.items() if goal.prop != "kettle"}

_OBSERVABLES = frozenset((BASE, *POSES.values()))

_ACTUATORS = tuple(link.actuator for link in KITCHEN_FRANKA.links)
_GAINS = np.array([actuator.gain for actuator in _ACTUATORS])
# Fraction of a joint's position error that its actuator removes in a control step: gain and damping of the joint make a
# first-order lag.
_RESPONSE = 1.0 - np.exp(-CONTROL_TIMESTEP * _GAINS / np.array([actuator.damping for actuator in _ACTUATORS]))

# Joint speeds that the actuators can follow [rad / control step]. The shoulder's limit is 0.06: its torque limit less
# the torque of gravity.
_JOINT_SPEED = (0.06,) * 4 + (0.08,) * 3

# Fraction of the hand's error that the control modes of the end effector remove in a control step.
_HAND_RESPONSE = 0.55

_, _, _OBJECTS, _ = SLICES


class ObservedLayout:
    """Reads the poses among the extra observables of an observation.

    Attributes:
      slices: slice of each pose that is observed, among the extra observables.
      size: number of all extra observables' elements; 0 if none of them is a pose of the layout.
    """

    def __init__(self, extras: Sequence[str]) -> None:
        """Looks up the poses; `extras` are the names of the task's extra observables."""
        slices = observables.slices(build_kitchen_scene(visuals=False), extras) if len(extras) else {}
        self.slices = {name: part for name, part in slices.items() if name in _OBSERVABLES}
        self.size = max((part.stop for part in slices.values()), default=0) if self.slices else 0

    def frame(self, task: str, extras: NDArray[np.float64]) -> mink.SE3 | None:
        """Returns the transform of a task's poses, from the default layout to the observed one.

        The transform is for planning with the robot's base at its default pose. It is None if no pose is observed.

        Args:
          task: name of the task.
          extras: `(size,)`, the extra observables.
        """
        if not self.slices:
            return None
        return self._moved(BASE, extras).inverse() @ self._moved(POSES.get(task), extras)

    def _moved(self, name: str | None, extras: NDArray[np.float64]) -> mink.SE3:
        """Returns the transform from a default pose to the observed one; the identity if it is not observed."""
        if name not in self.slices:
            return mink.SE3.identity()
        return _pose(extras[self.slices[name]]) @ _default_poses()[name].inverse()


def needed_observables(tasks: Collection[str], varied: Collection[str]) -> list[str]:
    """Returns the names of the poses that the expert must observe for its tasks where parameters vary."""
    owners = {name.partition("/")[0] for name in varied if name.endswith(("/offset", "/yaw"))}
    needed = {POSES[task] for task in tasks if task in POSES and GOALS[task].prop in owners}
    return sorted(needed | ({BASE} if "pedestal" in owners else set()))


@functools.cache
def _default_poses() -> Mapping[str, mink.SE3]:
    """Poses in the world of the default layout by name."""
    scene = build_kitchen_scene(visuals=False)
    physics = mjcf.Physics.from_mjcf_model(scene.arena.mjcf_model)
    entities = {BASE: scene.robot, **{f"{name}/pose": prop for name, prop in scene.props.items()}}
    frames = {name: physics.bind(mjcf.get_attachment_frame(entities[name].mjcf_model)) for name in _OBSERVABLES}
    return {name: _pose(np.concatenate([frame.xpos, frame.xquat])) for name, frame in frames.items()}


def _pose(values: NDArray[np.float64]) -> mink.SE3:
    """Returns the pose of a position and a quaternion `(7,)`."""
    return mink.SE3.from_rotation_and_translation(mink.SO3(wxyz=values[3:]).normalize(), values[:3])


@functools.cache
def arm_model() -> ArmModel:
    """The arm in the kitchen, shared by all instances."""
    return ArmModel(
        kinematics=ArmKinematics(KitchenArena, KITCHEN_FRANKA),
        gains=_GAINS,
        joint_response=_RESPONSE,
        hand_response=_HAND_RESPONSE,
        joint_speed=_JOINT_SPEED,
        timestep=CONTROL_TIMESTEP,
    )


@functools.cache
def scene() -> Scene:
    """The kitchen without visuals, shared by all instances."""
    return build_kitchen_scene(visuals=False)


@functools.cache
def _elements() -> Mapping[str, NDArray[np.int64]]:
    """Indices of the positions of each goal's joints among the object positions of the observation, by task."""
    return {task: goal.elements_in(scene()) for task, goal in GOALS.items()}


def achieved(task: str, observation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Positions of the joints of a task's goal in an observation [rad, m, quaternion]."""
    return observation[_OBJECTS][_elements()[task]]


def requested_in(order: Sequence[str], tasks: Sequence[str], requested: NDArray[np.float64]) -> tuple[str, ...]:
    """Returns the tasks of `order` that an observation `requested_tasks` `(n,)` of the `n` tasks asks for."""
    wanted = {task for task, is_asked in zip(tasks, requested > 0.5, strict=True) if is_asked}
    return tuple(task for task in order if task in wanted)
