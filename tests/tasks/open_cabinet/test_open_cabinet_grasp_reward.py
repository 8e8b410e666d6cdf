"""The reward `grasp`: recomputed, and earned by the expert, by a dragging hand and by no hand."""

import gymnasium
import numpy as np
import pytest
from helpers import open_cabinet
from helpers.errors import refused
from helpers.open_cabinet import HIGH, LOW, ROBOT_JOINTS, TERMS, RecomputedGrasp
from helpers.sweeps import brief

from kitchen_suite import suite
from kitchen_suite.entities import CabinetConfig
from kitchen_suite.gymnasium_env import OPEN_CABINET_ID
from kitchen_suite.tasks.open_cabinet.features import Features
from kitchen_suite.tasks.open_cabinet.rewards import REWARDS, grip, opening, terminates

# Poses in which the hand is around the top and the bottom handle.
AT_HANDLE = {
    "top": [0.0, 0.055, 0.0, -1.911, 0.0, 3.538, -0.785],
    "bottom": [0.0, 0.065, 0.0, -2.012, 0.0, 2.953, -0.785],
}


def load(task="top_drawer", **options):
    return suite.load("open_cabinet", task, {"random": 0, "visuals": False, "reward": "grasp", **options})


def random_state(physics, drawer, random):
    """Puts the fingers around the handle's bar, more or less, and opens the drawer a little."""
    arm = AT_HANDLE[drawer] + random.choice([0.002, 0.01, 0.1]) * random.normal(size=7)
    fingers = random.choice([0.006, 0.02]) + random.choice([0.001, 0.01]) * random.normal(size=2)
    with physics.reset_context():
        physics.named.data.qpos[ROBOT_JOINTS] = np.clip([*arm, *fingers], [*LOW, 0], [*HIGH, 0.04])
        physics.named.data.qpos[f"cabinet/drawer_{drawer}_joint"] = random.choice([0.0, 0.005]) * random.random()
        physics.data.qvel[:] = random.choice([0.01, 0.3]) * random.normal(size=13)


@pytest.mark.full
@pytest.mark.parametrize("drawer", brief(["top", "bottom"], kept=["bottom"]))
def test_every_term_recomputed_at_random_states(drawer):
    env = load(f"{drawer}_drawer")
    random, seen = np.random.default_rng(0), []
    for _ in range(500):
        env.reset()
        total_steps, action = int(random.integers(0, 16_000)), 0.01 * random.normal(size=8)
        env.task.total_steps = total_steps
        random_state(env.physics, drawer, random)
        timestep = env.step(action)
        expected = RecomputedGrasp(env.physics, drawer, action, total_steps)
        assert list(env.task.reward_terms) == TERMS
        for name, term in expected.terms.items():
            assert abs(env.task.reward_terms[name] - term) < 1e-6, name
        assert abs(timestep.reward - sum(expected.terms.values())) < 1e-6
        seen.append((expected.enclosure, expected.holding, expected.speed > 0))
    enclosure, holding, opens = np.transpose(seen)
    # Every branch has been taken.
    for share in (enclosure, holding):
        assert (share == 0).sum() > 10
        assert ((share > 0) & (share < 1)).sum() > 10
    assert ((holding > 0.5) & (opens == 1)).any()
    assert ((holding > 0) & (opens == 0)).any()


def pulling_steps(env, act):
    """Returns features, reward terms and contact of both pads for the steps of an episode in which the drawer opens."""
    timestep, steps = env.reset(), []
    while not timestep.last():
        timestep = env.step(act(timestep))
        if timestep.observation["drawer_velocity"][0] > 0.01:
            features = Features(env.task.state.features)
            steps.append((features, env.task.reward_terms, open_cabinet.pads_on_bar(env)))
    assert env.task.is_success
    return steps


@pytest.mark.full
@pytest.mark.parametrize("task", brief(["top_drawer", "bottom_drawer"], kept=["top_drawer"]))
def test_the_expert_earns_nearly_the_whole_reward_for_holding_while_it_pulls(task):
    env = load(task)
    env.reset()
    steps = pulling_steps(env, open_cabinet.opening_policy(env))
    assert len(steps) > 150
    assert np.mean([grip(features, 0.006).holding for features, _, _ in steps]) > 0.98
    assert np.mean([terms["grasp"] for _, terms, _ in steps]) > 0.98 * 4
    paid = sum(terms["opening"] for _, terms, _ in steps)
    assert paid > 0.98 * sum(50 * s.drawer_position + 10 * s.drawer_velocity for s, _, _ in steps)


@pytest.mark.full
def test_a_hand_that_drags_the_bar_earns_nothing_for_opening():
    env = load()
    env.reset()
    script = open_cabinet.dragging_script(env)
    steps = pulling_steps(env, lambda timestep: next(script))
    assert not any(touching for _, _, touching in steps)
    assert max(terms["opening"] for _, terms, _ in steps) < 0.01
    assert max(terms["grasp"] for _, terms, _ in steps) < 0
    # The original reward pays for dragging.
    assert max(opening(features) for features, _, _ in steps) > 5


@pytest.mark.parametrize(("gripper", "sign"), [(open_cabinet.OPEN, 0), (-open_cabinet.OPEN, -1)])
def test_a_drawer_that_opens_by_itself_pays_nothing(gripper, sign):
    env = load()
    env.reset()
    slide = env.physics.bind(env.task.scene.cabinet.drawer_joint("top"))
    for position in np.linspace(0.0, 0.2, 20):
        slide.qpos, slide.qvel = position, 1.0
        env.step([*np.zeros(7), gripper])
        assert env.task.drawer_opening > position
        assert env.task.reward_terms["opening"] == 0.0
        assert np.sign(env.task.reward_terms["grasp"]) == sign


