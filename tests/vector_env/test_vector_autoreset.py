"""Vectorised environments are Gymnasium's vector of single ones, to the bit, in every autoreset mode."""

import copy

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from helpers.comparisons import assert_same
from helpers.errors import refused
from helpers.open_cabinet import VARIED
from helpers.original import random_actions
from helpers.sweeps import brief

from kitchen_suite.gymnasium_env import KITCHEN_ID, OPEN_CABINET_ID
from kitchen_suite.vector_env import FrankaKitchenVectorEnv, FrankaOpenCabinetVectorEnv

COUNT, STEPS = 3, 34
MODES = [mode.value for mode in AutoresetMode]

# The microwave pays in the first step; of the walks below, only the first one pushes the kettle near enough.
EASY = {"tasks_to_complete": ["microwave", "kettle"], "goals": {"microwave": [0.1]}, "threshold": 0.37}
NOISE = {"handle_offset": 0.01, "joint_positions": 0.02}
KITCHENS = {
    "lists": EASY,
    "instructed": {**EASY, "instructions": True},
    "arrays": {**EASY, "goal_format": "flat", "info_format": "arrays"},
    "paid again": {**EASY, "remove_task_when_completed": False, "terminate_on_tasks_completed": False},
    "dense": {**EASY, "reward": "dense", "terminate_on_tasks_completed": True},
    "dense gain": {**EASY, "reward": "dense_gain"},
    "strict": {**EASY, "goals": {"microwave": [0.02]}, "threshold": None, "success": "strict", "reward": "dense_gain"},
    "no noise": {**EASY, "robot_noise_ratio": 0.0, "feedback": "target", "goal_format": "flat"},
}
CABINETS = {
    "plain": {},
    "noise": {"observation_noise": NOISE, "drawer": "bottom"},
    "varied": {"variations": VARIED},
    "all drawn": {"variations": VARIED, "observation_noise": NOISE},
    "no draws": {"gripper": "deterministic", "action_limit": 3.0},
}


def kitchen_actions():
    return np.stack([random_actions(np.random.default_rng(seed), STEPS) for seed in (3, 2, 0)], axis=1)


def cabinet_actions():
    actions = np.random.default_rng(0).normal(scale=0.02, size=(STEPS, COUNT, 8))
    # Jerks, which end an episode: a joint moves too fast.
    for i, start in enumerate((6, 8, 17)):
        actions[start : start + 6, i] = 200.0 * actions[start, i]
    return actions


def many(env_id, mode, num_threads=2, **settings):
    return gymnasium.make_vec(
        env_id,
        COUNT,
        vectorization_mode="vector_entry_point",
        autoreset_mode=mode,
        num_threads=num_threads,
        **settings,
    )


def pair(env_id, mode, **settings):
    singles = gymnasium.make_vec(
        env_id, COUNT, vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode}, **settings
    )
    return many(env_id, mode, **settings), singles


@pytest.fixture
def vector_pair():
    """Two equal vectorised environments without autoreset, after the same reset."""
    envs = [many(KITCHEN_ID, "Disabled") for _ in range(2)]
    for env in envs:
        env.reset(seed=2)
    yield envs
    for env in envs:
        env.close()


def assert_equal_for_ever(ours, theirs, actions):
    """Plays both; returns how many episodes terminated and how many were truncated."""

    def reset(**kwargs):
        # Gymnasium takes the mask out of the options.
        assert_same(ours.reset(**copy.deepcopy(kwargs)), theirs.reset(**copy.deepcopy(kwargs)))

    ends = np.zeros(2, int)
    reset(seed=2**40)
    for number, action in enumerate(actions):
        if number == 4:
            # From here on their episodes end at different steps.
            reset(seed=[None, 77, 5], options={"reset_mask": np.array([True, True, False])})
        stepped = ours.step(action)
        assert_same(stepped, theirs.step(action))
        assert ours.observation_space.contains(stepped[0])
        _, _, terminated, truncated, _ = stepped
        ends += terminated.sum(), truncated.sum()
        if ours.metadata["autoreset_mode"] == AutoresetMode.DISABLED and (terminated | truncated).any():
            reset(options={"reset_mask": terminated | truncated})
    reset()
    assert_same(ours.step(actions[0]), theirs.step(actions[0]))
    return ends.tolist()


