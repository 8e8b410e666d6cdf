"""Observables of joints that read MuJoCo's state itself: a tenth of what composer's own features cost."""

from collections.abc import Callable, Sequence

import numpy as np
from dm_control import mjcf
from dm_control.composer.observation import observable
from numpy.typing import NDArray

from kitchen_suite.entities.joints import addresses

_ALL = slice(None)


class JointPositions(observable.Observable):
    """Numbers of qpos of some joints, joint by joint, or some of these numbers; copies."""

    def __init__(self, joints: Callable[[], Sequence[mjcf.Element]], elements: Sequence[int] | slice = _ALL) -> None:
        """Notes what to read.

        Args:
          joints: gives the joints; called when a model has been compiled, since attaching may give an entity joints.
          elements: which of their numbers.
        """
        super().__init__(update_interval=1, buffer_size=None, delay=None, aggregator=None, corruptor=None)
        self._joints = joints
        self._elements = elements if isinstance(elements, slice) else np.array(elements)

    def _callable(self, physics: mjcf.Physics) -> Callable[[], NDArray[np.float64]]:
        in_qpos, _ = addresses(physics, self._joints())
        return self._reader(physics.data.qpos, in_qpos)

    def _reader(self, state: NDArray[np.float64], places: NDArray[np.int64]) -> Callable[[], NDArray[np.float64]]:
        chosen = places[self._elements]
        return lambda: state[chosen]


class JointVelocities(JointPositions):
    """Numbers of qvel of some joints, joint by joint, or some of these numbers; copies."""

    def _callable(self, physics: mjcf.Physics) -> Callable[[], NDArray[np.float64]]:
        _, in_qvel = addresses(physics, self._joints())
        return self._reader(physics.data.qvel, in_qvel)
