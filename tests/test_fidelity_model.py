"""The compiled model against the reference's, number by number."""

import mujoco
import numpy as np
import pytest
from dm_control import mjcf
from reference import BODIES, colliding_geoms, reference_joint, reference_model

from kitchen_suite.entities import build_kitchen

JOINT_FIELDS = [
    "type",
    "range",
    "axis",
    "pos",
    "stiffness",
    "margin",
    "solref",
    "solimp",
    "limited",
    "qposadr",
    "dofadr",
]
DOF_FIELDS = ("damping", "armature", "frictionloss", "invweight0", "M0", "solref", "solimp")
ACTUATOR_FIELDS = [
    "gainprm",
    "biasprm",
    "gaintype",
    "biastype",
    "ctrlrange",
    "ctrllimited",
    "forcerange",
    "forcelimited",
    "gear",
]
GEOM_FIELDS = [
    "type",
    "pos",
    "quat",
    "friction",
    "solref",
    "solimp",
    "margin",
    "gap",
    "condim",
    "priority",
    "solmix",
    "rbound",
]
BODY_FIELDS = ("mass", "inertia", "ipos", "iquat", "invweight0", "subtreemass")
# A geom's size has as many meaningful numbers as its type has dimensions; the reference writes more for some.
SIZES = {"PLANE": 3, "SPHERE": 1, "CAPSULE": 2, "CYLINDER": 2, "BOX": 3, "MESH": 3}


@pytest.fixture(scope="module", params=[True, False], ids=["visuals", "no_visuals"])
def ours(request):
    return mjcf.Physics.from_mjcf_model(build_kitchen(visuals=request.param).arena.mjcf_model).model.ptr


@pytest.fixture(scope="module")
def reference():
    return reference_model()


def test_sizes_are_equal(ours, reference):
    for size in ("nq", "nv", "nu", "njnt", "neq", "ntree", "na", "nmocap", "ntendon"):
        assert getattr(ours, size) == getattr(reference, size), size
    assert (ours.nq, ours.nv, ours.nu) == (30, 29, 9)


def test_options_are_equal(ours, reference):
    for name in dir(reference.opt):
        if not name.startswith("_"):
            np.testing.assert_array_equal(getattr(ours.opt, name), getattr(reference.opt, name), name)


def test_joints_and_dofs_are_equal_by_name(ours, reference):
    for i in range(ours.njnt):
        j = reference.joint(reference_joint(ours.joint(i).name)).id
        for field in JOINT_FIELDS:
            np.testing.assert_array_equal(
                getattr(ours, f"jnt_{field}")[i], getattr(reference, f"jnt_{field}")[j], f"{field} of joint {i}"
            )
    for field in DOF_FIELDS:
        np.testing.assert_array_equal(getattr(ours, f"dof_{field}"), getattr(reference, f"dof_{field}"), field)


def test_actuators_are_equal_by_the_joint_they_drive(ours, reference):
    driven = {int(reference.actuator_trnid[i, 0]): i for i in range(reference.nu)}
    for i in range(ours.nu):
        joint = ours.joint(int(ours.actuator_trnid[i, 0])).name
        j = driven[reference.joint(reference_joint(joint)).id]
        for field in ACTUATOR_FIELDS:
            np.testing.assert_array_equal(
                getattr(ours, f"actuator_{field}")[i], getattr(reference, f"actuator_{field}")[j], f"{field} of {joint}"
            )


def test_equalities_are_equal(ours, reference):
    for field in ("eq_type", "eq_obj1id", "eq_obj2id", "eq_data", "eq_solref", "eq_solimp", "eq_active0"):
        np.testing.assert_array_equal(getattr(ours, field), getattr(reference, field), field)


def test_moving_bodies_weigh_the_same(ours, reference):
    moving = {ours.body(i).name for i in range(ours.nbody) if ours.body_weldid[i]}
    assert moving == set(BODIES)
    for name, name_there in BODIES.items():
        i, j = ours.body(name).id, reference.body(name_there).id
        for field in BODY_FIELDS:
            np.testing.assert_array_equal(
                getattr(ours, f"body_{field}")[i], getattr(reference, f"body_{field}")[j], f"{field} of {name}"
            )


def test_colliding_geoms_are_equal_by_body_and_order(ours, reference):
    bodies = {reference.body(there).id: ours.body(here).id for here, there in BODIES.items()}
    pairs = list(zip(colliding_geoms(ours), colliding_geoms(reference), strict=True))
    assert len(pairs) == 124
    for i, j in pairs:
        assert ours.body_weldid[ours.geom_bodyid[i]] == bodies.get(reference.body_weldid[reference.geom_bodyid[j]], 0)
        for field in GEOM_FIELDS:
            np.testing.assert_array_equal(
                getattr(ours, f"geom_{field}")[i],
                getattr(reference, f"geom_{field}")[j],
                f"{field} of {ours.geom(i).name}",
            )
        used = SIZES[mujoco.mjtGeom(reference.geom_type[j]).name.removeprefix("mjGEOM_")]
        np.testing.assert_array_equal(ours.geom_size[i, :used], reference.geom_size[j, :used])


def test_every_colliding_geom_has_a_name(ours):
    assert all(ours.geom(i).name for i in colliding_geoms(ours))


def test_contacts_are_equal_over_random_configurations(ours, reference):
    rng = np.random.default_rng(0)
    here, there = mujoco.MjData(ours), mujoco.MjData(reference)
    number_here = {geom: n for n, geom in enumerate(colliding_geoms(ours))}
    number_there = {geom: n for n, geom in enumerate(colliding_geoms(reference))}
    touching = 0
    for _ in range(10_000):
        qpos = random_configuration(rng, reference)
        found = [
            contacts(model, data, qpos, numbers)
            for model, data, numbers in ((ours, here, number_here), (reference, there, number_there))
        ]
        assert found[0] == found[1]
        touching += bool(found[0])
    assert touching > 5_000


def random_configuration(rng, model):
    """Joints anywhere in their ranges, the kettle anywhere on the hob or in the robot's hand."""
    qpos = np.zeros(model.nq)
    low, high = model.jnt_range[:-1].T
    qpos[:23] = rng.uniform(low, high)
    qpos[23:26] = rng.uniform((-0.6, 0.1, 1.55), (0.3, 0.9, 2.2))
    qpos[26:] = rng.normal(size=4)
    return qpos


def contacts(model, data, qpos, numbers):
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_collision(model, data)
    return sorted(
        (*sorted(numbers[g] for g in contact.geom), contact.dist, *contact.pos, *contact.friction, contact.dim)
        for contact in data.contact
    )
