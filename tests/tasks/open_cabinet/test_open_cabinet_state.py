"""Saved states of the open_cabinet domain: restored exactly, or refused."""

import numpy as np
import pytest
from helpers import open_cabinet
from helpers.errors import refused
from helpers.open_cabinet import load


@pytest.mark.parametrize(
    ("change", "error"),
    [
        ({"total_steps": -1}, ValueError),
        ({"total_steps": 1.5}, TypeError),
        ({"previous_action": np.zeros(7)}, ValueError),
        ({"previous_action": np.full(8, np.nan)}, ValueError),
        ({"colour": 1}, ValueError),
    ],
)
def test_a_bad_state_is_refused_before_anything_changes(change, error):
    task = load().task
    before = task.get_state()
    with pytest.raises(error, match=next(iter(change))):
        task.set_state({**before, "terminates": True, **change})
    assert task.get_state()["terminates"] is False


@pytest.mark.full
@pytest.mark.parametrize("variations", [None, open_cabinet.VARIED])
def test_an_environment_goes_on_from_anothers_state(variations):
    one, other = (load(random=seed, variations=variations) for seed in (1, 2))
    random = np.random.default_rng(0)
    actions = 0.05 * random.normal(size=(40, 8))
    for env in (one, other):
        env.reset()
    for action in actions[:20]:
        one.step(action)
    observation = other.set_state(one.get_state())
    now = one.task.get_state()["features"]["handle_position"] - one.task.get_state()["features"]["tcp_position"]
    np.testing.assert_allclose(observation["handle_offset"], now, atol=1e-6)
    assert other.task.reward_terms == one.task.reward_terms
    for action in actions[20:]:
        mine, copy = one.step(action), other.step(action)
        assert mine.reward == copy.reward
        for name, values in mine.observation.items():
            np.testing.assert_array_equal(values, copy.observation[name])


@pytest.mark.full
@pytest.mark.parametrize("variations", [None, open_cabinet.VARIED])
def test_a_grasped_and_moving_drawer_goes_on_from_anothers_state(variations):
    noise = {"handle_offset": 0.01}
    one, other = (load(random=seed, variations=variations, observation_noise=noise) for seed in (3, 4))
    timestep, act = one.reset(), open_cabinet.opening_policy(one)
    other.reset()
    while one.task.drawer_opening <= 0.1:
        timestep = one.step(act(timestep))
        assert timestep.mid()
    other.set_state(one.get_state())
    assert open_cabinet.pads_on_bar(one)
    assert one.task.get_state()["features"]["drawer_velocity"] > 0.05
    for _ in range(30):
        action = act(timestep)
        timestep, copy = one.step(action), other.step(action)
        assert timestep.reward == copy.reward
        np.testing.assert_array_equal(one.physics.data.qpos, other.physics.data.qpos)
        for name, values in timestep.observation.items():
            np.testing.assert_array_equal(values, copy.observation[name])


def test_a_state_of_the_other_drawer_is_refused():
    top, bottom = load("top_drawer"), load("bottom_drawer")
    for env in (top, bottom):
        env.reset()
    before = bottom.task.get_state()
    with refused(ValueError, "another environment", "drawer"):
        bottom.set_state(top.get_state())
    after = bottom.task.get_state()
    np.testing.assert_array_equal(after["features"]["handle_position"], before["features"]["handle_position"])


def test_a_state_with_a_negative_friction_is_refused_before_anything_changes():
    task = load(variations=open_cabinet.VARIED).task
    state = task.get_state()
    state["variation_values"]["cabinet/drawer_top_friction"] = np.array(-1.0)
    with refused(ValueError, "cabinet/drawer_top_friction", "-1"):
        task.set_state({**state, "total_steps": 5})
    assert task.total_steps == 0
    assert task.get_state()["variation_values"]["cabinet/drawer_top_friction"] == 3.0


@pytest.mark.full
@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("size", [1e160, np.finfo(np.float64).max])
def test_the_greatest_actions_give_finite_rewards_and_states(size):
    one, other = load(), load()
    for env in (one, other):
        env.reset()
    for sign in (1, -1):
        timestep = one.step(sign * np.full(8, size))
        assert np.isfinite(timestep.reward)
        assert np.isfinite(list(one.task.reward_terms.values())).all()
        other.set_state(one.get_state())
        if timestep.last():
            one.reset()
