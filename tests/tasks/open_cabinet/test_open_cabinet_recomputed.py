"""Observation and every reward term of the open_cabinet domain, recomputed at 1,000 random states."""

import numpy as np
import pytest
from helpers.open_cabinet import HIGH, LOW, ROBOT_JOINTS, TERMS, Recomputed, flat

from kitchen_suite import suite

# A pose in which the hand is around the top handle.
AT_HANDLE = np.array([0.0, 0.06, 0.0, -1.91, 0.0, 3.54, -0.785, 0.02, 0.02])


def random_state(physics, random):
    """Sets random robot and drawer positions, most of them with the hand near the handle."""
    near = random.random() < 0.7
    scale = random.choice([0.01, 0.05, 0.3])
    pose = AT_HANDLE + scale * random.normal(size=9) if near else random.uniform([*LOW, 0], [*HIGH, 0.04])
    with physics.reset_context():
        physics.named.data.qpos[ROBOT_JOINTS] = np.clip(pose, [*LOW, 0], [*HIGH, 0.04])
        # Closed, or open so little that the hand is still at the handle, or wide open.
        physics.data.qpos[9:11] = random.choice([0.0, 0.01, 0.2], 2) * random.random(2)
        physics.data.qvel[:] = random.choice([0.1, 1.0]) * random.normal(size=13)


@pytest.mark.full
@pytest.mark.parametrize("drawer", ["top", pytest.param("bottom", marks=pytest.mark.nightly)])
def test_observation_and_reward_recomputed_at_a_thousand_random_states(drawer):
    env = suite.load("open_cabinet", f"{drawer}_drawer", {"random": 0, "visuals": False})
    random, seen = np.random.default_rng(0), []
    for _ in range(1000):
        env.reset()
        total_steps = int(random.integers(0, 16_000))
        actions = 0.3 * random.normal(size=(2, 8))
        env.task.set_state({**env.task.get_state(), "total_steps": total_steps, "previous_action": actions[0]})
        random_state(env.physics, random)
        timestep = env.step(actions[1])
        expected = Recomputed(env.physics, drawer, actions[1] - actions[0], total_steps)
        np.testing.assert_allclose(flat(timestep), expected.observation, rtol=0, atol=1e-6)
        assert list(env.task.reward_terms) == TERMS
        for name, term in expected.terms.items():
            assert abs(env.task.reward_terms[name] - term) < 1e-6, name
        assert abs(timestep.reward - sum(expected.terms.values())) < 1e-6
        assert timestep.last() == expected.terminates
        assert timestep.discount == 1 - expected.terminates
        assert env.task.drawer_opening == expected.open
        seen.append(expected)
    if drawer == "top":
        # Every branch has been taken.
        assert {each.terms["grasp"] for each in seen} == {0.0, 4.0, -0.8}
        assert {each.terms["opening"] > 0 for each in seen} == {True, False}
        assert any(each.open > 0.02 and each.terms["opening"] == 0 for each in seen)
        assert any(abs(each.v).max() > 5 for each in seen)
        assert any(abs(each.v).max() < 5 and each.terminates for each in seen)
    assert any(each.terms["straddling"] < -1e-3 for each in seen)
