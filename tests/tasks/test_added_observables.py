"""Observables that tasks enable by name in `suite.load`: pictures of cameras, and further quantities."""

import numpy as np
import pytest
from dm_control import composer, mjcf
from dm_control.composer.observation.observable import MJCFCamera
from helpers.errors import refused
from helpers.sweeps import brief

from kitchen_suite import suite
from kitchen_suite.tasks.episode.extra_observables import offered

TASKS = {
    **{"kitchen": "kettle", "open_cabinet": "top_drawer", "microwave_table": "open", "kitchens": "open"},
    "pick_and_place": "put_in",
}
SIZE = {"image_size": (20, 28), "render_quality": "fast"}


def load(domain, **options):
    return suite.load(domain, TASKS[domain], {"random": 0, **options})


def play(environment, steps=3):
    action = np.full(environment.action_spec().shape, 0.2)
    return [environment.reset(), *(environment.step(action) for _ in range(steps))]


@pytest.mark.full
@pytest.mark.parametrize("domain", TASKS)
def test_all_offered_quantities_can_be_observed(domain):
    plain = load(domain, visuals=False)
    # The scene is compiled, but its elements are those of another one.
    names = list(offered(plain.task.scene))
    environment = load(domain, visuals=False, extra_observables=names)
    of_robot = ["end_effector_pose", "end_effector_velocity", "gripper_width", "base_pose"]
    assert names[:4] == [f"franka/{name}" for name in of_robot]
    assert all(name.endswith(("/handle_positions", "/pose")) for name in names[4:])
    assert environment.task.extra_size == environment.task.policy_inputs.size - plain.task.policy_inputs.size
    for one, other in zip(play(plain), play(environment), strict=True):
        extra = {name: other.observation[name] for name in names}
        assert one.reward == other.reward
        assert {**one.observation, **extra}.keys() == other.observation.keys()
        for name, value in one.observation.items():
            np.testing.assert_array_equal(value, other.observation[name])
    for name, part in offered(environment.task.scene).items():
        assert extra[name].shape == environment.observation_spec()[name].shape == (part.size,)
        assert np.isfinite(extra[name]).all()
        assert part.content
    physics, scene = environment.physics, environment.task.scene
    for name, prop in scene.props.items():
        if prop.handles:
            expected = np.ravel([physics.bind(site).xpos for site in prop.handles])
            np.testing.assert_array_equal(extra[f"{name}/handle_positions"], expected)
    for name, entity in {
        "franka/base_pose": scene.robot,
        **{f"{key}/pose": scene.props[key] for key in scene.props},
    }.items():
        frame = physics.bind(mjcf.get_attachment_frame(entity.mjcf_model))
        np.testing.assert_array_equal(extra[name], [*frame.xpos, *frame.xquat])
    hand = physics.bind(scene.robot.end_effector)
    pose, velocity = extra["franka/end_effector_pose"], extra["franka/end_effector_velocity"]
    np.testing.assert_array_equal(pose[:3], hand.xpos)
    np.testing.assert_allclose(np.linalg.norm(pose[3:]), 1.0)
    np.testing.assert_allclose(velocity, np.ravel([physics.bind(each).sensordata for each in sensors_of(scene)]))


def sensors_of(scene):
    """The sensors of the hand's velocity."""
    root = scene.arena.mjcf_model
    return [each for each in root.sensor.all_children() if each.tag in ("framelinvel", "frameangvel")]


@pytest.mark.full
def test_a_scene_has_no_sensors_that_nobody_asked_for():
    assert load("kitchen", visuals=False).physics.model.nsensor == 0
    assert load("kitchen", visuals=False, extra_observables=["franka/gripper_width"]).physics.model.nsensor == 2


