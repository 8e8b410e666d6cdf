"""`render_quality`: what images show, in every renderer, without an effect on trajectories."""

import gymnasium
import numpy as np
import pytest

from kitchen_suite import suite
from kitchen_suite.gymnasium_env import OPEN_CABINET_ID

TASKS = {"kitchen": "kettle", "open_cabinet": "top_drawer"}
SMALL = {"width": 96, "height": 64, "render_mode": "rgb_array", "camera_name": "overview"}


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


@pytest.mark.parametrize("domain", TASKS)
def test_the_quality_does_not_change_trajectories(domain):
    states = []
    for quality in ("high", "fast"):
        environment = suite.load(domain, TASKS[domain], {"random": 0, "render_quality": quality})
        environment.reset()
        for action in np.random.default_rng(0).uniform(-0.1, 0.1, (3, *environment.action_spec().shape)):
            environment.step(action)
        states.append(environment.get_state()["physics"])
        assert (environment.physics.model.mat_reflectance.max() > 0) == (quality == "high")
    np.testing.assert_array_equal(*states)


def test_an_unknown_quality_is_refused_with_a_list():
    with pytest.raises(ValueError, match=r"render_quality 'fats' does not exist \(did you mean 'fast'\?\)"):
        suite.load("kitchen", "kettle", {"render_quality": "fats"})
