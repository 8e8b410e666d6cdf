"""The sensors that a `Features` of a cabinet scene is read from, in one go."""

from typing import Any

import mujoco
import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities import OpenCabinetScene


class FeatureSensors:
    """Adds the sensors to a scene, and finds them again in what is compiled from it.

    Attributes:
      columns: `(36,)`, where the numbers of a features stand in `sensordata`.
      joint_qpos: where the robot's nine joints stand in qpos.
      ctrl: where its nine servos stand in ctrl.
    """

    def __init__(self, scene: OpenCabinetScene, drawer: str) -> None:
        """Adds the sensors, in the order of a features's parts.

        Args:
          scene: robot and cabinet; not yet compiled.
          drawer: `top` or `bottom`.
        """
        self._robot, self._sensors = scene.robot, scene.arena.mjcf_model.sensor
        slide, joints = scene.cabinet.drawer_joint(drawer), scene.robot.joints
        pads = [scene.robot.mjcf_model.find("geom", f"{side}_finger_pad") for side in ("left", "right")]
        frames = (scene.robot.end_effector, scene.cabinet.handle_site(drawer))
        # Each with those of its numbers that are read.
        self._read = [
            *((self._add("jointpos", joint=joint), slice(1)) for joint in joints),
            *((self._add("jointvel", joint=joint), slice(1)) for joint in joints),
            *((self._add(kind, **_place(site)), slice(4)) for site in frames for kind in ("framepos", "framequat")),
            *((self._add("framepos", **_place(pad)), slice(2, 3)) for pad in pads),
            (self._add("jointpos", joint=slide), slice(1)),
            (self._add("jointvel", joint=slide), slice(1)),
        ]

    def bind(self, physics: mjcf.Physics) -> None:
        """Looks everything up in the compiled scene."""
        sensors = physics.bind([sensor for sensor, _ in self._read])
        ends = sensors.adr + sensors.dim
        numbers = [np.arange(start, end) for start, end in zip(sensors.adr, ends, strict=True)]
        self.columns = np.concatenate([own[part] for own, (_, part) in zip(numbers, self._read, strict=True)])
        self.joint_qpos = _stretch(physics.bind(self._robot.joints).qposadr)
        self.ctrl = _stretch(physics.bind(self._robot.actuators).element_id)

    def read(self, physics: mjcf.Physics) -> NDArray[np.float64]:
        """Numbers `(36,)` of the present features, a copy. The sensors must be up to date (see `refresh`)."""
        return physics.data.sensordata[self.columns]

    def _add(self, kind: str, **what: Any) -> mjcf.Element:
        return self._sensors.add(kind, name=f"snapshot_{len(self._sensors.all_children())}", **what)


def _place(element: mjcf.Element) -> dict[str, Any]:
    """What a sensor of a site's or a geom's place in space needs."""
    return {"objtype": element.tag, "objname": element}


def _stretch(indices: NDArray[np.int64]) -> slice:
    """Indices, which follow each other, as a slice: reading that is several times as fast."""
    stretch = slice(int(indices[0]), int(indices[-1]) + 1)
    if not np.array_equal(np.arange(stretch.stop)[stretch], indices):
        raise ValueError(f"indices must follow each other, got {indices}")
    return stretch


def refresh(physics: mjcf.Physics) -> None:
    """Brings positions in space and the sensors up to date with the joints."""
    model, data = physics.model.ptr, physics.data.ptr
    mujoco.mj_kinematics(model, data)
    mujoco.mj_sensorPos(model, data)
    mujoco.mj_sensorVel(model, data)
