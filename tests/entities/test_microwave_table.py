"""The scene of robot, table and microwave: poses, contacts, and physics with and without visuals."""

import mujoco
import numpy as np
import pytest
from dm_control import mjcf

from kitchen_suite.entities.scenes import build_microwave_table_scene
from kitchen_suite.tasks.control_modes.joints import DEFAULT_POSE


def compile_at_start(scene):
    physics = mjcf.Physics.from_mjcf_model(scene.arena.mjcf_model)
    with physics.reset_context():
        physics.bind(scene.robot.joints).qpos = DEFAULT_POSE
    physics.bind(scene.robot.actuators).ctrl = DEFAULT_POSE
    return physics


@pytest.fixture(scope="module")
def scene():
    return build_microwave_table_scene(visuals=False)


@pytest.fixture
def physics(scene):
    return compile_at_start(scene)


def test_the_scene_observes_the_microwaves_door_alone(scene):
    assert [joint.full_identifier for joint in scene.object_joints] == ["microwave/microwave"]
    np.testing.assert_array_equal(scene.elements("microwave"), [0])


def test_the_handle_is_within_reach_and_opens_towards_the_robot(scene, physics):
    base = physics.named.data.xpos["franka/link0"]
    handle = physics.named.data.site_xpos["microwave/handle"] - base
    np.testing.assert_allclose(handle, [0.62, 0.12, 0.442], atol=1e-9)
    physics.bind(scene.object_joints).qpos = -0.75
    physics.forward()
    opened = physics.named.data.site_xpos["microwave/handle"] - base
    assert 0.4 < np.hypot(*opened[:2]) < np.hypot(*handle[:2])


@pytest.mark.full
@pytest.mark.parametrize("holds", [True, False])
def test_robot_and_furniture_do_not_touch_and_stay_at_rest(scene, physics, holds):
    physics.bind(scene.robot.actuators).ctrl = DEFAULT_POSE * holds
    robot = {geom.full_identifier for geom in scene.robot.mjcf_model.find_all("geom") if geom.name}
    for _ in range(1000):
        physics.step()
        ids = {int(geom) for contact in physics.data.contact for geom in (contact.geom1, contact.geom2)}
        assert {physics.model.id2name(geom, "geom") for geom in ids} <= robot
    assert np.abs(physics.data.qvel).max() < 1e-6
    np.testing.assert_array_equal(physics.bind(scene.object_joints).qpos, 0.0)


def test_noisy_starts_are_without_contacts(scene, physics):
    low, high = scene.robot.joint_limits
    rng = np.random.default_rng(0)
    for _ in range(200):
        physics.bind(scene.robot.joints).qpos = np.clip(DEFAULT_POSE + rng.uniform(-0.125, 0.125, 9), low, high)
        physics.forward()
        assert physics.data.ncon == 0


def test_visuals_do_not_change_the_physics(scene, physics):
    visible = compile_at_start(build_microwave_table_scene())
    assert visible.model.ntex > 0
    for one in (physics, visible):
        one.data.qfrc_applied[one.model.name2id("microwave/microwave", "joint")] = -5.0
        mujoco.mj_step(one.model.ptr, one.data.ptr, 200)
    assert physics.bind(scene.object_joints).qpos < -0.1
    np.testing.assert_array_equal(physics.data.qpos, visible.data.qpos)


@pytest.mark.full
@pytest.mark.parametrize("camera", ["overview", "left", "right", "franka/wrist"])
def test_cameras_see_the_microwave(camera):
    physics = compile_at_start(build_microwave_table_scene())
    segmentation = physics.render(60, 80, camera_id=camera, segmentation=True)
    names = {physics.model.id2name(geom, "geom") for geom in np.unique(segmentation[..., 0]) if geom >= 0}
    assert {"microwave/shell", "microwave/door_visual"} & names
