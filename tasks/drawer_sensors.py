"""Reads a `Snapshot` from the physics of a cabinet scene."""

import mujoco
import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities import CabinetScene
from kitchen_suite.tasks.drawer_snapshot import Snapshot


class DrawerSensors:
    """Where in MuJoCo's arrays the robot, the handle and the drawer stand; good for one compiled model."""

    def __init__(self, scene: CabinetScene, drawer: str, physics: mjcf.Physics) -> None:
        """Looks everything up.

        Args:
          scene: robot and cabinet.
          drawer: `top` or `bottom`.
          physics: the scene, compiled.
        """
        robot, slide = physics.bind(scene.robot.joints), physics.bind(scene.cabinet.drawer_joint(drawer))
        self.joint_qpos = np.array(robot.qposadr)
        self._joint_qvel = np.array(robot.dofadr)
        self._drawer_qpos, self._drawer_qvel = int(slide.qposadr), int(slide.dofadr)
        self._tcp = physics.bind(scene.robot.end_effector).element_id
        self._handle = physics.bind(scene.cabinet.handle_site(drawer)).element_id
        pads = [scene.robot.mjcf_model.find("geom", f"{side}_finger_pad") for side in ("left", "right")]
        self._pads = [physics.bind(pad).element_id for pad in pads]

    def read(self, physics: mjcf.Physics) -> Snapshot:
        """The present state; the arrays are copies. Positions in space must be up to date (`mj_kinematics`)."""
        data = physics.data
        left, right = data.geom_xpos[self._pads, 2]
        return Snapshot(
            joint_positions=data.qpos[self.joint_qpos],
            joint_velocities=data.qvel[self._joint_qvel],
            tcp_position=data.site_xpos[self._tcp].copy(),
            tcp_quaternion=_site_quaternion(physics, self._tcp),
            handle_position=data.site_xpos[self._handle].copy(),
            handle_quaternion=_site_quaternion(physics, self._handle),
            left_pad_height=left,
            right_pad_height=right,
            drawer_position=data.qpos[self._drawer_qpos],
            drawer_velocity=data.qvel[self._drawer_qvel],
        )


def _site_quaternion(physics: mjcf.Physics, site: int) -> NDArray[np.float64]:
    """Orientation of a site in the world, `(4,)`, w, x, y, z.

    Made from its body's quaternion: one made from its rotation matrix would change sign at rounding errors.
    """
    quaternion = np.empty(4)
    model = physics.model
    mujoco.mju_mulQuat(quaternion, physics.data.xquat[model.site_bodyid[site]], model.site_quat[site])
    return quaternion
