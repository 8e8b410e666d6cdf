"""The Panda, the cabinet and their scene: frames, masses, and how the drawers and the idle scene behave."""

import dataclasses

import mujoco
import numpy as np
import pytest
from dm_control import mjcf

from kitchen_suite import entities
from kitchen_suite.entities.cabinet import DOORS, DRAWERS
from kitchen_suite.tasks.control_modes.joints import DEFAULT_POSE


@pytest.fixture(scope="module")
def scene():
    return entities.build_open_cabinet_scene(visuals=False)


@pytest.fixture
def physics(scene):
    physics = mjcf.Physics.from_mjcf_model(scene.arena.mjcf_model)
    with physics.reset_context():
        physics.bind(scene.robot.joints).qpos = DEFAULT_POSE
        physics.bind(scene.robot.actuators).ctrl = DEFAULT_POSE
    return physics


def frame(physics, site):
    return np.array(physics.bind(site).xmat).reshape(3, 3)


def test_the_panda_has_its_own_joint_names_and_limits(scene, physics):
    names = [*(f"joint{i}" for i in range(1, 8)), "finger_joint1", "finger_joint2"]
    assert [joint.name for joint in scene.robot.joints] == names
    low = [-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973, 0, 0]
    high = [2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973, 0.04, 0.04]
    np.testing.assert_array_equal(physics.bind(scene.robot.joints).range, np.transpose([low, high]))


def test_the_panda_has_the_published_masses(scene, physics):
    bodies = [scene.robot.mjcf_model.find("body", f"link{i}") for i in range(8)]
    # Gaz et al. 2019, by way of franka_ros.
    published = [0.629769, 4.970684, 0.646926, 3.228604, 3.587895, 1.225946, 1.666555, 0.735522]
    np.testing.assert_allclose(physics.bind(bodies).mass, published, rtol=1e-12)
    # Hand 0.73 kg, fingers 0.015 kg each.
    whole = physics.bind(scene.robot.mjcf_model.find("body", "link0")).subtreemass
    np.testing.assert_allclose(whole, sum(published) + 0.73 + 2 * 0.015, rtol=1e-12)


def test_the_gripper_frame_at_the_default_pose(scene, physics):
    np.testing.assert_allclose(physics.bind(scene.robot.end_effector).xpos, [0.501186, 0, 0.459959], atol=1e-6)
    axes = frame(physics, scene.robot.end_effector)
    half, root = 0.5, np.sqrt(0.75)
    # 30 degrees down: z approaches, y points to the left finger.
    np.testing.assert_allclose(axes.T, [[0, -1, 0], [-half, 0, root], [-root, 0, -half]], atol=1e-12)
    pads = scene.robot.pads
    assert [pad.name for pad in pads] == ["left_finger_pad", "right_finger_pad"]
    left, right = (physics.bind(pad) for pad in pads)
    middle = np.array(physics.bind(scene.robot.end_effector).xpos)
    # Fingers open by 40 mm, pads 5 mm in half thickness.
    np.testing.assert_allclose(left.xpos - middle, 0.045 * axes[:, 1], atol=1e-12)
    np.testing.assert_allclose(right.xpos - middle, -0.045 * axes[:, 1], atol=1e-12)


def test_the_position_of_the_top_handle(scene, physics):
    site = scene.cabinet.handle_site("top")
    assert site.full_identifier == "cabinet/drawer_top_handle"
    np.testing.assert_allclose(site.pos, [0.303, 0, 0.01], atol=1e-12)
    np.testing.assert_allclose(physics.bind(site).xpos, [0.303, 0, 0.66], atol=1e-12)


@pytest.mark.parametrize("drawer", DRAWERS)
def test_a_handles_frame_is_that_of_a_gripper_that_holds_it_from_the_front(scene, physics, drawer):
    columns = frame(physics, scene.cabinet.handle_site(drawer)).T
    np.testing.assert_allclose(columns, [[0, -1, 0], [0, 0, 1], [-1, 0, 0]], atol=1e-12)


