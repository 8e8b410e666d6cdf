"""Depth and segmentation as measurements: against rays and geometry, which are no images, in every quality."""

import copy

import mujoco
import numpy as np
import pytest
from dm_control import mjcf
from helpers.vectors import many

from kitchen_suite import suite
from kitchen_suite.environment.mjcf_physics import Physics
from kitchen_suite.gymnasium_env import OPEN_CABINET_ID, FrankaOpenCabinetEnv
from kitchen_suite.rendering import cameras

pytestmark = pytest.mark.rendering

HEIGHT, WIDTH = 48, 64
DOMAINS = ("kitchen", "open_cabinet", "microwave_table", "kitchens", "pick_and_place")

# Cylinders, capsules, spheres and ellipsoids are drawn with facets, up to some millimetres within the shape.
WITH_FLAT_FACES = (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_MESH)


def directions(physics, camera):
    """Returns the origin of a camera and, in the world, the vectors to the centres of pixels at depth 1."""
    intrinsics, pose = cameras.camera_parameters(physics, camera, WIDTH, HEIGHT)
    rows, columns = np.indices((HEIGHT, WIDTH))
    in_camera = np.stack([columns, rows, np.ones_like(rows)], axis=-1) @ np.linalg.inv(intrinsics).T
    return pose[:3, 3], in_camera @ pose[:3, :3].T


def planes_of_view(physics):
    """Returns the depths of the near and the far clipping plane."""
    model = physics.model
    return model.vis.map.znear * model.stat.extent, model.vis.map.zfar * model.stat.extent


def cast_rays(physics, camera, *, with_translucent):
    """Returns depths and geoms at the centres of pixels by MuJoCo's rays; inf and -1 where there is nothing."""
    model, (near, _), (origin, vectors) = (
        copy.copy(physics.model.ptr),
        planes_of_view(physics),
        directions(physics, camera),
    )
    opacity = np.where(model.geom_matid >= 0, model.mat_rgba[model.geom_matid, 3], model.geom_rgba[:, 3])
    if not with_translucent:
        model.geom_group[opacity < 0.995] = 5
    # Those that images show.
    groups = np.array([1, 1, 1, 0, 0, 0], np.uint8)
    depths, geoms = np.full((HEIGHT, WIDTH), np.inf), np.full((HEIGHT, WIDTH), -1)
    hit = np.zeros(1, np.int32)
    for pixel in np.ndindex(HEIGHT, WIDTH):
        start = origin + near * vectors[pixel]
        distance = mujoco.mj_ray(model, physics.data.ptr, start, vectors[pixel], groups, 1, -1, hit, None)
        if distance >= 0:
            depths[pixel], geoms[pixel] = near + distance, hit[0]
    return depths, geoms


def neighbourhoods(image):
    """Returns the 3 x 3 pixels around each pixel that is not at the border."""
    return np.lib.stride_tricks.sliding_window_view(image, (3, 3))


def assert_depth_is_that_of_rays(physics, camera, depth):
    expected, geoms = cast_rays(physics, camera, with_translucent=False)
    around, expected, geoms = neighbourhoods(geoms), expected[1:-1, 1:-1], geoms[1:-1, 1:-1]
    inside = (around == geoms[..., None, None]).all(axis=(-1, -2))
    measured, (near, far) = depth[1:-1, 1:-1].astype(float), planes_of_view(physics)
    flat = inside & (geoms >= 0) & np.isin(physics.model.geom_type[geoms], WITH_FLAT_FACES)
    assert flat.sum() > 300
    # Two steps of the z-buffer, which has 24 bits, and the rounding of positions to float32.
    tolerance = 2 * expected[flat] ** 2 / near * 2.0**-24 + 1e-6
    error = np.abs(measured[flat] - expected[flat])
    assert np.mean(error < tolerance) > 0.99
    assert np.median(error) < 2e-5
    # Steps of the z-buffer are some centimetres there.
    np.testing.assert_allclose(measured[inside & (geoms < 0)], far, rtol=1e-3)


SWEEP = [
    (domain, camera, quality)
    for domain in DOMAINS
    for camera in ("overview", "franka/wrist")
    for quality in ("high", "fast")
]


@pytest.mark.full
@pytest.mark.parametrize(("domain", "camera", "quality"), SWEEP)
def test_depth_is_the_distance_that_rays_travel_in_every_quality(domain, camera, quality):
    environment = suite.load(domain, suite.default_task(domain), {"random": 0, "render_quality": quality})
    environment.reset()
    physics = environment.physics
    assert_depth_is_that_of_rays(physics, camera, physics.render(HEIGHT, WIDTH, camera, depth=True))
    environment.close()


@pytest.mark.full
@pytest.mark.parametrize(("domain", "camera", "quality"), SWEEP)
def test_segmentation_is_what_rays_hit_with_no_mixed_labels_at_edges(domain, camera, quality):
    environment = suite.load(domain, suite.default_task(domain), {"random": 0, "render_quality": quality})
    environment.reset()
    physics = environment.physics
    labels = physics.render(HEIGHT, WIDTH, camera, segmentation=True)[1:-1, 1:-1]
    assert set(np.unique(labels[..., 1])) <= {-1, int(mujoco.mjtObj.mjOBJ_GEOM)}
    _, geoms = cast_rays(physics, camera, with_translucent=True)
    around, geoms, seen = neighbourhoods(geoms), geoms[1:-1, 1:-1], labels[..., 0]
    inside = (around == geoms[..., None, None]).all(axis=(-1, -2))
    # A pixel or two, where meshes of the arm that are simplified meet each other.
    assert np.mean(seen[inside] == geoms[inside]) > 0.998
    assert np.mean((around == seen[..., None, None]).any(axis=(-1, -2))) > 0.998
    environment.close()


