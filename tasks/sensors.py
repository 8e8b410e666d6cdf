"""MuJoCo sensors from which a task's features are read with one array index."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import mujoco
import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities.robots.franka import Franka
from kitchen_suite.tasks.simulation import Simulation, columns


class FeatureSensors:
    """Sensors that a task adds to its scene; each feature is read by one or more of them.

    Attributes:
      columns: `(k,)`, indices of the features in `sensordata`, end to end.
      ctrl: columns of the robot's actuators in ctrl.
    """

    # Sensors are evaluated from the positions and velocities after the step.
    stage = mujoco.mjtStage.mjSTAGE_VEL

    def __init__(self, root: mjcf.RootElement, robot: Franka) -> None:
        """Prepares to add sensors; see `add_joints` and `add_frame`.

        Args:
          root: model of the arena; not yet compiled.
          robot: robot that acts.
        """
        self._sensors, self._robot = root.sensor, robot
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
        found = [_addresses(physics, sensors, part) for sensors, part in self._by_feature.values()]
        self.columns = np.concatenate(found)
        stops = np.cumsum([each.size for each in found]).tolist()
        sized = zip(self._by_feature, found, stops, strict=True)
        self._indices = {name: slice(stop - each.size, stop) for name, each, stop in sized}
        self.ctrl = columns(physics.bind(self._robot.actuators).element_id)

    @property
    def indices(self) -> Mapping[str, slice]:
        """Slice of each feature among the columns, in the order in which features were added."""
        return self._indices

    def refresh(self, physics: mjcf.Physics) -> None:
        """Updates kinematics and sensors from the joint positions and velocities."""
        model, data = physics.model.ptr, physics.data.ptr
        mujoco.mj_kinematics(model, data)
        mujoco.mj_sensorPos(model, data)
        mujoco.mj_sensorVel(model, data)

    def read(self, simulation: Simulation) -> NDArray[np.float64]:
        """Returns the present features' values `(..., k)`; the sensors must be up to date (see `refresh`)."""
        # MDPs compute with columns.
        return simulation.read("sensordata", self.columns, order="F")

    def _add(self, kind: str, **attributes: Any) -> mjcf.Element:
        return self._sensors.add(kind, name=f"feature_{len(self._sensors.all_children())}", **attributes)


def _addresses(physics: mjcf.Physics, sensors: Sequence[mjcf.Element], part: slice) -> NDArray[np.int64]:
    """Returns the indices of some sensors in `sensordata`."""
    bound = physics.bind(sensors)
    ranges = [np.arange(start, start + size)[part] for start, size in zip(bound.adr, bound.dim, strict=True)]
    return np.concatenate(ranges)