def test_the_cabinet_has_four_joints_that_start_closed(scene, physics):
    joints = physics.bind(scene.cabinet.joints)
    names = [*(f"drawer_{drawer}_joint" for drawer in DRAWERS), *(f"door_{door}_joint" for door in DOORS)]
    assert [joint.name for joint in scene.cabinet.joints] == names
    np.testing.assert_array_equal(joints.qpos, 0)
    np.testing.assert_array_equal(joints.range, [[0, 0.4], [0, 0.4], [0, np.pi / 2], [0, np.pi / 2]])
    physics.bind(scene.cabinet.joints).qpos = [0.4, 0.3, 0.1, 0.1]
    np.testing.assert_array_equal(scene.cabinet.observables.joint_positions(physics), [0.4, 0.3, 0.1, 0.1])
    assert scene.cabinet.observables.joint_velocities(physics).shape == (4,)
    physics.forward()
    np.testing.assert_allclose(physics.bind(scene.cabinet.handle_site("top")).xpos, [0.703, 0, 0.66], atol=1e-12)


@pytest.mark.parametrize("door", DOORS)
def test_doors_open_outwards(scene, physics, door):
    site = scene.cabinet.mjcf_model.find("site", f"door_{door}_handle")
    closed = np.array(physics.bind(site).xpos)
    physics.bind(scene.cabinet.mjcf_model.find("joint", f"door_{door}_joint")).qpos = 1.0
    physics.forward()
    assert physics.bind(site).xpos[0] > closed[0] + 0.2


@pytest.mark.parametrize("drawer", DRAWERS)
def test_a_drawer_has_the_mass_of_its_config(scene, physics, drawer):
    body = scene.cabinet.drawer_joint(drawer).parent
    np.testing.assert_allclose(physics.bind(body).mass, scene.cabinet.config.drawer_mass, rtol=1e-12)


def test_a_config_changes_the_parts_it_names():
    config = entities.CabinetConfig(handle_height=-0.03, handle_clearance=0.05, drawer_friction=7.0)
    cabinet = entities.Cabinet(config, visuals=False)
    physics = mjcf.Physics.from_mjcf_model(cabinet.mjcf_model)
    np.testing.assert_allclose(physics.bind(cabinet.handle_site("top")).xpos, [0.318, 0, 0.22], atol=1e-12)
    assert physics.bind(cabinet.drawer_joint("top")).frictionloss == 7.0


@pytest.mark.parametrize("change", [{"drawer_mass": 0.0}, {"drawer_damping": float("nan")}, {"size": (0.5, -1, 0.8)}])
def test_a_config_that_cannot_be_built_is_refused(change):
    with pytest.raises(ValueError, match=rf"{next(iter(change))} of a cabinet .*positive"):
        dataclasses.replace(entities.CabinetConfig(), **change)


@pytest.mark.parametrize(
    ("change", "error"),
    [
        ({"drawer_mass": True}, TypeError),
        ({"handle_height": np.inf}, ValueError),
        ({"size": 0.5}, TypeError),
        ({"size": (0.5, 0.8)}, ValueError),
        ({"size": (0.5, True, 0.8)}, TypeError),
        ({"drawer_heights": (0.25,)}, ValueError),
        ({"drawer_heights": (0.05, 0.25)}, ValueError),
        ({"drawer_heights": (0.2, 0.1)}, ValueError),
        ({"drawer_heights": (0.35, 0.05)}, ValueError),
        ({"handle_half_length": 0.4}, ValueError),
        ({"handle_height": 0.1}, ValueError),
        ({"panel": 0.2}, ValueError),
        ({"worktop": 0.9}, ValueError),
        ({"size": (0.524, 0.76, 0.7), "drawer_heights": (0.1, -0.2)}, ValueError),
    ],
)
def test_sizes_that_do_not_fit_are_refused_by_name(change, error):
    with pytest.raises(error, match=rf"{next(iter(change))} of a cabinet .*must"):
        entities.CabinetConfig(**change)


LEAST = {"panel", "worktop", "drawer_travel", "drawer_mass", "drawer_friction", "drawer_damping", "door_mass"}
LEAST |= {"door_friction", "door_damping", "handle_clearance", "handle_radius", "handle_half_length", "handle_friction"}


@pytest.mark.parametrize("name", ["panel", "handle_half_length", "drawer_mass", "handle_clearance"])
def test_sizes_and_masses_that_mujoco_does_not_compile_are_refused_by_name(name):
    for value in (1e-12, 5e-324, 1e11, 10**400):
        with pytest.raises(ValueError, match=rf"{name} of a cabinet must be"):
            entities.CabinetConfig(**{name: value})


