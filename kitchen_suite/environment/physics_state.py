"""The physics' state as one vector, which is the same for scenes with and without visuals."""

import mujoco
import numpy as np
from numpy.typing import NDArray

from kitchen_suite.entities.assets import VISUAL_BODY

PHYSICS_STATE = mujoco.mjtState.mjSTATE_INTEGRATION
"""The parts of MuJoCo's state on which later physics steps depend, the solver's warm start included."""

# Applied forces and torques, six numbers for each body. MuJoCo concatenates the parts in the order of these flags.
_BODY_FORCES = mujoco.mjtState.mjSTATE_XFRC_APPLIED


class PhysicsState:
    """Reads and writes the state of simulations of one model.

    Forces on bodies that hold only visual geoms are no part of it: a scene without visuals has no such bodies.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        """Finds the elements of MuJoCo's state vector that the scene has with and without visuals."""
        self._model = model
        self._is_shared = np.ones(mujoco.mj_stateSize(model, PHYSICS_STATE), bool)
        start = mujoco.mj_stateSize(model, int(PHYSICS_STATE) & (int(_BODY_FORCES) - 1))
        forces = self._is_shared[start : start + 6 * model.nbody].reshape(model.nbody, 6)
        forces[:] = [[not model.body(i).name.endswith(VISUAL_BODY)] for i in range(model.nbody)]

    def read(self, data: mujoco.MjData) -> NDArray[np.float64]:
        """Returns the state."""
        state = np.empty(self._is_shared.size)
        mujoco.mj_getState(self._model, data, state, PHYSICS_STATE)
        return state[self._is_shared]

    def write(self, data: mujoco.MjData, state: NDArray[np.float64]) -> None:
        """Sets a state, with zero forces on bodies that hold only visual geoms."""
        whole = np.zeros(self._is_shared.size)
        whole[self._is_shared] = state
        mujoco.mj_setState(self._model, data, whole, PHYSICS_STATE)
