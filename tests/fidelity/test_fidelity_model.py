"""The compiled model against the reference's, number by number."""

import mujoco
import numpy as np
import pytest
from dm_control import mjcf
from helpers.original import BODIES, colliding_geoms, reference_joint, reference_model, same_geoms

from kitchen_suite.entities import build_kitchen_scene

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
    return mjcf.Physics.from_mjcf_model(build_kitchen_scene(visuals=request.param).arena.mjcf_model).model.ptr


@pytest.fixture(scope="module")
def reference():
    return reference_model()


def test_sizes_are_equal(ours, reference):
    for size in ("nq", "nv", "nu", "njnt", "neq", "ntree", "na", "nmocap", "ntendon"):
        assert getattr(ours, size) == getattr(reference, size), size
    assert (ours.nq, ours.nv, ours.nu) == (30, 29, 9)
    # The solver stops by it.
    assert ours.stat.meaninertia == reference.stat.meaninertia


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
    moving = {i for i in range(ours.nbody) if ours.body_weldid[i]}
    weightless = {i for i in moving if not ours.body_mass[i] and not ours.body_jntnum[i]}
    assert not weightless & set(ours.geom_bodyid[colliding_geoms(ours)])
    assert {ours.body(i).name for i in moving - weightless} == set(BODIES)
    for name, name_there in BODIES.items():
        i, j = ours.body(name).id, reference.body(name_there).id
        for field in BODY_FIELDS:
            np.testing.assert_array_equal(
                getattr(ours, f"body_{field}")[i], getattr(reference, f"body_{field}")[j], f"{field} of {name}"
            )


def test_the_furnitures_centre_of_mass_is_equal_to_the_last_bit(ours, reference):
    rng = np.random.default_rng(0)
    here, there = mujoco.MjData(ours), mujoco.MjData(reference)
    for _ in range(100):
        here.qpos[:23] = there.qpos[:23] = rng.uniform(*ours.jnt_range[:-1].T)
        for model, data in ((ours, here), (reference, there)):
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
        root_here = ours.body_rootid[ours.body("oven/knob_1").id]
        root_there = reference.body_rootid[reference.body(BODIES["oven/knob_1"]).id]
        np.testing.assert_array_equal(here.subtree_com[root_here], there.subtree_com[root_there])
    assert ours.body_subtreemass[root_here] == reference.body_subtreemass[root_there]


def test_colliding_geoms_are_equal_by_their_place_in_the_world(ours, reference):
    bodies = {reference.body(there).id: ours.body(here).id for here, there in BODIES.items()}
    pairs = same_geoms(ours, reference)
    assert len(pairs) == len(set(pairs.values())) == len(colliding_geoms(reference)) == 124
    for i, j in pairs.items():
        assert ours.body_weldid[ours.geom_bodyid[i]] == bodies.get(reference.body_weldid[reference.geom_bodyid[j]], 0)
        for field in GEOM_FIELDS:
            np.testing.assert_array_equal(
                getattr(ours, f"geom_{field}")[i],
                getattr(reference, f"geom_{field}")[j],
                f"{field} of {ours.geom(i).name}",
            )
        used = SIZES[mujoco.mjtGeom(reference.geom_type[j]).name.removeprefix("mjGEOM_")]
        np.testing.assert_array_equal(ours.geom_size[i, :used], reference.geom_size[j, :used])


def test_what_collides_with_what_is_equal_but_for_the_floors_contype(ours, reference):
    floor = ours.geom("floor").id
    for i, j in same_geoms(ours, reference).items():
        assert ours.geom_conaffinity[i] == reference.geom_conaffinity[j]
        assert ours.geom_contype[i] == (0 if i == floor else reference.geom_contype[j])
    assert (ours.nexclude, reference.nexclude, ours.npair, reference.npair) == (1, 0, 0, 0)


def test_every_colliding_geom_has_a_name(ours):
    assert all(ours.geom(i).name for i in colliding_geoms(ours))
