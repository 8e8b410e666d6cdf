"""Other arms in the kitchen, with the example that needs no package; tests/clients has those that do."""

import dataclasses
import runpy
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from dm_control import mjcf

import kitchen_suite.gymnasium_env  # noqa: F401
from kitchen_suite import suite
from kitchen_suite.entities.robot import load_package_mjcf, prepare_mjcf

EXAMPLE = Path(__file__).resolve().parents[2] / "docs" / "examples" / "my_arm.py"
MJCF, MY_ARM = map(runpy.run_path(str(EXAMPLE)).get, ("MJCF", "MY_ARM"))
KITCHEN = "KitchenSuite/FrankaKitchen-v1"
OPTIONS = {"robot": MY_ARM, "control_mode": "ee_delta_pose", "visuals": False}


def with_mjcf(text):
    """Returns the arm with another MJCF."""
    return dataclasses.replace(MY_ARM, load=lambda visuals: prepare_mjcf(mjcf.from_xml_string(text), visuals=visuals))


def load(**options):
    environment = suite.load("kitchen", "kettle", {"random": 0, **OPTIONS, **options})
    return environment, environment.reset()


def test_the_observation_has_the_size_of_the_arm():
    environment, timestep = load(robot_noise_ratio=0.0)
    assert timestep.observation["my_arm/joint_positions"].shape == (8,)
    np.testing.assert_array_equal(
        timestep.observation["my_arm/joint_positions"], [0.6, -0.6, 2.2, 0.0, -0.03, 0.0, 0.04, 0.04]
    )
    assert environment.task.policy_inputs.state_size == 2 * 8 + 41


@pytest.mark.full
@pytest.mark.parametrize(("gripper", "width"), [(1.0, 0.0), (-1.0, 0.08)])
def test_the_last_element_of_the_action_closes_and_opens_the_hand(gripper, width):
    environment, _ = load()
    for _ in range(15):
        environment.step(np.array([0, 0, 0, 0, 0, 0, gripper]))
    assert environment.physics.bind(environment.task.robot.joints[6:]).qpos.sum() == pytest.approx(width, abs=0.002)


@pytest.mark.full
def test_the_hand_moves_as_the_action_says():
    environment, _ = load()
    hand = environment.physics.bind(environment.task.robot.end_effector)
    before = np.array(hand.xpos)
    for _ in range(10):
        environment.step(np.array([0, 0, 0.5, 0, 0, 0, -1.0]))
    # 0.125 m/s for 0.8 s, upwards; the hand follows with a time constant of a tenth of a second.
    np.testing.assert_allclose(np.array(hand.xpos) - before, [0, 0, 0.09], atol=0.012)


@pytest.mark.full
@pytest.mark.parametrize("mode", ["joint_velocity", "joint_position", "joint_delta"])
def test_other_control_modes_are_refused(mode):
    with pytest.raises(ValueError, match=rf"robot 'my_arm' .*ee_pose.*'{mode}'"):
        load(control_mode=mode)


def test_fast_physics_is_refused():
    with pytest.raises(ValueError, match="no fast physics with robot 'my_arm'"):
        load(physics="fast")


def test_a_missing_package_is_named():
    with pytest.raises(ImportError, match="package nowhere, which is not installed"):
        load_package_mjcf("nowhere", "arm.xml", visuals=False)


@pytest.mark.parametrize(
    ("robot", "error"), [("ur5e", ValueError), ("nowhere:ARM", ValueError), ("numpy:pi", ValueError), (3, TypeError)]
)
def test_an_unknown_robot_is_refused(robot, error):
    with pytest.raises(error, match="robot"):
        load(robot=robot)