def test_values_are_present_ones_where_physics_steps_are_not_legacy():
    names = ["franka/end_effector_pose", "franka/end_effector_velocity", "kettle/handle_positions"]
    options = {"visuals": False, "extra_observables": names, "random": 0}
    environment = suite.load("kitchen", "kettle", options, {"legacy_step": False})
    last = play(environment)[-1].observation
    environment.physics.forward()
    scene = environment.task.scene
    np.testing.assert_array_equal(
        last["franka/end_effector_pose"][:3], environment.physics.bind(scene.robot.end_effector).xpos
    )
    measured = np.ravel([environment.physics.bind(each).sensordata for each in sensors_of(scene)])
    np.testing.assert_array_equal(last["franka/end_effector_velocity"], measured)


@pytest.mark.full
@pytest.mark.rendering
@pytest.mark.parametrize("domain", brief(TASKS, kept=["open_cabinet"]))
def test_cameras_are_observables_of_composer(domain):
    cameras = ["franka/hand", "overview"]
    environment = load(domain, cameras=cameras, depth=True, segmentation=True, **SIZE)
    kinds = ("", "/depth", "/segmentation")
    keys = [f"{camera}{kind}" for kind in kinds for camera in cameras]
    last = play(environment)[-1].observation
    assert list(last)[-6:] == list(environment.observation_spec())[-6:] == keys
    assert all(isinstance(environment.task.observables[key], MJCFCamera) for key in keys)
    for key in keys:
        environment.observation_spec()[key].validate(last[key])
    physics = environment.physics
    for camera in cameras:
        np.testing.assert_array_equal(last[camera], physics.render(20, 28, camera_id=camera))
        depth = physics.render(20, 28, camera_id=camera, depth=True)
        np.testing.assert_array_equal(last[f"{camera}/depth"][..., 0], depth)
    # As the stock environment would observe them.
    stock = composer.Environment(
        load(domain, cameras=cameras, **SIZE).task, random_state=0, strip_singleton_obs_buffer_dim=True
    )
    stock.reset()
    np.testing.assert_array_equal(stock.reset().observation["overview"].shape, (20, 28, 3))
    environment.close()


@pytest.mark.full
@pytest.mark.parametrize(
    ("options", "shown"),
    {
        "unknown camera": ({"cameras": ["overvew"]}, ["'overvew'", "'overview'"]),
        "size without cameras": ({"image_size": (8, 8)}, ["need cameras"]),
        "depth without cameras": ({"depth": True}, ["need cameras"]),
        "too large": ({"cameras": ["overview"], "image_size": (1441, 8)}, ["height", "image_size", "1440"]),
        "no visuals": ({"cameras": ["overview"], "visuals": False}, ["visuals=False"]),
        "unknown quantity": ({"extra_observables": ["hand_pose"]}, ["'hand_pose'"]),
        "twice": ({"extra_observables": ["franka/gripper_width"] * 2}, ["more than once"]),
        "unknown argument": ({"camera": "overview"}, ["'camera'", "'cameras'"]),
    }.values(),
)
@pytest.mark.parametrize("domain", brief(TASKS, kept=["open_cabinet"]))
def test_bad_settings_are_refused(domain, options, shown):
    with refused((TypeError, ValueError), *shown):
        load(domain, **options)


def test_observed_poses_follow_objects_that_were_moved():
    environment = load("kitchen", visuals=False, extra_observables=["franka/base_pose", "microwave/pose"])
    play(environment)
    scene, offset = environment.task.scene, np.array([0.02, -0.03, 0.0])
    parameters = {each.name: each for entity in (scene.arena, scene.props["microwave"]) for each in entity.parameters}
    before = environment.reset().observation
    parameters["pedestal/offset"].set(environment.physics, offset)
    parameters["microwave/offset"].set(environment.physics, -offset)
    after = environment.reset().observation
    np.testing.assert_allclose((after["franka/base_pose"] - before["franka/base_pose"])[:3], offset, atol=1e-12)
    np.testing.assert_allclose((after["microwave/pose"] - before["microwave/pose"])[:3], -offset, atol=1e-12)
