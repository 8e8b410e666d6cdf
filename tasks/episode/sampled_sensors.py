"""Sensors that quality adds to a scene, of which MuJoCo keeps the values of each physics step of a control step."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities.scenes import Scene

# Beginning of the names of the sensors.
SENSOR_PREFIX = "quality_"

# Numbers by which a sensor's history begins, before times and values: a setting of its own, and the latest place.
_HISTORY_HEADER = 2


class SampledSensors:
    """Adds sensors to a scene that is not yet compiled, and finds their samples in MuJoCo's `history`."""

    def __init__(self, scene: Scene, physics_steps: int) -> None:
        """Takes the scene, and the number of physics steps in a control step."""
        self._scene = scene
        self._physics_steps = physics_steps

    def add(self, kind: str, **attributes: Any) -> mjcf.Element:
        """Adds a sensor of a kind, such as `contact`, with a sample of each physics step; returns its element."""
        sensors = self._scene.arena.mjcf_model.sensor
        name = f"{SENSOR_PREFIX}{len(sensors.all_children())}"
        return sensors.add(kind, name=name, nsample=self._physics_steps, **attributes)

    def places(self, physics: mjcf.Physics, sensors: Sequence[mjcf.Element]) -> NDArray[np.int64]:
        """Returns the places of the samples of some sensors in the history, sensor by sensor, the latest ones last."""
        model = physics.model.ptr
        found = []
        for sensor in np.atleast_1d(physics.bind(sensors).element_id).tolist():
            first = model.sensor_historyadr[sensor] + _HISTORY_HEADER + self._physics_steps
            found.append(first + np.arange(self._physics_steps * model.sensor_dim[sensor]))
        return np.concatenate(found)
