"""Pictures of the kitchen from every camera, and the entities each viewable alone."""

import functools
import itertools

import gymnasium
import mujoco
import numpy as np
import pytest
from dm_control import mjcf
from dm_control.mujoco import engine
from helpers.sweeps import brief

from kitchen_suite import entities, suite
from kitchen_suite.entities.joints import addresses
from kitchen_suite.rendering import cameras
from kitchen_suite.tasks import GOALS

pytestmark = pytest.mark.rendering

CAMERAS = ("left_cap", "right_cap", "overview", "left", "right", "franka/wrist", "franka/hand", "workspace")
HEIGHT, WIDTH = 96, 128


@pytest.fixture(scope="module")
def environment():
    environment = suite.load("kitchen", "all", {"random": 0})
    environment.reset()
    yield environment
    environment.close()


@pytest.fixture(scope="module")
def physics(environment):
    return environment.physics


@pytest.mark.full
def test_the_cameras_have_the_documented_names_and_numbers(physics):
    assert tuple(physics.model.camera(i).name for i in range(physics.model.ncam)) == CAMERAS


@pytest.mark.full
@pytest.mark.parametrize("camera", CAMERAS)
def test_every_camera_sees_a_lit_and_varied_scene(physics, camera):
    picture = physics.render(HEIGHT, WIDTH, camera_id=camera)
    assert (picture.shape, picture.dtype) == ((HEIGHT, WIDTH, 3), np.uint8)
    assert picture.std() > 20
    assert 40 < picture.mean() < 230


@pytest.mark.full
@pytest.mark.parametrize("camera", brief([*CAMERAS, 3, -1], kept=["franka/hand", -1]))
def test_images_are_those_of_dm_control(physics, camera):
    for options in ({}, {"segmentation": True}, {"scene_callback": None}):
        expected = mjcf.Physics.render(physics, HEIGHT, WIDTH, camera, **options)
        for _ in range(2):
            np.testing.assert_array_equal(physics.render(HEIGHT, WIDTH, camera, **options), expected)


@pytest.mark.full
def test_an_image_outlives_the_next_ones(physics):
    state = physics.get_state()
    first = physics.render(HEIGHT, WIDTH, "overview")
    kept = first.copy()
    physics.data.qpos[0] += 0.5
    physics.forward()
    later = physics.render(HEIGHT, WIDTH, "overview")
    physics.set_state(state)
    physics.forward()
    np.testing.assert_array_equal(first, kept)
    assert (later != kept).any()


@pytest.mark.full
def test_scenes_are_kept_between_images_until_the_context_is_freed(physics, monkeypatch):
    made = []
    monkeypatch.setattr("kitchen_suite.environment.mjcf_physics.Camera", lambda *a: made.append(a) or engine.Camera(*a))
    physics.free_context()
    for camera in ("overview", "overview", "left", "overview"):
        first = physics.render(HEIGHT, WIDTH, camera)
    assert [camera for *_, camera in made] == ["overview", "left"]
    physics.free_context()
    np.testing.assert_array_equal(physics.render(HEIGHT, WIDTH, "overview"), first)
    assert len(made) == 3


@pytest.mark.full
def test_a_scene_callback_still_adds_geoms(physics):
    def add(physics, scene):
        scene.ngeom = 0

    plain, empty = (physics.render(HEIGHT, WIDTH, "overview", scene_callback=each) for each in (None, add))
    assert (plain != empty).mean() > 0.5


@pytest.mark.full
@pytest.mark.parametrize("camera", CAMERAS)
def test_depth_is_in_metres(physics, camera):
    depth = physics.render(HEIGHT, WIDTH, camera_id=camera, depth=True)
    assert (depth.shape, depth.dtype) == ((HEIGHT, WIDTH), np.float32)
    assert 0.01 < depth.min() < 2.0
    assert np.median(depth) < 5.0


SPHERES = """
<mujoco>
  <worldbody>
    <geom size=".06" pos=".5 -.3 .1"/>
    <geom size=".06" pos="-.6 .5 .3"/>
    <geom size=".06" pos=".1 .1 .8"/>
    <camera name="tilted" pos="1 -2 1.5" fovy="50" xyaxes="0.9 0.4 0.1 -0.25 0.35 0.9"/>
  </worldbody>
</mujoco>
"""


def test_spheres_are_seen_where_the_parameters_of_a_camera_project_them():
    physics, (height, width) = mjcf.Physics.from_xml_string(SPHERES), (240, 320)
    intrinsics, world_from_camera = cameras.camera_parameters(physics, "tilted", width, height)
    seen = physics.render(height, width, camera_id="tilted", segmentation=True)[..., 0]
    for sphere, position in enumerate(physics.data.geom_xpos):
        pixel = intrinsics @ np.linalg.solve(world_from_camera, [*position, 1.0])[:3]
        rows, columns = np.nonzero(seen == sphere)
        # Edges are seen to within half a pixel, and their mean better; intrinsics of another origin are off by half.
        np.testing.assert_allclose([columns.mean(), rows.mean()], pixel[:2] / pixel[2], atol=0.25)


