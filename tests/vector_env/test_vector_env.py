"""Vectorised environments through Gymnasium: seeds, limits, spaces, wrappers, fresh results, rewards from goals."""

import copy
import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.wrappers.vector import DictInfoToList, FlattenObservation, NormalizeReward, RecordEpisodeStatistics
from helpers.comparisons import assert_same
from helpers.open_cabinet import VARIED
from helpers.sweeps import brief
from helpers.vectors import part

from kitchen_suite.gymnasium_env import KITCHEN_ID, OPEN_CABINET_ID
from kitchen_suite.vector_env import FrankaKitchenVectorEnv, FrankaOpenCabinetVectorEnv

CLASSES = {KITCHEN_ID: FrankaKitchenVectorEnv, OPEN_CABINET_ID: FrankaOpenCabinetVectorEnv}
# Resets and steps that draw all there is to draw.
DRAWN = {KITCHEN_ID: {}, OPEN_CABINET_ID: {"variations": VARIED, "observation_noise": {"handle_offset": 0.01}}}
EASY = {"tasks_to_complete": ["microwave", "kettle"], "goals": {"microwave": [0.1]}}

both = pytest.mark.parametrize("env_id", CLASSES)


def many(env_id, count=2, **settings):
    return gymnasium.make_vec(env_id, count, vectorization_mode="vector_entry_point", num_threads=1, **settings)


def gymnasiums_own(env_id, count=2, mode="NextStep", **settings):
    return gymnasium.make_vec(
        env_id, count, vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode}, **settings
    )


def actions_for(env, steps, seed=0):
    scale = 1.0 if env.single_action_space.shape == (9,) else 0.02
    return np.random.default_rng(seed).normal(scale=scale, size=(steps, *env.action_space.shape))


def assert_is_part(many_results, i, single_results):
    observation, *numbers, info = many_results
    single_observation, *single_numbers, single_info = single_results
    assert_same(part(observation, i), single_observation)
    assert [array[i] for array in numbers] == single_numbers
    assert_info_is_part(info, i, single_info)


def assert_info_is_part(info, i, single_info):
    assert {key for key in info if not key.startswith("_")} == single_info.keys()
    for key, value in single_info.items():
        assert info[f"_{key}"][i]
        if isinstance(value, dict):
            assert_info_is_part(info[key], i, value)
        else:
            assert np.array_equal(info[key][i], value), key


def assert_are_parts(env, singles, actions):
    for action in actions:
        stepped = env.step(action)
        for i, single in enumerate(singles):
            assert_is_part(stepped, i, single.step(action[i]))


@pytest.mark.full
@both
def test_environment_i_of_seed_s_is_the_single_one_of_seed_s_plus_i(env_id):
    seed = 2**70 + 1
    env = many(env_id, 3, **DRAWN[env_id])
    singles = [gymnasium.make(env_id, **DRAWN[env_id]) for _ in range(3)]
    started = env.reset(seed=seed)
    for i, single in enumerate(singles):
        assert_is_part(started, i, single.reset(seed=seed + i))
    assert env.np_random_seed == (seed, seed + 1, seed + 2)
    assert_are_parts(env, singles, actions_for(env, 6))
    # The streams continue without a seed, and where a list of seeds holds None.
    for seeds in ([None] * 3, [None, 4, None]):
        started = env.reset(seed=None if seeds == [None] * 3 else seeds)
        for i, single in enumerate(singles):
            assert_is_part(started, i, single.reset(seed=seeds[i]))
        assert_are_parts(env, singles, actions_for(env, 3, seed=1))
    assert env.np_random_seed == (seed, 4, seed + 2)
    # Draws by hand come from the environment's own stream.
    assert [random.random() for random in env.np_random] == [single.unwrapped.np_random.random() for single in singles]
    assert_are_parts(env, singles, actions_for(env, 2, seed=2))


@pytest.mark.full
@both
def test_the_same_seed_gives_the_same_episodes_and_none_gives_others(env_id):
    env = many(env_id, **DRAWN[env_id])
    actions = actions_for(env, 4)

    def played(seed):
        return [env.reset(seed=seed), *(env.step(action) for action in actions)]

    first = played(5)
    assert not data_equivalence(played(None), first)
    assert_same(played(5), first)
    assert_same(played([5, 6]), first)
    assert_same(played((5, np.int64(6))), first)
    assert_same(played(np.array([5, 6])), first)


@pytest.mark.full
@both
def test_without_seeds_no_two_environments_are_alike(env_id):
    one, other = many(env_id), many(env_id)
    seeds = [*one.np_random_seed, *other.np_random_seed]
    assert len(set(seeds)) == 4
    assert all(isinstance(seed, int) for seed in seeds)
    started = [env.reset()[0] for env in (one, other)]
    numbers = [array["observation"] if env_id == KITCHEN_ID else array for array in started]
    assert len(np.unique(np.concatenate(numbers), axis=0)) == 4
    # Resets without a seed keep the seeds.
    assert [*one.np_random_seed, *other.np_random_seed] == seeds


