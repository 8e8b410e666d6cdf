"""MuJoCo sensors from which the `Features` of an open_cabinet scene are read with one array index."""

from collections.abc import Iterable
from typing import Any

import mujoco
import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities import OpenCabinetScene
from kitchen_suite.tasks.open_cabinet.features import FEATURE_INDICES, FEATURES_SIZE

_HEIGHT = slice(2, 3)


class FeatureSensors:
    """Sensors added to a scene, and their addresses in a compiled model.

    Attributes:
      columns: `(36,)`, indices of the features in `sensordata`.
      joint_qpos: slice of the robot's nine joints in qpos.
      ctrl: slice of the robot's nine actuators in ctrl.
    """

    def __init__(self, scene: OpenCabinetScene, drawer: str) -> None:
        """Adds the sensors.

        Args:
          scene: robot and cabinet; not yet compiled.
          drawer: `top` or `bottom`.
        """
        self._robot, self._sensors = scene.robot, scene.arena.mjcf_model.sensor
        joints, slide = scene.robot.joints, (scene.cabinet.drawer_joint(drawer),)
        gripper, handle = scene.robot.end_effector, scene.cabinet.handle_site(drawer)
        left_pad, right_pad = (scene.robot.mjcf_model.find("geom", f"{side}_finger_pad") for side in ("left", "right"))
        # Sensors of each feature. Of the pads' positions only the heights are read.
        self._by_feature = {
            "joint_positions": self._add_for_joints("jointpos", joints),
            "joint_velocities": self._add_for_joints("jointvel", joints),
            "tcp_position": self._add_for_frame("framepos", gripper),
            "tcp_quaternion": self._add_for_frame("framequat", gripper),
            "handle_position": self._add_for_frame("framepos", handle),
            "handle_quaternion": self._add_for_frame("framequat", handle),
            "left_pad_height": self._add_for_frame("framepos", left_pad),
            "right_pad_height": self._add_for_frame("framepos", right_pad),
            "drawer_position": self._add_for_joints("jointpos", slide),
            "drawer_velocity": self._add_for_joints("jointvel", slide),
        }

    def bind(self, physics: mjcf.Physics) -> None:
        """Looks up all addresses in the compiled scene."""
        columns = {name: self._columns(physics, name) for name in self._by_feature}
        for name, index in FEATURE_INDICES.items():
            size, expected = columns[name].size, np.arange(FEATURES_SIZE)[index].size
            if size != expected:
                raise ValueError(f"feature {name!r} must have {expected} elements, its sensors have {size}")
        self.columns = np.concatenate([columns[name] for name in FEATURE_INDICES])
        self.joint_qpos = _as_slice(physics.bind(self._robot.joints).qposadr)
        self.ctrl = _as_slice(physics.bind(self._robot.actuators).element_id)

    def read(self, physics: mjcf.Physics) -> NDArray[np.float64]:
        """Returns a copy of the present features' values `(36,)`; the sensors must be up to date (see `refresh`)."""
        return physics.data.sensordata[self.columns]

    def _columns(self, physics: mjcf.Physics, feature: str) -> NDArray[np.int64]:
        """Returns the indices of a feature in `sensordata`."""
        sensors = physics.bind(self._by_feature[feature])
        used = _HEIGHT if feature.endswith("_height") else slice(None)
        ranges = [np.arange(start, start + size)[used] for start, size in zip(sensors.adr, sensors.dim, strict=True)]
        return np.concatenate(ranges)

    def _add_for_joints(self, kind: str, joints: Iterable[mjcf.Element]) -> list[mjcf.Element]:
        return [self._add(kind, joint=joint) for joint in joints]

    def _add_for_frame(self, kind: str, element: mjcf.Element) -> list[mjcf.Element]:
        return [self._add(kind, objtype=element.tag, objname=element)]

    def _add(self, kind: str, **attributes: Any) -> mjcf.Element:
        return self._sensors.add(kind, name=f"feature_{len(self._sensors.all_children())}", **attributes)


def _as_slice(indices: NDArray[np.int64]) -> slice:
    """Returns consecutive indices as a slice, which reads several times as fast."""
    start, stop = int(indices[0]), int(indices[-1]) + 1
    if not np.array_equal(indices, np.arange(start, stop)):
        raise ValueError(f"indices must be consecutive, got {indices}")
    return slice(start, stop)


def refresh(physics: mjcf.Physics) -> None:
    """Updates kinematics and sensors from the joint positions and velocities."""
    model, data = physics.model.ptr, physics.data.ptr
    mujoco.mj_kinematics(model, data)
    mujoco.mj_sensorPos(model, data)
    mujoco.mj_sensorVel(model, data)
