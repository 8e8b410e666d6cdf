"""Shimmy wraps an environment of `suite.load` as a Gymnasium environment."""

import warnings

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence

from kitchen_suite import suite

pytestmark = pytest.mark.clients


@pytest.fixture(params=["microwave", "mixed", "flat"])
def environment(request):
    from shimmy.dm_control_compatibility import DmControlCompatibilityV0

    task, options = ("all", {"flat_observation": True}) if request.param == "flat" else (request.param, None)
    environment = DmControlCompatibilityV0(suite.load("kitchen", task, environment_kwargs=options))
    yield environment
    environment.close()


def test_gymnasiums_checker_has_nothing_to_say(environment):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(environment, skip_render_check=True)
    messages = [str(warning.message) for warning in caught]
    assert [message for message in messages if "infinity" not in message] == []


def episode(environment, seed):
    """Plays an episode of seeded random actions; returns the results of the reset and of each step."""
    rng = np.random.default_rng(0)
    observation, _ = environment.reset(seed=seed)
    steps = [(observation, 0.0, False, False)]
    while not any(steps[-1][2:]):
        steps.append(environment.step(rng.uniform(-1, 1, 9))[:4])
    return steps


def test_an_episode_is_truncated_after_280_steps_and_follows_from_its_seed(environment):
    first = episode(environment, 7)
    assert len(first) == 281
    assert [step[2:] for step in first] == [(False, False)] * 280 + [(False, True)]
    assert all(environment.observation_space.contains(step[0]) for step in first)
    assert data_equivalence(first, episode(environment, 7), exact=True)
    assert not data_equivalence(first, episode(environment, 8), exact=True)


def test_completing_every_task_terminates():
    from shimmy.dm_control_compatibility import DmControlCompatibilityV0

    # The goal lies within the threshold from the start.
    environment = DmControlCompatibilityV0(suite.load("kitchen", "microwave", {"goals": {"microwave": [-0.2]}}))
    environment.reset(seed=0)
    _, reward, terminated, truncated, _ = environment.step(np.zeros(9))
    assert (reward, terminated, truncated) == (1.0, True, False)
    environment.close()


@pytest.mark.rendering
def test_it_renders_by_camera_name():
    from shimmy.dm_control_compatibility import DmControlCompatibilityV0

    camera = {"camera_id": "overview", "width": 64, "height": 48}
    environment = DmControlCompatibilityV0(suite.load("kitchen", "kettle"), "rgb_array", camera)
    environment.reset(seed=0)
    picture = environment.render()
    assert (picture.shape, picture.dtype) == ((48, 64, 3), np.uint8)
    assert picture.std() > 20
    environment.close()