@pytest.mark.full
def test_a_seed_beside_a_mask_reaches_only_what_is_reset():
    env, twin = (many(KITCHEN_ID, 3) for _ in range(2))
    env.reset(seed=0)
    twin.reset(seed=0)
    mask = np.array([False, True, False])
    env.reset(seed=9, options={"reset_mask": mask})
    twin.reset(seed=[None, 10, None], options={"reset_mask": mask})
    assert env.np_random_seed == (0, 10, 2)
    for action in actions_for(env, 2):
        assert_same(env.step(action), twin.step(action))


@pytest.mark.full
@both
def test_make_vec_builds_one_by_default_with_the_spaces_and_metadata_of_gymnasiums_vector(env_id):
    env = gymnasium.make_vec(env_id, num_envs=2)
    assert isinstance(env, CLASSES[env_id])
    sync = gymnasiums_own(env_id)
    for name in ("num_envs", "observation_space", "action_space", "single_observation_space", "single_action_space"):
        assert getattr(env, name) == getattr(sync, name), name
    assert env.metadata == sync.metadata
    assert (env.render_mode, env.closed) == (sync.render_mode, sync.closed)
    assert repr(env) == f"{CLASSES[env_id].__name__}({env_id}, {env.composer_task!r}, num_envs=2)"


@pytest.mark.full
def test_make_vec_works_by_itself_in_a_fresh_process_and_again_from_its_spec():
    code = (
        "import gymnasium\n"
        f"env = gymnasium.make_vec('kitchen_suite.gymnasium_env:{OPEN_CABINET_ID}', num_envs=3, drawer='bottom')\n"
        "again = gymnasium.make_vec(env.spec)\n"
        "print(again, (env.reset(seed=0)[0] == again.reset(seed=0)[0]).all())\n"
    )
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    task = "OpenCabinetTask(drawer='bottom', reward='original')"
    assert done.stdout == f"FrankaOpenCabinetVectorEnv({OPEN_CABINET_ID}, {task}, num_envs=3) True\n"


@pytest.mark.full
@pytest.mark.parametrize(
    ("env_id", "settings", "steps"),
    [(KITCHEN_ID, {}, 280), (OPEN_CABINET_ID, {}, 700), (OPEN_CABINET_ID, {"max_episode_steps": 7}, 7)],
)
def test_make_vec_truncates_at_the_limit(env_id, settings, steps):
    env = many(env_id, 1, **settings)
    env.reset(seed=0)
    ends = [env.step(np.zeros(env.action_space.shape))[2:4] for _ in range(steps)]
    assert not np.any(ends[:-1])
    assert np.array_equal(ends[-1], [[False], [True]])


@pytest.mark.full
@pytest.mark.parametrize("settings", brief([{}, {"max_episode_steps": None}], kept=[{}]))
def test_direct_construction_truncates_only_where_it_is_told_to(settings):
    env = FrankaOpenCabinetVectorEnv(**settings)
    env.reset(seed=0)
    assert not any(env.step(np.zeros((1, 8)))[3].any() for _ in range(720))
    env = FrankaOpenCabinetVectorEnv(max_episode_steps=2)
    env.reset(seed=0)
    assert [bool(env.step(np.zeros((1, 8)))[3]) for _ in range(4)] == [False, True, False, False]


@pytest.mark.full
def test_minus_one_lifts_the_limit_as_it_does_for_make():
    for env in (gymnasiums_own(OPEN_CABINET_ID, max_episode_steps=-1), many(OPEN_CABINET_ID, max_episode_steps=-1)):
        env.reset(seed=0)
        assert not any(env.step(np.zeros((2, 8)))[3].any() for _ in range(710))


@pytest.mark.full
@pytest.mark.parametrize(
    ("env_id", "wrapper", "mode"),
    [
        pytest.param(OPEN_CABINET_ID, RecordEpisodeStatistics, "NextStep", marks=pytest.mark.nightly),
        (OPEN_CABINET_ID, RecordEpisodeStatistics, "SameStep"),
        (OPEN_CABINET_ID, NormalizeReward, "SameStep"),
        (OPEN_CABINET_ID, DictInfoToList, "NextStep"),
        pytest.param(KITCHEN_ID, DictInfoToList, "SameStep", marks=pytest.mark.nightly),
        (KITCHEN_ID, FlattenObservation, "NextStep"),
    ],
)
def test_gymnasiums_wrappers_treat_it_as_its_own(env_id, wrapper, mode):
    ours = wrapper(many(env_id, autoreset_mode=mode, max_episode_steps=3))
    theirs = wrapper(gymnasiums_own(env_id, mode=mode, max_episode_steps=3))
    assert_same(ours.reset(seed=0), theirs.reset(seed=0))
    episodes = 0
    for action in actions_for(ours, 7):
        stepped, expected = ours.step(action), theirs.step(action)
        if wrapper is RecordEpisodeStatistics and "episode" in stepped[4]:
            # How long it took.
            assert stepped[4]["episode"].pop("t").shape == expected[4]["episode"].pop("t").shape
            episodes += len(stepped[4]["episode"]["l"])
        # The lengths of episodes as well, of which Gymnasium 1.2 counts some a step too short in the mode SameStep.
        assert_same(stepped, expected)
    if wrapper is RecordEpisodeStatistics:
        assert episodes == 4


