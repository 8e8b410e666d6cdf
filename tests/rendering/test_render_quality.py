"""`render_quality`: what images show, in every renderer, without an effect on trajectories."""

import gymnasium
import numpy as np
import pytest
from helpers.errors import refused
from helpers.sweeps import brief

from kitchen_suite import suite
from kitchen_suite.gymnasium_env import OPEN_CABINET_ID
from kitchen_suite.rendering import quality as light_meshes

TASKS = {"kitchen": "kettle", "open_cabinet": "top_drawer", "kitchens": "open", "pick_and_place": "put_in"}
SMALL = {"width": 96, "height": 64, "render_mode": "rgb_array", "camera_name": "overview"}


@pytest.mark.full
@pytest.mark.rendering
def test_fast_images_show_the_same_scene_in_every_renderer():
    environment, fast = (
        suite.load("open_cabinet", "top_drawer", {"random": 0, "render_quality": quality})
        for quality in ("high", "fast")
    )
    single = gymnasium.make(OPEN_CABINET_ID, render_quality="fast", **SMALL)
    vector = gymnasium.make_vec(
        OPEN_CABINET_ID, 1, vectorization_mode="vector_entry_point", num_threads=1, render_quality="fast", **SMALL
    )
    for each in (environment, fast, single, vector):
        each.reset()
    (of_vector,) = vector.render()
    pictures = {
        "high": environment.physics.render(64, 96, camera_id="overview"),
        "fast": fast.physics.render(64, 96, camera_id="overview"),
        "single": single.render(),
        "vector": of_vector,
    }
    assert min(picture.std() for picture in pictures.values()) > 20
    assert np.abs(pictures["high"].astype(float) - pictures["fast"]).mean() > 1
    # Robots start at positions of their own, since the random streams differ.
    for name in ("single", "vector"):
        assert np.median(np.abs(pictures[name].astype(float) - pictures["fast"])) == 0
    for each in (environment, fast, single, vector):
        each.close()


@pytest.mark.full
@pytest.mark.parametrize("domain", brief(TASKS, kept=["open_cabinet"]))
def test_the_quality_does_not_change_trajectories(domain, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    trajectories = []
    for quality in ("high", "fast"):
        environment = suite.load(domain, TASKS[domain], {"random": 0, "render_quality": quality})
        environment.reset()
        states = []
        for action in np.random.default_rng(0).uniform(-0.5, 0.5, (40, *environment.action_spec().shape)):
            environment.step(action)
            states.append(np.concatenate([environment.get_state()["physics"], environment.physics.data.qacc]))
        trajectories.append(states)
        assert (environment.physics.model.mat_reflectance.max() > 0) == (quality == "high")
        # Of 136,000 at least.
        assert (environment.physics.model.mesh_facenum.sum() < 25_000) == (quality == "fast")
    np.testing.assert_array_equal(*trajectories)


@pytest.mark.full
@pytest.mark.rendering
@pytest.mark.parametrize("camera", brief(["overview", "franka/wrist"], kept=["overview"]))
def test_light_meshes_are_seen_where_the_full_ones_are(camera, monkeypatch):
    light = suite.load("kitchen", "kettle", {"random": 0, "render_quality": "fast"})
    monkeypatch.setattr(light_meshes, "is_large", lambda stl: False)
    full = suite.load("kitchen", "kettle", {"random": 0, "render_quality": "fast"})
    for environment in (light, full):
        environment.reset()
    labels = [each.physics.render(128, 128, camera, segmentation=True) for each in (light, full)]
    depths = [each.physics.render(128, 128, camera, depth=True) for each in (light, full)]
    pictures = [each.physics.render(128, 128, camera).astype(float) for each in (light, full)]
    same = (labels[0] == labels[1]).all(axis=-1)
    # 99.92 % and 99.95 % from above, all from the wrist; the mean difference of colours is 0.36 of 255.
    assert same.mean() > 0.998
    assert np.mean(np.abs(depths[0] - depths[1])[same] < 2e-3) > 0.998
    assert np.abs(pictures[0] - pictures[1]).mean() < 1


def images_of(env):
    """The image of `render()`, and those that are observed, if any, at the start of an episode."""
    seen, _ = env.reset(seed=0)
    images = [env.render()]
    if isinstance(seen, np.ndarray) and seen.dtype == np.uint8:
        images.append(seen)
    env.close()
    return images


@pytest.mark.full
@pytest.mark.rendering
@pytest.mark.parametrize("front_end", [gymnasium.make, gymnasium.make_vec])
@pytest.mark.parametrize(
    ("obs_type", "render_mode", "quality"),
    [("state", "rgb_array", "fast"), ("state", "depth_array", "fast"), ("pixels", "rgb_array", "high")],
)
def test_render_is_fast_unless_images_are_observed(front_end, obs_type, render_mode, quality):
    arguments = {**SMALL, "render_mode": render_mode, "obs_type": obs_type}
    if front_end is gymnasium.make_vec:
        arguments |= {"vectorization_mode": "vector_entry_point", "num_threads": 1, "num_envs": 1}
    given = front_end(OPEN_CABINET_ID, render_quality=quality, **arguments)
    for image, same in zip(images_of(front_end(OPEN_CABINET_ID, **arguments)), images_of(given), strict=True):
        np.testing.assert_array_equal(image, same)


def test_images_of_physics_are_of_high_quality_by_default():
    environments = [suite.load("open_cabinet", "top_drawer"), gymnasium.make(OPEN_CABINET_ID).unwrapped.environment]
    assert all(each.physics.model.vis.quality.shadowsize > 0 for each in environments)


@pytest.mark.full
def test_the_default_is_quiet_without_the_packages_of_light_meshes(monkeypatch, recwarn):
    monkeypatch.setattr(light_meshes, "missing_packages", lambda: ["trimesh"])
    gymnasium.make(OPEN_CABINET_ID, **SMALL).close()
    assert not [each for each in recwarn if "trimesh" in str(each.message)]
    with pytest.warns(UserWarning, match="trimesh"):
        gymnasium.make(OPEN_CABINET_ID, render_quality="fast", **SMALL).close()


def test_an_unknown_quality_is_refused_with_a_list():
    with refused(ValueError, "render_quality", "'fats'", "'fast'"):
        suite.load("kitchen", "kettle", {"render_quality": "fats"})
