"""Clearance of a layout: no object is deeper in another one than in the default layout."""

import mujoco
import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities.scenes.scene import Scene

# Depth by which two geoms may be deeper in each other than in the default layout [m].
TOLERANCE = 0.004

# Geoms whose coordinates differ by less have not moved [m; elements of rotation matrices].
_UNMOVED = 1e-6


class Clearance:
    """Depths of the colliding geoms of entities in those of other entities.

    Contacts do not report these: MuJoCo looks for none between pieces of furniture, nor between bodies without joints.
    """

    def __init__(self, scene: Scene, physics: mjcf.Physics, data: mujoco.MjData) -> None:
        """Measures the default layout.

        Args:
          scene: arena, robot and props.
          physics: the compiled scene.
          data: its kinematics in the default layout.
        """
        self._model = model = physics.model.ptr
        owners = _owners(scene, physics)[model.geom_bodyid]
        collides = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
        bounded = model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE
        geoms = np.flatnonzero(collides & bounded)
        first, second = (geoms[indices] for indices in np.triu_indices(geoms.size, 1))
        other_owner = owners[first] != owners[second]
        self._first, self._second = first[other_owner], second[other_owner]
        self._positions, self._rotations = data.geom_xpos.copy(), data.geom_xmat.copy()
        self._depths = np.zeros(self._first.size)
        self._depths[self._near(data)] = [self._depth(data, pair) for pair in self._near(data)]

    def excess(self, data: mujoco.MjData) -> float:
        """Returns the greatest depth beyond that of the default layout in the layout of some kinematics [m]."""
        moved = np.abs(data.geom_xpos - self._positions).max(axis=1) > _UNMOVED
        moved |= np.abs(data.geom_xmat - self._rotations).max(axis=1) > _UNMOVED
        near = self._near(data)
        pairs = near[moved[self._first[near]] | moved[self._second[near]]]
        return max((self._depth(data, pair) - self._depths[pair] for pair in pairs), default=0.0)

    def is_free(self, data: mujoco.MjData) -> bool:
        """Whether no geom is deeper in another one than in the default layout, up to the tolerance."""
        return self.excess(data) <= TOLERANCE

    def _near(self, data: mujoco.MjData) -> NDArray[np.int64]:
        """Returns the indices of the pairs in which the bounding sphere of each geom meets the other's box."""
        first, second = self._first, self._second
        offset = data.geom_xpos[second] - data.geom_xpos[first]
        meets = self._sphere_meets_box(data, offset, box=first, sphere=second)
        meets &= self._sphere_meets_box(data, -offset, box=second, sphere=first)
        return np.flatnonzero(meets)

    def _sphere_meets_box(
        self, data: mujoco.MjData, offset: NDArray[np.float64], *, box: NDArray[np.int64], sphere: NDArray[np.int64]
    ) -> NDArray[np.bool_]:
        """Returns whether spheres at an offset `(n, 3)` from geoms meet the bounding boxes of these [m]."""
        rotations = data.geom_xmat[box].reshape(-1, 3, 3)
        centre, half = self._model.geom_aabb[box, :3], self._model.geom_aabb[box, 3:]
        local = np.einsum("nji,nj->ni", rotations, offset) - centre
        beyond = np.maximum(np.abs(local) - half, 0.0)
        return np.einsum("ni,ni->n", beyond, beyond) <= self._model.geom_rbound[sphere] ** 2

    def _depth(self, data: mujoco.MjData, pair: int) -> float:
        """Returns the depth of a pair's geoms in each other, 0 if they are apart [m]."""
        distance = mujoco.mj_geomDistance(self._model, data, self._first[pair], self._second[pair], 0.01, None)
        return max(-distance, 0.0)


def _owners(scene: Scene, physics: mjcf.Physics) -> NDArray[np.int64]:
    """Returns for each body the number of the entity that it belongs to; those of the arena have 0."""
    base = mjcf.get_attachment_frame(scene.robot.mjcf_model)
    # A pedestal moves with the robot.
    roots = [base.parent if base.parent.tag == "body" else base]
    roots += [mjcf.get_attachment_frame(prop.mjcf_model) for prop in scene.props.values()]
    numbers = {int(physics.bind(root).element_id): number for number, root in enumerate(roots, start=1)}
    owners = np.zeros(physics.model.nbody, np.int64)
    for body, parent in enumerate(physics.model.body_parentid):
        owners[body] = numbers.get(body, owners[parent])
    return owners
