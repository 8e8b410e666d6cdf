"""The sensors from which the `Features` of an open_cabinet scene are read."""

import numpy as np
from dm_control import mjcf

from kitchen_suite.entities import OpenCabinetScene
from kitchen_suite.tasks.open_cabinet.features import FEATURE_INDICES, FEATURES_SIZE
from kitchen_suite.tasks.sensors import FeatureSensors

_HEIGHT = slice(2, 3)


class OpenCabinetSensors(FeatureSensors):
    """Sensors of robot, handle and drawer, in the order of `FEATURE_INDICES`."""

    def __init__(self, scene: OpenCabinetScene, drawer: str) -> None:
        """Adds the sensors.

        Args:
          scene: robot and cabinet; not yet compiled.
          drawer: `top` or `bottom`.
        """
        super().__init__(scene.arena.mjcf_model, scene.robot)
        joints, slide = scene.robot.joints, (scene.cabinet.drawer_joint(drawer),)
        gripper, handle = scene.robot.end_effector, scene.cabinet.handle_site(drawer)
        left_pad, right_pad = (scene.robot.mjcf_model.find("geom", f"{side}_finger_pad") for side in ("left", "right"))
        self.add_joints("joint_positions", "jointpos", joints)
        self.add_joints("joint_velocities", "jointvel", joints)
        self.add_frame("tcp_position", "framepos", gripper)
        self.add_frame("tcp_quaternion", "framequat", gripper)
        self.add_frame("handle_position", "framepos", handle)
        self.add_frame("handle_quaternion", "framequat", handle)
        self.add_frame("left_pad_height", "framepos", left_pad, _HEIGHT)
        self.add_frame("right_pad_height", "framepos", right_pad, _HEIGHT)
        self.add_joints("drawer_position", "jointpos", slide)
        self.add_joints("drawer_velocity", "jointvel", slide)

    def bind(self, physics: mjcf.Physics) -> None:
        super().bind(physics)
        expected = {name: np.arange(FEATURES_SIZE)[index].ravel().tolist() for name, index in FEATURE_INDICES.items()}
        found = {name: np.arange(FEATURES_SIZE)[index].tolist() for name, index in self.indices.items()}
        if found != expected:
            raise ValueError(f"the sensors read the features {found}, which must be {expected}")