@pytest.mark.full
@pytest.mark.parametrize(
    ("name", "mode"),
    brief(
        [
            *(("lists", mode) for mode in MODES),
            *(("instructed", mode) for mode in MODES),
            ("arrays", "SameStep"),
            *(("dense", mode) for mode in MODES),
            *(("dense gain", mode) for mode in MODES),
            ("strict", "SameStep"),
            ("paid again", "NextStep"),
            ("no noise", "Disabled"),
        ],
        kept=[("lists", "NextStep"), ("dense", "SameStep")],
        full=[
            ("arrays", "SameStep"),
            ("instructed", "Disabled"),
            ("dense gain", "NextStep"),
            ("strict", "SameStep"),
        ],
    ),
)
def test_the_kitchen_is_gymnasiums_vector_of_single_ones(name, mode):
    terminated, truncated = assert_equal_for_ever(
        *pair(KITCHEN_ID, mode, max_episode_steps=14, **KITCHENS[name]), kitchen_actions()
    )
    assert truncated >= 3
    assert (terminated > 0) == (name not in ("paid again", "strict"))


@pytest.mark.full
@pytest.mark.parametrize(
    ("name", "mode"),
    brief(
        [
            *(("all drawn", mode) for mode in MODES),
            ("plain", "NextStep"),
            ("noise", "SameStep"),
            ("varied", "Disabled"),
            ("no draws", "SameStep"),
        ],
        kept=[*(("all drawn", mode) for mode in MODES), ("no draws", "SameStep")],
    ),
)
def test_the_cabinet_is_gymnasiums_vector_of_single_ones(name, mode):
    terminated, truncated = assert_equal_for_ever(
        *pair(OPEN_CABINET_ID, mode, max_episode_steps=10, **CABINETS[name]), cabinet_actions()
    )
    assert truncated >= 3
    assert terminated >= 1


@pytest.mark.full
@pytest.mark.parametrize(
    ("env_id", "settings", "actions", "threads"),
    [
        (KITCHEN_ID, EASY, kitchen_actions(), (1, 3)),
        (OPEN_CABINET_ID, CABINETS["all drawn"], cabinet_actions(), (1, 2, 5, None)),
    ],
    ids=["kitchen", "cabinet"],
)
def test_the_number_of_threads_changes_nothing(env_id, settings, actions, threads):
    alone, *others = (many(env_id, "SameStep", count, max_episode_steps=7, **settings) for count in threads)
    started = alone.reset(seed=3)
    for other in others:
        assert_same(other.reset(seed=3), started)
    for action in actions[:20]:
        stepped = alone.step(action)
        for other in others:
            assert_same(other.step(action), stepped)


@pytest.mark.full
def test_actions_of_any_real_type_mean_what_they_mean_to_single_ones():
    # As float32 0.1 is another number than as float64: neither is rounded.
    ours, theirs = pair(KITCHEN_ID, "NextStep", feedback="target")
    assert_same(ours.reset(seed=0), theirs.reset(seed=0))
    for action in (np.full((3, 9), 0.1), np.full((3, 9), 0.1, np.float32), np.ones((3, 9), int), [[0.1] * 9] * 3):
        assert_same(ours.step(action), theirs.step(action))


@pytest.mark.full
def test_next_step_starts_the_next_episode_in_the_step_after_an_end_whatever_the_action():
    ours, twin = (FrankaKitchenVectorEnv(2, max_episode_steps=2, num_threads=1) for _ in range(2))
    for env in (ours, twin):
        env.reset(seed=0)
        env.step(np.zeros((2, 9)))
        assert env.step(np.zeros((2, 9)))[3].tolist() == [True, True]
    observation, reward, terminated, truncated, info = ours.step(np.zeros((2, 9)))
    assert (reward.tolist(), terminated.tolist(), truncated.tolist()) == ([0.0] * 2, [False] * 2, [False] * 2)
    assert info["episode_step"].tolist() == [0, 0]
    assert_same((observation, reward, terminated, truncated, info), twin.step(np.ones((2, 9))))
    assert ours.step(np.zeros((2, 9)))[4]["episode_step"].tolist() == [1, 1]