def test_closing_a_drawer_costs_whether_it_is_held_or_not():
    env = load()
    env.reset()
    slide = env.physics.bind(env.task.scene.cabinet.drawer_joint("top"))
    slide.qpos, slide.qvel = 0.3, -1.0
    env.step(np.zeros(8))
    velocity = float(Features(env.task.state.features).drawer_velocity)
    assert velocity < -0.4
    assert env.task.reward_terms["opening"] == pytest.approx(10 * velocity)


def grips(shape, gaps=0.0):
    """Returns values of features of aligned grippers with the bar in their middle, `gaps` on either side of it [m]."""
    values = np.zeros((*shape, 36))
    values[..., [21, 28]] = 1.0
    values[..., [7, 8]] = 0.006 + gaps
    return values


def random_gaps(shape):
    """Returns `(*shape, 2)` gaps between the pads and the bar [m]."""
    return np.random.default_rng(0).uniform(0.0, 0.01, (*shape, 2))


def test_it_is_the_farther_pad_that_counts():
    gaps = random_gaps((4, 5))
    held = grip(Features(grips((4, 5), gaps)), 0.006)
    np.testing.assert_allclose(held.gap, gaps.max(axis=-1), atol=1e-15)
    np.testing.assert_array_equal(held.enclosure, np.ones((4, 5)))
    np.testing.assert_allclose(held.holding, 1 / (1 + 1000 * gaps.max(axis=-1)), rtol=1e-12)


@pytest.mark.parametrize(("column", "end"), [(25, 0.03), (26, 0.006), (27, 0.0095)])
def test_no_bar_is_held_beyond_the_pads(column, end):
    for side in (-1, 1):
        values, shares = grips(()), []
        for distance in np.linspace(0.0, 1.2 * end, 13):
            values[column] = side * distance
            shares.append(float(grip(Features(values), 0.006).enclosure))
        assert shares[0] == 1.0
        assert 0.0 < shares[8] < 1.0
        assert max(shares[10:]) < 1e-9
        assert shares == sorted(shares, reverse=True)


def test_no_bar_is_held_beside_fingers_that_open_along_it():
    values = grips(())
    values[21:25] = np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)
    values[26] = 0.02
    assert grip(Features(values), 0.006).enclosure == 0.0


def test_a_batch_and_its_rows_have_equal_rewards():
    values = grips((30,), random_gaps((30,)))
    random = np.random.default_rng(1)
    values[:, 18:21] = random.normal(scale=0.004, size=(30, 3))
    values[:, 34:36] = random.uniform(-0.3, 0.3, (30, 2))
    batch = Features(values)
    rewards = REWARDS["grasp"]
    gripper, change, steps = random.choice([0.0, 0.04], 30), random.normal(size=(30, 8)), np.arange(30) * 500
    terms = open_cabinet.reward_terms(
        rewards,
        batch,
        gripper=gripper,
        action_change=change,
        total_steps=steps,
        terminated=terminates(batch),
        handle_radius=0.006,
    )
    assert len(set(terms["opening"])) > 20
    for i in range(30):
        row = Features(values[i])
        single = open_cabinet.reward_terms(
            rewards,
            row,
            gripper=gripper[i],
            action_change=change[i],
            total_steps=int(steps[i]),
            terminated=terminates(row),
            handle_radius=0.006,
        )
        for name, term in single.items():
            assert term.shape == ()
            np.testing.assert_allclose(term, terms[name][i], rtol=1e-13, atol=1e-15)


@pytest.mark.full
def test_a_thicker_bar_is_held_by_fingers_farther_apart():
    features = Features(grips((), 0.004))
    assert grip(features, 0.01).holding == 1.0
    assert grip(features, 0.006).holding == pytest.approx(0.2)
    env = load(cabinet_config=CabinetConfig(handle_radius=0.01))
    env.reset()
    steps = pulling_steps(env, open_cabinet.opening_policy(env))
    assert np.mean([terms["grasp"] for _, terms, _ in steps]) > 0.98 * 4


def test_vectorised_and_single_environments_have_equal_rewards():
    settings = {"reward": "grasp", "gripper": "deterministic"}
    many = gymnasium.make_vec(OPEN_CABINET_ID, 3, vectorization_mode="vector_entry_point", num_threads=1, **settings)
    singles = [gymnasium.make(OPEN_CABINET_ID, **settings) for _ in range(3)]
    many.reset(seed=7)
    for i, single in enumerate(singles):
        single.reset(seed=7 + i)
    for actions in np.random.default_rng(0).normal(scale=0.02, size=(20, 3, 8)):
        _, rewards, _, _, infos = many.step(actions)
        for i, single in enumerate(singles):
            _, reward, _, _, info = single.step(actions[i])
            assert rewards[i] == reward
            assert all(infos[f"reward/{name}"][i] == info[f"reward/{name}"] for name in TERMS)


@pytest.mark.full
def test_the_original_reward_is_the_default():
    rewards = []
    for options in ({}, {"reward": "original"}, {"reward": "grasp"}):
        env = suite.load("open_cabinet", "top_drawer", {"random": 0, "visuals": False, **options})
        env.reset()
        rewards.append([env.step(np.full(8, 0.01)).reward for _ in range(5)])
    assert rewards[0] == rewards[1]
    assert not set(rewards[0]) & set(rewards[2])


def test_an_unknown_reward_is_refused_with_the_choices():
    with refused(ValueError, "'grsp'", "'grasp'"):
        load(reward="grsp")
    with pytest.raises(TypeError, match="reward must be a string, got 1"):
        gymnasium.make(OPEN_CABINET_ID, reward=1)