def seen_bodies(physics, camera):
    segmentation = physics.render(HEIGHT, WIDTH, camera_id=camera, segmentation=True)
    geoms = np.unique(segmentation[segmentation[..., 1] == mujoco.mjtObj.mjOBJ_GEOM][:, 0])
    return {physics.model.body(physics.model.geom_bodyid[geom]).name.split("/")[0] for geom in geoms}


@pytest.mark.full
@pytest.mark.parametrize("goal", brief(GOALS, [*GOALS][:4], full=GOALS))
def test_the_workspace_camera_shows_the_change_that_each_task_is_about(environment, goal):
    physics, state = environment.physics, environment.physics.get_state()
    qpos, _ = addresses(physics, GOALS[goal].joints_in(environment.task.scene))

    def picture(positions):
        with physics.reset_context():
            physics.set_state(state)
            physics.data.qpos[qpos] = positions
        return physics.render(128, 128, camera_id="workspace").astype(int)

    start = physics.data.qpos[qpos].copy() if GOALS[goal].start is None else GOALS[goal].start
    changed = np.abs(picture(GOALS[goal].value) - picture(start)).max(axis=-1) > 32
    with physics.reset_context():
        physics.set_state(state)
    # With different GL libraries 12 to 13 pixels of the smallest knob.
    assert changed.sum() > 8


@pytest.mark.full
@pytest.mark.parametrize(
    ("domain", "width"),
    brief(
        itertools.product(suite.DOMAINS, (0.0, 0.04)),
        kept=[("kitchen", 0.04), ("open_cabinet", 0.0)],
    ),
)
def test_the_hand_camera_shows_both_finger_tips_and_little_of_the_hand(domain, width):
    environment = suite.load(domain, suite.default_task(domain), {"random": 0})
    environment.reset()
    physics, robot = environment.physics, environment.task.robot
    physics.bind(robot.joints[-2:]).qpos = width
    physics.forward()
    camera = physics.bind(robot.mjcf_model.find("camera", "hand"))
    offset = physics.bind(robot.end_effector).xpos - camera.xpos
    x, y, z = offset @ np.asarray(camera.xmat).reshape(3, 3)
    # The tangent of half the field of view is 0.84.
    assert max(abs(x), abs(y)) / -z < 0.5
    segmentation = physics.render(128, 128, camera_id="franka/hand", segmentation=True)
    names = {physics.model.geom(int(geom)).name for geom in np.unique(segmentation[..., 0]) if geom >= 0}
    assert {"franka/left_finger_visual", "franka/right_finger_visual"} <= names
    is_hand = np.isin(segmentation[..., 0], [physics.model.geom("franka/hand_visual").id])
    assert is_hand.mean() < 0.2
    environment.close()


@pytest.mark.parametrize("camera", ["overview", "left", "right"])
def test_the_views_of_the_scene_show_robot_and_furniture(physics, camera):
    bodies = seen_bodies(physics, camera)
    assert {"franka", "oven", "counter", "kettle", "hood", "slide_cabinet", "hinge_cabinet", "walls"} <= bodies


def test_the_wrist_camera_sees_the_fingers_and_what_is_before_them(physics):
    assert {"franka", "kettle"} <= seen_bodies(physics, "franka/wrist")


@pytest.mark.full
@pytest.mark.parametrize(
    "entity",
    [
        functools.partial(entities.Robot, entities.KITCHEN_FRANKA),
        functools.partial(entities.Robot, entities.PANDA),
        entities.Counter,
        entities.Oven,
        entities.Hood,
        entities.Walls,
        entities.SlideCabinet,
        entities.HingeCabinet,
        entities.Microwave,
        entities.Kettle,
        entities.KitchenArena,
    ],
)
@pytest.mark.parametrize("visuals", [True, False])
def test_every_entity_compiles_and_renders_alone(entity, visuals):
    alone = mjcf.Physics.from_mjcf_model(entity(visuals=visuals).mjcf_model)
    alone.step()
    assert np.isfinite(alone.data.qpos).all()
    if visuals:
        assert alone.render(HEIGHT, WIDTH).std() > 5


@pytest.mark.full
def test_environments_render_side_by_side():
    """Each keeps to its own GL context, also after another one has rendered or has been closed."""
    environments = [
        gymnasium.make(env_id, render_mode="rgb_array", width=size, height=size)
        for env_id, size in (("KitchenSuite/FrankaKitchen-v1", 96), ("KitchenSuite/TopDrawer-v1", 64))
    ]
    pictures = []
    for environment in environments:
        environment.reset(seed=0)
        pictures.append(environment.render())
    for environment, picture in zip(environments, pictures, strict=True):
        np.testing.assert_array_equal(environment.render(), picture)
    environments[1].close()
    np.testing.assert_array_equal(environments[0].render(), pictures[0])
    environments[0].close()
