"""Observables of joints that read MuJoCo's state itself, at the price of one array index."""

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
        # Where the numbers stand, and in which compiled model.
        self._model, self._places = None, np.empty(0, np.int64)

    def _callable(self, physics: mjcf.Physics) -> Callable[[], NDArray[np.float64]]:
        if self._model is not physics.model.ptr:
            self._model = physics.model.ptr
            self._places = self._found(*addresses(physics, self._joints()))[self._elements]
        places, state = self._places, self._state(physics)
        return lambda: state[places]

    def _found(self, in_qpos: NDArray[np.int64], in_qvel: NDArray[np.int64]) -> NDArray[np.int64]:
        del in_qvel
        return in_qpos

    def _state(self, physics: mjcf.Physics) -> NDArray[np.float64]:
        return physics.data.qpos


class JointVelocities(JointPositions):
    """Numbers of qvel of some joints, joint by joint, or some of these numbers; copies."""

    def _found(self, in_qpos: NDArray[np.int64], in_qvel: NDArray[np.int64]) -> NDArray[np.int64]:
        del in_qpos
        return in_qvel

    def _state(self, physics: mjcf.Physics) -> NDArray[np.float64]:
        return physics.data.qvel
