"""Where joints stand in the state of a compiled model."""

from collections.abc import Sequence

import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

# Numbers in qpos and in qvel of a free, ball, slide and hinge joint, in the order of MuJoCo's mjtJoint.
_QPOS_WIDTHS = np.array([7, 4, 1, 1])
_QVEL_WIDTHS = np.array([6, 3, 1, 1])


def addresses(physics: mjcf.Physics, joints: Sequence[mjcf.Element]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Where the numbers of some joints stand in qpos and in qvel, joint by joint."""
    bound = physics.bind(joints)
    return (
        _ranges(bound.qposadr, _QPOS_WIDTHS[bound.type]),
        _ranges(bound.dofadr, _QVEL_WIDTHS[bound.type]),
    )


def owners(physics: mjcf.Physics, joints: Sequence[mjcf.Element]) -> NDArray[np.int64]:
    """Which joint each of the joints' numbers in qpos belongs to."""
    return np.repeat(np.arange(len(joints)), _QPOS_WIDTHS[physics.bind(joints).type])


def _ranges(starts: NDArray[np.int64], widths: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.concatenate([start + np.arange(width) for start, width in zip(starts, widths, strict=True)])