def test_episode_statistics_start_anew_where_a_mask_resets():
    env = RecordEpisodeStatistics(many(OPEN_CABINET_ID, autoreset_mode="Disabled", max_episode_steps=2))
    env.reset(seed=0)
    env.step(np.zeros((2, 8)))
    env.reset(options={"reset_mask": np.array([True, False])})
    *_, info = env.step(np.zeros((2, 8)))
    assert (info["_episode"].tolist(), info["episode"]["l"].tolist()) == ([False, True], [0, 2])


@pytest.mark.full
@pytest.mark.parametrize(
    ("env_id", "mode"),
    brief(
        [(KITCHEN_ID, "SameStep"), (OPEN_CABINET_ID, "SameStep"), (OPEN_CABINET_ID, "NextStep")],
        kept=[(OPEN_CABINET_ID, "SameStep")],
    ),
)
def test_what_was_returned_never_changes_and_writing_to_it_changes_nothing(env_id, mode):
    settings = {**DRAWN[env_id], **(EASY if env_id == KITCHEN_ID else {}), "max_episode_steps": 3}
    env, twin, spoilt = (many(env_id, 3, autoreset_mode=mode, **settings) for _ in range(3))
    kept = [env.reset(seed=0)]
    frozen = copy.deepcopy(kept)
    assert_same(twin.reset(seed=0), kept[-1])
    spoil(spoilt.reset(seed=0))
    for number, action in enumerate(actions_for(env, 8)):
        given = action.copy()
        kept.append(env.step(given))
        # An agent may fill the same array with its next actions.
        given[:] = np.nan
        frozen.append(copy.deepcopy(kept[-1]))
        assert_same(twin.step(action), kept[-1])
        stepped = spoilt.step(action)
        assert_same(stepped, kept[-1])
        spoil(stepped)
        if number == 4:
            mask = np.array([True, False, False])
            kept.append(env.reset(options={"reset_mask": mask}))
            frozen.append(copy.deepcopy(kept[-1]))
            assert_same(twin.reset(options={"reset_mask": mask}), kept[-1])
            spoil(spoilt.reset(options={"reset_mask": mask}))
            assert mask.tolist() == [True, False, False]
    assert_same(kept, frozen)


def spoil(value, *, of_variation=False):
    """Writes over all that there is to write over; arrays of infos on the variation may be read-only."""
    if isinstance(value, dict):
        for key, inner in [*value.items()]:
            spoil(inner, of_variation=of_variation or key.lstrip("_") in ("variation_values", "layout_refusals"))
        value.clear()
    elif isinstance(value, tuple | list):
        for inner in value:
            spoil(inner)
        if not isinstance(value, tuple):
            value.clear()
    elif isinstance(value, np.ndarray) and value.dtype == object:
        for inner in value:
            spoil(inner)
        value[:] = None
    elif isinstance(value, np.ndarray) and (value.flags.writeable or not of_variation):
        value[...] = 1 if value.dtype == bool else 99


def test_compute_reward_takes_the_infos_of_the_environments_one_by_one():
    env = many(KITCHEN_ID, **EASY)
    for goals, info, reward, terminated in easy_steps(env):
        infos = [{key: info[key][i] for key in info if not key.startswith("_")} for i in range(2)]
        np.testing.assert_array_equal(env.compute_reward(*goals, infos), reward)
        np.testing.assert_array_equal(env.compute_terminated(*goals, infos), terminated)
        np.testing.assert_array_equal(env.compute_truncated(*goals, infos), [False, False])


@pytest.mark.parametrize(
    ("goal_format", "info_format"), brief([("dict", "lists"), ("flat", "arrays")], kept=[("flat", "arrays")])
)
def test_compute_reward_takes_the_environments_own_info(goal_format, info_format):
    env = many(KITCHEN_ID, **EASY, goal_format=goal_format, info_format=info_format)
    for goals, info, reward, terminated in easy_steps(env):
        np.testing.assert_array_equal(env.compute_reward(*goals, info), reward)
        np.testing.assert_array_equal(env.compute_terminated(*goals, info), terminated)


def easy_steps(env):
    """Goals, info, rewards and terminations of steps in which the microwave pays in one environment, in none."""
    env.reset(seed=0)
    env.step(np.zeros((2, 9)))
    env.reset(options={"reset_mask": np.array([True, False])})
    for expected in ([1.0, 0.0], [0.0, 0.0]):
        observation, reward, terminated, _, info = env.step(np.zeros((2, 9)))
        assert reward.tolist() == expected
        yield (observation["achieved_goal"], observation["desired_goal"]), info, reward, terminated