@pytest.mark.full
def test_configs_at_the_limits_can_be_built():
    configs = [
        dict.fromkeys(LEAST, 1e-6),
        *({name: 1e-6} for name in ("panel", "handle_half_length", "drawer_mass", "door_mass")),
        {"drawer_mass": 1e10, "door_mass": 1e10, "drawer_damping": 1e10, "handle_clearance": 1e10},
        {"drawer_heights": (0.244, 0.05)},
        {"drawer_heights": (0.273, 0.05)},
        {"handle_half_length": 0.371},
        {"handle_height": -0.091},
        {"panel": 0.13},
        {"size": (0.1, 0.2, 0.8)},
        {"drawer_heights": (0.0, -0.22)},
    ]
    for config in configs:
        mjcf.Physics.from_mjcf_model(entities.Cabinet(entities.CabinetConfig(**config), visuals=False).mjcf_model)


@pytest.mark.parametrize("which", DRAWERS)
def test_a_drawer_stays_within_a_millimetre_under_two_newtons(scene, physics, which):
    drawer = physics.bind(scene.cabinet.drawer_joint(which))
    for start in (0.0, 0.2):
        for force in (-2.0, 2.0):
            with physics.reset_context():
                drawer.qpos = start
            drawer.qfrc_applied = force
            physics.step(200)
            # 0.10 mm measured.
            assert abs(drawer.qpos.item() - start) < 0.5e-3


@pytest.mark.parametrize("which", DRAWERS)
def test_five_newtons_open_a_drawer(scene, physics, which):
    drawer = physics.bind(scene.cabinet.drawer_joint(which))
    with physics.reset_context():
        drawer.qpos = 0.0
    drawer.qfrc_applied = 5.0
    physics.step(200)
    drawer.qfrc_applied = 0.0
    # 2 N beyond the dry friction, against 15 N s/m: 2 kg gather speed with a time constant of 0.13 s.
    assert drawer.qpos.item() == pytest.approx(2 / 15 * (1 - 2 / 15), rel=0.1)


def test_a_drawer_does_not_creep(scene, physics):
    drawers = physics.bind([scene.cabinet.drawer_joint(drawer) for drawer in DRAWERS])
    with physics.reset_context():
        drawers.qpos = [0.2, 0.1]
    physics.step(6000)
    np.testing.assert_allclose(drawers.qpos, [0.2, 0.1], atol=1e-9)


def test_energy_does_not_grow_in_a_closed_idle_scene(physics):
    model, data = physics.model.ptr, physics.data.ptr
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    mujoco.mj_forward(model, data)
    energy = [data.energy.sum()]
    for _ in range(2000):
        mujoco.mj_step(model, data)
        energy.append(data.energy.sum())
    # The arm sinks by a few millimetres against its actuators; rounding of 110 J is 1e-14.
    assert np.diff(energy).max() < 1e-10
    assert data.energy[1] < 1e-12
    np.testing.assert_array_equal(data.warning.number, 0)


@pytest.mark.full
def test_visuals_change_no_physics(scene, physics):
    seen = mjcf.Physics.from_mjcf_model(entities.build_open_cabinet_scene(visuals=True).arena.mjcf_model)
    assert seen.model.ngeom > physics.model.ngeom
    random = np.random.default_rng(0)
    for each in (seen, physics):
        with each.reset_context():
            each.data.qpos[:] = [*DEFAULT_POSE, 0.2, 0.1, 0.5, 0.7]
    for _ in range(300):
        target = DEFAULT_POSE + random.uniform(-0.3, 0.3, 9)
        for each in (seen, physics):
            each.data.ctrl[:] = target
            each.step(2)
    np.testing.assert_array_equal(seen.data.qpos, physics.data.qpos)
    np.testing.assert_array_equal(seen.data.qvel, physics.data.qvel)


@pytest.mark.full
@pytest.mark.rendering
def test_every_camera_sees_something():
    seen = mjcf.Physics.from_mjcf_model(entities.build_open_cabinet_scene().arena.mjcf_model)
    for camera in ("overview", "handle", "franka/wrist"):
        assert seen.render(60, 80, camera_id=camera).std() > 10