def test_same_step_returns_the_last_observation_of_one_episode_and_the_first_of_the_next():
    ours = FrankaOpenCabinetVectorEnv(3, max_episode_steps=4, autoreset_mode="SameStep")
    never_reset = FrankaOpenCabinetVectorEnv(3)
    for env in (ours, never_reset):
        env.reset(seed=0)
        env.step(np.zeros((3, 8)))
        env.reset(options={"reset_mask": np.array([False, True, False])})
        env.step(np.zeros((3, 8)))
        env.step(np.zeros((3, 8)))
    last, _, _, _, last_info = never_reset.step(np.zeros((3, 8)))
    first, _, terminated, truncated, info = ours.step(np.zeros((3, 8)))
    assert (terminated.tolist(), truncated.tolist()) == ([False] * 3, [True, False, True])
    assert info["_final_obs"].tolist() == info["_final_info"].tolist() == [True, False, True]
    assert info["final_obs"][1] is None
    for i in (0, 2):
        np.testing.assert_array_equal(info["final_obs"][i], last[i])
        assert info["final_obs"][i] in ours.single_observation_space
        assert info["final_info"]["reward/approach"][i] == last_info["reward/approach"][i]
        assert not np.array_equal(first[i], last[i])
    np.testing.assert_array_equal(first[1], last[1])
    assert info["episode_step"].tolist() == [0, 3, 0]
    assert info["final_info"]["episode_step"].tolist() == [4, 0, 4]
    assert info["final_info"]["_episode_step"].tolist() == [True, False, True]
    *_, info = ours.step(np.zeros((3, 8)))
    assert info["_final_obs"].tolist() == [False, True, False]


def test_disabled_starts_what_the_mask_chooses_and_nothing_else():
    env = FrankaOpenCabinetVectorEnv(3, max_episode_steps=2, autoreset_mode=AutoresetMode.DISABLED)
    env.reset(seed=0)
    env.step(np.zeros((3, 8)))
    last, _, _, truncated, _ = env.step(np.zeros((3, 8)))
    assert truncated.tolist() == [True, True, True]
    options = {"reset_mask": np.array([True, False, True])}
    started, info = env.reset(options=options)
    assert [*options] == ["reset_mask"]
    np.testing.assert_array_equal(started[1], last[1])
    assert not np.array_equal(started[0], last[0])
    assert info["episode_step"].tolist() == [0, 0, 0]
    assert info["_episode_step"].tolist() == [True, False, True]
    with refused(gymnasium.error.ResetNeeded, "environments [1]"):
        env.step(np.zeros((3, 8)))
    env.reset(options={"reset_mask": np.array([False, True, False])})
    assert env.step(np.zeros((3, 8)))[4]["episode_step"].tolist() == [1, 1, 1]


def test_an_ended_episode_that_is_reset_by_hand_is_not_reset_again():
    env = FrankaKitchenVectorEnv(2, max_episode_steps=1, num_threads=1)
    env.reset(seed=0)
    assert env.step(np.zeros((2, 9)))[3].all()
    env.reset(options={"reset_mask": np.array([True, False])})
    *_, truncated, info = env.step(np.zeros((2, 9)))
    assert (truncated.tolist(), info["episode_step"].tolist()) == ([True, False], [1, 0])


@pytest.mark.full
@pytest.mark.parametrize("mode", brief(MODES, kept=["NextStep"]))
def test_an_episode_may_terminate_and_be_truncated_in_the_same_step(mode):
    env = FrankaKitchenVectorEnv(
        2,
        tasks_to_complete=["microwave"],
        goals={"microwave": [0.1]},
        max_episode_steps=1,
        autoreset_mode=mode,
        num_threads=1,
    )
    env.reset(seed=0)
    _, reward, terminated, truncated, _ = env.step(np.zeros((2, 9)))
    assert (reward.tolist(), terminated.tolist(), truncated.tolist()) == ([1.0] * 2, [True] * 2, [True] * 2)