@pytest.mark.parametrize(
    ("removed", "put", "shown"),
    [
        ('angle="radian"', "", "radians"),
        (' range="-3 3"', "", "range of joint 'a'"),
        (' ctrlrange="-3 3"', "", "range of joint 'a'"),
        ('<position name="b"', '<motor name="b"', "a position servo 'b'"),
        ('<site name="end_effector"', '<site name="tool"', "has no site 'end_effector'"),
        ('<joint name="e"', '<joint name="elbow"', "has no joint 'e'"),
    ],
)
def test_an_arm_whose_mjcf_lacks_something_is_refused(removed, put, shown):
    text = MJCF.replace(removed, put).replace('joint="e"', 'joint="elbow"' if "elbow" in put else 'joint="e"')
    with pytest.raises(ValueError, match=shown):
        load(robot=with_mjcf(text))


@pytest.mark.parametrize(
    ("changes", "shown"),
    [
        ({"servos": {}}, "1 to 7 servos"),
        ({"servos": {f"{k}": f"{k}" for k in range(8)}}, "1 to 7 servos"),
        ({"home": {"elbow": 0.0}}, "has no joint 'elbow'"),
    ],
)
def test_a_specification_that_does_not_fit_is_refused(changes, shown):
    with pytest.raises(ValueError, match=shown):
        load(robot=dataclasses.replace(MY_ARM, **changes))


def test_an_arm_may_begin_with_a_joint():
    text = MJCF.replace('<body> <geom fromto="0 0 0 0 0 0.15"/>', "").replace("</body>\n  </worldbody>", "</worldbody>")
    environment, timestep = load(robot=with_mjcf(text))
    assert timestep.observation["my_arm/joint_positions"].shape == (8,)
    assert np.isfinite(environment.step(np.zeros(7)).observation["my_arm/joint_positions"]).all()


@pytest.mark.full
def test_single_and_vectorised_environments_are_equal():
    single, many = gymnasium.make(KITCHEN, **OPTIONS), gymnasium.make_vec(KITCHEN, 2, **OPTIONS)
    first, second = single.reset(seed=3)[0], many.reset(seed=[3, 4])[0]
    for step in range(6):
        np.testing.assert_array_equal(first["observation"], second["observation"][0], err_msg=f"step {step}")
        action = np.random.default_rng(step).uniform(-1, 1, 7).astype(np.float32)
        first, second = single.step(action)[0], many.step(np.stack([action, -action]))[0]


def test_a_state_is_restored():
    environment, _ = load()
    action, state = np.full(7, 0.3), environment.get_state()
    expected = [environment.step(action).observation for _ in range(3)]
    environment.set_state(state)
    for observation in expected:
        np.testing.assert_equal(environment.step(action).observation, observation)


@pytest.mark.full
def test_everything_but_the_robots_start_and_gains_varies():
    environment, _ = load(variations=["start", "layout", "dynamics", "sensing", "push"])
    franka = suite.load("kitchen", "kettle", {"variations": ["start", "layout", "dynamics", "sensing", "push"]})
    others = {name for name in franka.task.variations.by_name if not name.startswith("franka/")}
    assert {*environment.task.variations.by_name} == others
    for _ in range(3):
        environment.reset()
        environment.step(np.zeros(7))


def test_the_robots_gains_and_damping_are_parameters_of_its_scene():
    environment, _ = load()
    robot, physics = environment.task.robot, environment.physics
    parameters = {parameter.name: parameter for parameter in robot.parameters}
    assert [*parameters] == ["my_arm/joint_offset", "my_arm/gain_scale", "my_arm/damping_scale"]
    parameters["my_arm/gain_scale"].set(physics, np.array(0.5))
    parameters["my_arm/damping_scale"].set(physics, np.array(2.0))
    np.testing.assert_array_equal(physics.bind(robot.actuators[:6]).gainprm[:, 0], 1000.0)
    np.testing.assert_array_equal(physics.bind(robot.joints[:6]).damping, 2.0)
    np.testing.assert_array_equal(robot.gains, 2000.0)
    np.testing.assert_array_equal(robot.damping, 201.0)
