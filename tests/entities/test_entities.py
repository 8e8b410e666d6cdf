"""The entities: joints, actuators, geoms and observables by name, and physics without visuals."""

import hashlib
import subprocess
import sys

import numpy as np
import pytest
from dm_control import composer, mjcf

from kitchen_suite import entities
from kitchen_suite.entities.arms import franka
from kitchen_suite.entities.assets import asset_dir

PROPS = (entities.Oven, entities.Hood, entities.SlideCabinet, entities.HingeCabinet, entities.Microwave)


@pytest.mark.parametrize("prop", PROPS)
def test_a_props_observables_are_of_its_joints(prop):
    alone = prop(visuals=False)
    physics = mjcf.Physics.from_mjcf_model(alone.mjcf_model)
    physics.data.qpos[:] = np.arange(physics.model.nq)
    np.testing.assert_array_equal(alone.observables.joint_positions(physics), physics.bind(alone.joints).qpos)
    assert alone.observables.joint_velocities(physics).shape == (len(prop.joint_names),)


def test_a_kettle_gets_its_joint_from_the_arena():
    kettle = entities.Kettle(visuals=False)
    assert kettle.joints == ()
    arena = composer.Arena()
    arena.add_free_entity(kettle)
    physics = mjcf.Physics.from_mjcf_model(arena.mjcf_model)
    assert kettle.observables.joint_positions(physics).shape == (7,)
    assert kettle.observables.joint_velocities(physics).shape == (6,)


@pytest.mark.parametrize("fixed", [entities.Counter, entities.Walls])
def test_props_without_joints_have_no_observables(fixed):
    assert not fixed(visuals=False).observables.as_dict()


def test_the_robot_names_its_parts():
    robot = entities.make_robot("franka", visuals=False)
    physics = mjcf.Physics.from_mjcf_model(robot.mjcf_model)
    assert [joint.name for joint in robot.joints] == [
        *(f"panda0_joint{i}" for i in range(1, 8)),
        "panda0_finger_joint1",
        "panda0_finger_joint2",
    ]
    assert [actuator.joint for actuator in robot.actuators] == list(robot.joints)
    assert [pad.parent.name for pad in robot.pads] == ["left_finger", "right_finger"]
    np.testing.assert_array_equal(
        robot.observables.end_effector_position(physics), physics.bind(robot.end_effector).xpos
    )


def test_the_end_effector_looks_along_the_fingers_and_spreads_along_y():
    robot = entities.make_robot("franka", visuals=False)
    physics = mjcf.Physics.from_mjcf_model(robot.mjcf_model)
    frame = physics.bind(robot.end_effector).xmat.reshape(3, 3)
    left, right = (physics.bind(robot.mjcf_model.find("joint", f"panda0_finger_joint{i}")).xaxis for i in (1, 2))
    np.testing.assert_allclose(left, frame[:, 1], atol=1e-3)
    np.testing.assert_allclose(right, -frame[:, 1], atol=1e-3)
    finger = physics.bind(robot.mjcf_model.find("geom", "left_finger_rung_0a")).xpos
    hand = physics.bind(robot.mjcf_model.find("geom", "hand")).xpos
    assert (finger - hand) @ frame[:, 2] > 0.05


@pytest.mark.full
def test_the_pandas_limits_and_pads_are_known_without_its_meshes():
    robot = entities.Robot(entities.PANDA, visuals=False)
    physics = mjcf.Physics.from_mjcf_model(robot.mjcf_model)
    np.testing.assert_array_equal(robot.joint_limits, franka.PANDA_JOINT_LIMITS)
    np.testing.assert_array_equal(physics.bind(robot.pads).size, [franka.PAD_HALF_SIZE] * 2)
    code = (
        "import importlib.util\n"
        "importlib.util.find_spec = lambda name, package=None: None\n"
        "from kitchen_suite.entities.arms import franka\n"
        "print(franka.PANDA_JOINT_LIMITS.shape)"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, check=True).stdout == b"(2, 9)\n"


def test_a_finger_closes_in_less_than_two_seconds():
    """Damping 100 and armature 5 make the kitchen's fingers slow: 40 mm take about a second."""
    robot = entities.make_robot("franka", visuals=False)
    physics = mjcf.Physics.from_mjcf_model(robot.mjcf_model)
    fingers = physics.bind(robot.joints[7:])
    fingers.qpos = 0.04
    while np.max(fingers.qpos) > 0.004:
        physics.step()
        assert physics.time() < 2.0
    assert physics.time() > 0.2


def test_without_visuals_only_colliding_geoms_are_left():
    kitchen = entities.build_kitchen_scene(visuals=False)
    model = mjcf.Physics.from_mjcf_model(kitchen.arena.mjcf_model).model
    rest = {model.geom(i).name for i in range(model.ngeom) if not model.geom_contype[i] | model.geom_conaffinity[i]}
    assert rest == {"far_above", "far_right"}
    assert (model.ngeom - len(rest), model.nmat, model.ntex) == (124, 0, 0)


def test_the_kitchen_lists_its_props_in_the_order_of_the_observation():
    kitchen = entities.build_kitchen_scene(visuals=False)
    assert [joint.full_identifier for joint in kitchen.object_joints][:2] == [
        "oven/knob_Joint_1",
        "oven/bottom_right_burner",
    ]
    assert list(kitchen.props) == [
        "counter",
        "oven",
        "hood",
        "walls",
        "slide_cabinet",
        "hinge_cabinet",
        "microwave",
        "kettle",
    ]


def test_the_installed_meshes_and_textures_are_those_that_the_models_were_made_for():
    paths = sorted(path for path in asset_dir().rglob("*") if path.suffix in (".stl", ".png"))
    # The same in gymnasium-robotics 1.4.0, 1.4.1 and 1.4.2.
    digest = hashlib.sha256(b"".join(path.read_bytes() for path in paths)).hexdigest()
    assert digest == "d4e77d460c1fd565cd4381055faccc41df77f07ff5e47f7f98714762956942d4"
