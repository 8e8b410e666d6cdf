"""Decides whether an episode can be played in a layout: objects stand clear of each other, and handles are in reach."""

from collections.abc import Collection, Sequence

import mujoco
import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities.robot import Robot
from kitchen_suite.entities.scenes import Scene
from kitchen_suite.tasks.control_modes import inverse_kinematics
from kitchen_suite.tasks.simulation import as_columns
from kitchen_suite.types import Array

CLEARANCE_TOLERANCE = 0.004  # Depth by which two geoms may be deeper in each other than in the default layout [m].


class Clearance:
    """Depths of the colliding geoms of entities in those of other entities.

    Contacts do not report these: MuJoCo looks for none between pieces of furniture, nor between bodies without joints.
    """

    def __init__(self, scene: Scene, physics: mjcf.Physics, data: mujoco.MjData) -> None:
        """Measures the default layout, of which `data` are the kinematics."""
        self._model = model = physics.model.ptr
        owners = _owners(scene, physics)[model.geom_bodyid]
        collides = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
        bounded = model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE
        geoms = np.flatnonzero(collides & bounded)
        first, second = (geoms[indices] for indices in np.triu_indices(geoms.size, 1))
        other_owner = owners[first] != owners[second]
        self._first, self._second = first[other_owner], second[other_owner]
        self._props = tuple(scene.props)
        self._first_owner, self._second_owner = owners[self._first], owners[self._second]
        self._positions, self._rotations = data.geom_xpos.copy(), data.geom_xmat.copy()
        self._depths = np.zeros(self._first.size)
        self._depths[self._near(data)] = [self._depth(data, pair) for pair in self._near(data)]

    def depth(self, together: Collection[str] = ()) -> float:
        """Returns the greatest depth in the default layout [m], but for that of some props in each other."""
        numbers = [number for number, name in enumerate(self._props, start=2) if name in together]
        exempt = np.isin(self._first_owner, numbers) & np.isin(self._second_owner, numbers)
        return float(self._depths.max(initial=0.0, where=~exempt))

    def excess(self, data: mujoco.MjData) -> float:
        """Returns the greatest depth beyond that of the default layout in the layout of some kinematics [m]."""
        # In metres, and in elements of rotation matrices.
        moved = np.abs(data.geom_xpos - self._positions).max(axis=1) > 1e-6
        moved |= np.abs(data.geom_xmat - self._rotations).max(axis=1) > 1e-6
        near = self._near(data)
        pairs = near[moved[self._first[near]] | moved[self._second[near]]]
        return max((self._depth(data, pair) - self._depths[pair] for pair in pairs), default=0.0)

    def _near(self, data: mujoco.MjData) -> NDArray[np.int64]:
        """Returns the indices of the pairs in which the bounding sphere of each geom meets the other's box."""
        first, second = self._first, self._second
        offset = data.geom_xpos[second] - data.geom_xpos[first]
        meets = self._sphere_meets_box(data, offset, box=first, sphere=second)
        meets &= self._sphere_meets_box(data, -offset, box=second, sphere=first)
        return np.flatnonzero(meets)

    def _sphere_meets_box(
        self, data: mujoco.MjData, offset: Array, *, box: NDArray[np.int64], sphere: NDArray[np.int64]
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


class Reach:
    """Inverse kinematics of the end effector's position."""

    def __init__(
        self, physics: mjcf.Physics, robot: Robot, handles: Sequence[mjcf.Element], data: mujoco.MjData
    ) -> None:
        """Finds joint positions for each handle in the default layout.

        Args:
          physics: the compiled scene.
          robot: robot that acts.
          handles: sites to be reached.
          data: kinematics of the default layout, the robot at its start; its arm is moved.
        """
        self._model = physics.model.ptr
        joints = physics.bind(robot.joints[: robot.arm_size])
        self._qpos = as_columns(joints.qposadr)
        self._joints = joints.element_id
        self._low, self._high = np.transpose(joints.range)
        self._hand, self._handles = (physics.bind(each).element_id for each in (robot.end_effector, handles))
        start = np.clip(data.qpos[self._qpos], self._low, self._high)
        self._solutions = []
        for handle, element in zip(self._handles, handles, strict=True):
            if (solution := self._solve(data, handle, start, steps=200)) is None:
                raise ValueError(f"the robot cannot reach {element.full_identifier} in the default layout")
            self._solutions.append(solution)

    def reaches_all(self, data: mujoco.MjData) -> bool:
        """Whether all handles can be reached in the layout of some kinematics; moves the arm of `data`."""
        pairs = zip(self._handles, self._solutions, strict=True)
        return all(self._solve(data, handle, solution, steps=15) is not None for handle, solution in pairs)

    def _solve(self, data: mujoco.MjData, handle: int, start: Array, steps: int) -> Array | None:
        """Returns joint positions `(7,)` with the hand within 5 mm of a handle [rad]; None if none are found."""
        target, joints = data.site_xpos[handle].copy(), start
        for _ in range(steps):
            data.qpos[self._qpos] = joints
            mujoco.mj_kinematics(self._model, data)
            error = target - data.site_xpos[self._hand]
            if np.linalg.norm(error) <= 0.005:
                return joints
            position = data.site_xpos[self._hand]
            anchors = data.xanchor[self._joints]
            axes = data.xaxis[self._joints]
            linear = inverse_kinematics.jacobian(position, anchors, axes)[:3]
            # Joints that would leave their range stay at its end.
            low, high = self._low - joints, self._high - joints
            joints = joints + inverse_kinematics.joint_step(linear, error, np.zeros(joints.size), low, high)
        return None


class LayoutCheck:
    """Compares layouts with the default one; changes nothing in the physics."""

    def __init__(self, scene: Scene, handles: Sequence[mjcf.Element]) -> None:
        """Stores the scene, and the sites that the end effector must be able to reach."""
        self._scene, self._handles = scene, tuple(handles)

    def bind(self, physics: mjcf.Physics) -> None:
        """Measures the default layout, in which the physics must be, the robot and all objects at their start.

        Raises a ValueError if a handle is out of reach.
        """
        self._model = physics.model.ptr
        self._data = mujoco.MjData(physics.model.ptr)
        self._copy(physics)
        self._clearance = Clearance(self._scene, physics, self._data)
        self._reach = Reach(physics, self._scene.robot, self._handles, self._data)

    def accepts(self, physics: mjcf.Physics) -> bool:
        """Whether an episode can be played in the present layout: poses of bodies in the model, and qpos.

        The physics must be that of `bind`; its derived quantities need not be up to date.
        """
        self._copy(physics)
        return self._clearance.excess(self._data) <= CLEARANCE_TOLERANCE and self._reach.reaches_all(self._data)

    def _copy(self, physics: mjcf.Physics) -> None:
        self._data.qpos[:] = physics.data.qpos
        mujoco.mj_kinematics(self._model, self._data)