def test_control_steps_are_counted_over_all_episodes_of_a_run():
    env = FrankaOpenCabinetVectorEnv(2, max_episode_steps=3, autoreset_mode="NextStep")
    env.reset(seed=0)
    for _ in range(3):
        env.step(np.zeros((2, 8)))
    # A step that starts an episode is no control step.
    env.step(np.zeros((2, 8)))
    env.reset(options={"reset_mask": np.array([True, False])})
    env.step(np.zeros((2, 8)))
    assert env.total_steps.tolist() == [4, 4]
    env.total_steps[:] = 0
    assert env.total_steps.tolist() == [4, 4]
    env.reset_statistics(np.array([False, True]))
    assert env.total_steps.tolist() == [4, 0]
    env.reset_statistics()
    assert env.total_steps.tolist() == [0, 0]


@pytest.mark.full
def test_a_step_of_some_environments_is_that_of_all(vector_pair):
    some, every = vector_pair
    actions = kitchen_actions()
    mask = np.array([True, False, True])
    for step in range(3):
        observations, rewards, terminated, truncated, infos = some.step_some(actions[step], mask)
        expected = every.step(actions[step])
        for i in np.flatnonzero(mask):
            assert_same(observations["observation"][i], expected[0]["observation"][i])
            assert (rewards[i], infos["episode_step"][i]) == (expected[1][i], step + 1)
    # The other one has made no step, and makes none before a reset.
    assert infos["episode_step"][1] == 0
    assert (rewards[1], terminated[1], truncated[1]) == (0.0, False, False)
    for stepped in (np.full(COUNT, True), ~mask):
        with refused(gymnasium.error.ResetNeeded, "environments [1]"):
            some.step_some(actions[3], stepped)
    with refused(gymnasium.error.ResetNeeded, "environments [1]"):
        some.step(actions[3])
    for env in (some, every):
        env.reset(seed=7, options={"reset_mask": ~mask})
    assert_same(some.step(actions[3]), every.step(actions[3]))


def test_environments_whose_episodes_have_ended_wait_while_others_step():
    env, first = many(KITCHEN_ID, "Disabled", max_episode_steps=2), np.array([True, False, False])
    env.reset(seed=1)
    for _ in range(2):
        *_, truncated, _ = env.step(np.zeros((COUNT, 9)))
    assert truncated.all()
    env.reset(options={"reset_mask": first})
    *_, truncated, infos = env.step_some(np.zeros((COUNT, 9)), first)
    assert (truncated.tolist(), infos["episode_step"].tolist()) == ([False] * COUNT, [1, 2, 2])


def test_actions_of_environments_that_wait_need_no_meaning():
    env, first = many(KITCHEN_ID, "Disabled", control_mode="ee_pose"), np.array([True, False, False])
    env.reset(seed=1)
    poses = np.zeros((COUNT, *env.single_action_space.shape))
    # Without the quaternion of an orientation, which `step` refuses.
    with pytest.raises(ValueError, match="quaternion"):
        env.step(poses)
    poses[0, 3] = 1.0
    assert env.step_some(poses, first)[-1]["episode_step"].tolist() == [1, 0, 0]


@pytest.mark.full
@pytest.mark.parametrize(
    ("mask", "error", "shown"),
    [
        ([True] * COUNT, TypeError, ["mask"]),
        (np.array([True]), ValueError, ["mask"]),
        (np.full(COUNT, False), ValueError, ["mask"]),
    ],
)
def test_a_mask_of_steps_that_is_refused_changes_nothing(vector_pair, mask, error, shown):
    some, every = vector_pair
    with refused(error, *shown):
        some.step_some(kitchen_actions()[0], mask)
    assert_same(some.step(kitchen_actions()[0]), every.step(kitchen_actions()[0]))


def test_only_without_autoreset_some_environments_step():
    env = many(OPEN_CABINET_ID, "NextStep")
    env.reset(seed=0)
    with refused(ValueError, "autoreset_mode", "'Disabled'", "'NextStep'"):
        env.step_some(np.zeros((COUNT, 8)), np.full(COUNT, True))