@pytest.mark.full
def test_observed_depth_is_measured_in_the_default_quality_of_each_front_end():
    settings = {"obs_type": "pixels", "depth": True, "image_size": (HEIGHT, WIDTH), "cameras": ["overview"]}
    single = FrankaOpenCabinetEnv(**settings)
    seen, _ = single.reset(seed=0)
    assert_depth_is_that_of_rays(single.environment.physics, "overview", seen["depth"][..., 0])
    vector = many(OPEN_CABINET_ID, 1, **settings)
    of_vector, _ = vector.reset(seed=[0])
    np.testing.assert_array_equal(of_vector["depth"][0], seen["depth"])
    arguments = {"cameras": ["overview"], "depth": True, "image_size": (HEIGHT, WIDTH), "random": 0}
    environment = suite.load("open_cabinet", "top_drawer", arguments)
    observed = environment.reset().observation["overview/depth"]
    assert_depth_is_that_of_rays(environment.physics, "overview", observed[..., 0])
    for each in (single, vector, environment):
        each.close()


@pytest.mark.full
@pytest.mark.parametrize("camera", ["overview", "franka/hand", -1])
def test_depth_is_that_of_dm_control_where_that_has_no_multisampling_and_no_sky(camera):
    environment = suite.load("microwave_table", "open", {"random": 0, "render_quality": "fast"})
    environment.reset()
    expected = mjcf.Physics.render(environment.physics, HEIGHT, WIDTH, camera, depth=True)
    np.testing.assert_array_equal(environment.physics.render(HEIGHT, WIDTH, camera, depth=True), expected)
    environment.close()


# A floor, glass before the camera, and a wall that is seen from behind.
FLOOR = """
<mujoco>
  <statistic extent="1"/>
  <visual>
    <map znear=".01" zfar="50"/>
    <quality offsamples="4" shadowsize="256"/>
  </visual>
  <asset>
    <texture type="skybox" builtin="gradient" rgb1="0 0 .5" rgb2="1 1 1" width="32" height="32"/>
  </asset>
  <worldbody>
    <light pos="0 0 3" dir="0 0 -1"/>
    <geom type="plane" size="0 0 1"/>
    <geom type="box" size=".3 .01 .3" pos="0 -1.5 1.3" rgba="1 1 1 .3"/>
    <geom type="plane" size="3 3 1" pos="0 -1.2 1" zaxis="0 1 0"/>
    <camera name="tilted" pos="0 -2 1.5" fovy="60" xyaxes="1 0 0 0 .3 1"/>
  </worldbody>
</mujoco>
"""


@pytest.fixture
def floor():
    physics = Physics.from_xml_string(FLOOR)
    yield physics
    physics.free()


def depth_of_floor(physics):
    """Returns the depth of the floor, and where the horizon is below the pixel."""
    origin, vectors = directions(physics, "tilted")
    with np.errstate(divide="ignore"):
        return -origin[2] / vectors[..., 2], vectors[..., 2] >= 0


def test_depth_is_that_of_the_floor_behind_glass_and_of_nothing_in_the_sky(floor):
    depth = floor.render(HEIGHT, WIDTH, "tilted", depth=True)
    expected, is_sky = depth_of_floor(floor)
    near_floor = ~is_sky & (expected < 5)
    assert near_floor.sum() > 300
    # The z-buffer has steps of 0.15 mm in 5 m.
    np.testing.assert_allclose(depth[near_floor], expected[near_floor], atol=5e-4)
    assert is_sky.sum() > 300
    np.testing.assert_allclose(depth[is_sky], 50.0, rtol=1e-2)


def test_segmentation_shows_the_glass_that_depth_looks_through(floor):
    labels = floor.render(HEIGHT, WIDTH, "tilted", segmentation=True)[..., 0]
    assert (labels == 1).sum() > 100


def test_depth_shows_what_a_scene_callback_adds(floor):
    camera = floor.data.camera("tilted")
    axes = camera.xmat.reshape(3, 3)

    def add(physics, scene):
        scene.ngeom += 1
        mujoco.mjv_initGeom(
            scene.geoms[scene.ngeom - 1],
            mujoco.mjtGeom.mjGEOM_BOX,
            np.array([0.1, 0.1, 0.05]),
            camera.xpos - 0.45 * axes[:, 2],
            camera.xmat,
            np.ones(4, np.float32),
        )

    depth = floor.render(HEIGHT, WIDTH, "tilted", depth=True, scene_callback=add)
    assert abs(depth[HEIGHT // 2, WIDTH // 2] - 0.4) < 1e-5


def test_images_in_colours_are_the_same_before_and_after_depth(floor):
    first = floor.render(HEIGHT, WIDTH, "tilted")
    floor.render(HEIGHT, WIDTH, "tilted", depth=True)
    floor.render(HEIGHT, WIDTH, "tilted", segmentation=True)
    np.testing.assert_array_equal(floor.render(HEIGHT, WIDTH, "tilted"), first)
    np.testing.assert_array_equal(mjcf.Physics.render(floor, HEIGHT, WIDTH, "tilted"), first)
