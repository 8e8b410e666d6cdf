"""Physics under random actions: no NaN, no warning of MuJoCo's, no error."""

import numpy as np
import pytest

from kitchen_suite import suite


def run(task, steps, seed, scale=1.0):
    env = suite.load("open_cabinet", task, {"random": seed, "visuals": False})
    random = np.random.default_rng(seed)
    ends = 0
    for _ in range(steps):
        timestep = env.step(scale * random.normal(size=8))
        if timestep.first():
            continue
        ends += timestep.last()
        assert np.isfinite(timestep.reward)
        assert all(np.isfinite(values).all() for values in timestep.observation.values())
        assert not env.physics.data.ptr.warning.number.any()
    return ends


@pytest.mark.parametrize("task", ["top_drawer", "bottom_drawer"])
def test_a_few_thousand_random_steps(task):
    assert run(task, 4_000, 0) > 100


def test_gentle_actions_stay_gentle():
    # Small enough for whole episodes, large enough to bump into the cabinet.
    assert run("top_drawer", 4_000, 1, scale=0.03) < 50


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
def test_two_hundred_thousand_random_steps():
    assert run("top_drawer", 200_000, 2) > 1000
