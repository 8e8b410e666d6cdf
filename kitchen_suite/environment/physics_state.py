"""The saved part of the physics' state, and which objects sleep."""

import mujoco
import numpy as np
from numpy.typing import NDArray

from kitchen_suite import checks
from kitchen_suite.entities.assets import VISUAL_BODY
from kitchen_suite.tasks.episode.sampled_sensors import SENSOR_PREFIX

INTEGRATION_STATE = mujoco.mjtState.mjSTATE_INTEGRATION
"""The parts of MuJoCo's state on which later physics steps depend, the solver's warm start included."""


# Key of states: what sleeps, where objects may.
ASLEEP = "asleep"


def shared_elements(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Returns which elements of MuJoCo's state vector are saved: those that a scene has with and without visuals.

    Forces on bodies that hold only visual geoms are not among them: a scene without visuals has no such bodies. Neither
    is the history of the sensors of quality, which the next control step replaces.
    """
    is_shared = np.ones(mujoco.mj_stateSize(model, INTEGRATION_STATE), bool)
    # Six numbers for each body, after the parts of the lower flags: MuJoCo concatenates in the flags' order.
    start = mujoco.mj_stateSize(model, int(INTEGRATION_STATE) & (int(mujoco.mjtState.mjSTATE_XFRC_APPLIED) - 1))
    forces = is_shared[start : start + 6 * model.nbody].reshape(model.nbody, 6)
    forces[:] = [[not model.body(i).name.endswith(VISUAL_BODY)] for i in range(model.nbody)]
    history = mujoco.mj_stateSize(model, int(INTEGRATION_STATE) & (int(mujoco.mjtState.mjSTATE_HISTORY) - 1))
    ends = [*model.sensor_historyadr[model.sensor_historyadr >= 0].tolist(), model.nhistory]
    for i in np.flatnonzero(model.sensor_historyadr >= 0).tolist():
        if model.sensor(i).name.startswith(SENSOR_PREFIX):
            start = model.sensor_historyadr[i]
            end = min(each for each in ends if each > start)
            is_shared[history + start : history + end] = False
    return is_shared


def initial_state(model: mujoco.MjModel) -> NDArray[np.float64]:
    """Returns the elements of MuJoCo's state vector before anything has happened."""
    state = np.empty(mujoco.mj_stateSize(model, INTEGRATION_STATE))
    mujoco.mj_getState(model, mujoco.MjData(model), state, INTEGRATION_STATE)
    return state


def moving_elements(model: mujoco.MjModel) -> slice:
    """Returns where `qpos`, `qvel` and `act` are in an `INTEGRATION_STATE`: after the time, the lowest flag."""
    return slice(1, 1 + model.nq + model.nv + model.na)


def check_sleep(tree_asleep: NDArray[np.int32]) -> None:
    """Raises a ValueError unless MuJoCo can have written such a `tree_asleep`.

    Trees that sleep together name each other in a circle; the others count the physics steps until they may sleep.
    """
    (asleep,) = np.nonzero(tree_asleep >= 0)
    if sorted(tree_asleep[asleep]) != asleep.tolist() or tree_asleep.min() < -1 - mujoco.mjMINAWAKE:
        raise ValueError(f"state[{ASLEEP!r}] names no trees that sleep together: {checks.shown(tree_asleep.tolist())}")


def evaluate_sleepers(model: mujoco.MjModel, data: mujoco.MjData, tree_asleep: NDArray[np.int32]) -> None:
    """Evaluates a state that has just been set with all trees awake, then sets which of them sleep.

    What MuJoCo evaluated of a tree before it fell asleep stays until it wakes: poses, sensors, and the acceleration
    without constraints, which becomes the solver's warm start. None of it is in the state, and `mj_setState` lets trees
    sleep on whose positions are the same.

    `tree_asleep` `(ntree,)` is as MuJoCo's field of this name: not negative where a tree sleeps.
    """
    _write_sleep(model, data, np.full_like(tree_asleep, -1 - mujoco.mjMINAWAKE))
    mujoco.mj_forward(model, data)
    _write_sleep(model, data, tree_asleep)
    # From the second physics step of its sleep the warm start is that acceleration, which depends in its last digits on
    # where the trees beside it were when it fell asleep.
    sleeps = tree_asleep[model.dof_treeid] >= 0
    same = np.isclose(data.qacc_smooth, data.qacc_warmstart, rtol=1e-9, atol=1e-9)
    np.copyto(data.qacc_smooth, data.qacc_warmstart, where=sleeps & same)


def _write_sleep(model: mujoco.MjModel, data: mujoco.MjData, tree_asleep: NDArray[np.int32]) -> None:
    """Sets which kinematic trees sleep, and what MuJoCo derives from it."""
    data.tree_asleep[:] = tree_asleep
    data.tree_awake[:] = tree_asleep < 0
    moves = model.body_treeid >= 0
    data.body_awake[moves] = data.tree_awake[model.body_treeid[moves]]
    sleeps = data.body_awake == int(mujoco.mjtSleepState.mjS_ASLEEP)
    is_child = np.arange(model.nbody) > 0
    (bodies,) = np.nonzero(~sleeps)
    (children,) = np.nonzero(is_child & ~sleeps[model.body_parentid])
    (dofs,) = np.nonzero(~sleeps[model.dof_bodyid])
    data.body_awake_ind[: bodies.size] = bodies
    data.parent_awake_ind[: children.size] = children
    data.dof_awake_ind[: dofs.size] = dofs
    data.ntree_awake, data.nv_awake = int(data.tree_awake.sum()), dofs.size
    data.nbody_awake, data.nparent_awake = bodies.size, children.size
