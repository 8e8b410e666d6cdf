"""In every control mode, vectorised environments equal Gymnasium's vector of single ones to the bit."""

import itertools

import gymnasium
import numpy as np
import pytest
from helpers.open_cabinet import VARIED
from helpers.sweeps import CASES, brief, walk
from test_vector_autoreset import COUNT, MODES, assert_equal_for_ever, many, pair

from kitchen_suite import suite

STEPS = 24
DRAWS = {
    "kitchen": {},
    "open_cabinet": {"observation_noise": {"handle_offset": 0.01}, "variations": VARIED},
    "microwave_table": {},
    "kitchens": {},
}


def actions_for(domain, mode, **settings):
    env = gymnasium.make(suite.DOMAINS[domain].env_id, control_mode=mode, **settings).unwrapped
    return walk(env.environment.action_spec(), STEPS, COUNT)


# The others differ from these in a few lines, or are played by other tests.
BRIEF = [("kitchen", "joint_position"), ("open_cabinet", "ee_delta_position"), ("kitchens", "joint_delta")]
FURTHER = [("open_cabinet", "joint_delta"), ("open_cabinet", "ee_pose"), ("microwave_table", "ee_delta_pose")]


@pytest.mark.full
@pytest.mark.parametrize(("domain", "mode"), brief(CASES, BRIEF, full=FURTHER))
def test_every_control_mode(domain, mode):
    autoreset = MODES[CASES.index((domain, mode)) % len(MODES)]
    settings = {"control_mode": mode, **DRAWS[domain]}
    ours, theirs = pair(suite.DOMAINS[domain].env_id, autoreset, max_episode_steps=9, **settings)
    assert sum(assert_equal_for_ever(ours, theirs, actions_for(domain, mode))) >= 3


@pytest.mark.full
@pytest.mark.parametrize(
    ("domain", "autoreset"),
    brief(itertools.product(("kitchen", "open_cabinet"), MODES), kept=[("open_cabinet", "SameStep")]),
)
def test_every_autoreset_mode(domain, autoreset):
    settings = {"control_mode": "ee_delta_pose", "frame": "hand", **DRAWS[domain]}
    ours, theirs = pair(suite.DOMAINS[domain].env_id, autoreset, max_episode_steps=9, **settings)
    assert_equal_for_ever(ours, theirs, actions_for(domain, "ee_delta_pose"))


@pytest.mark.parametrize(
    ("domain", "mode"), [pytest.param("kitchen", "ee_pose", marks=pytest.mark.nightly), ("open_cabinet", "joint_delta")]
)
def test_the_number_of_threads_changes_nothing(domain, mode):
    env_id, actions = suite.DOMAINS[domain].env_id, actions_for(domain, mode)
    one, three = (many(env_id, "SameStep", threads, max_episode_steps=7, control_mode=mode) for threads in (1, 3))
    for env in (one, three):
        env.reset(seed=1)
    for action in actions:
        np.testing.assert_equal(three.step(action)[:4], one.step(action)[:4])


@pytest.mark.nightly
def test_resting_objects_may_sleep():
    settings = {"control_mode": "ee_delta_pose", "sleep": True}
    ours, theirs = pair(suite.DOMAINS["kitchen"].env_id, "NextStep", max_episode_steps=9, **settings)
    assert_equal_for_ever(ours, theirs, actions_for("kitchen", "ee_delta_pose"))
