"""The adapter's contract: spaces, formats, infos, states, copies, vectors, pictures."""

import copy
import itertools
import pickle
import subprocess
import sys

import gymnasium
import mujoco
import numpy as np
import pytest
from dm_control.rl import control
from gymnasium.utils.env_checker import check_env
from helpers.comparisons import assert_same
from helpers.errors import refused
from helpers.original import random_actions
from helpers.sweeps import brief

from kitchen_suite import suite
from kitchen_suite.gymnasium_env import KITCHEN_ID, FrankaKitchenEnv

QUALIFIED_ID = f"kitchen_suite.gymnasium_env:{KITCHEN_ID}"
EASY = {"goals": {"microwave": [0.1]}, "tasks_to_complete": ["microwave", "kettle"]}


def actions(steps, seed=0):
    return random_actions(np.random.default_rng(seed), steps)


@pytest.mark.full
@pytest.mark.parametrize(
    ("info_format", "goal_format"),
    brief(itertools.product(("lists", "arrays"), ("dict", "flat")), kept=[("lists", "dict"), ("arrays", "flat")]),
)
@pytest.mark.filterwarnings("ignore:.*Box observation space.*infinity")
def test_gymnasiums_checker_is_content(goal_format, info_format):
    env = gymnasium.make(KITCHEN_ID, goal_format=goal_format, info_format=info_format)
    check_env(env.unwrapped, skip_render_check=True)


@pytest.mark.full
def test_make_works_by_itself_in_a_fresh_process():
    code = f"import gymnasium; env = gymnasium.make({QUALIFIED_ID!r}); env.reset(seed=0); print(env.spec.id)"
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, f"{KITCHEN_ID}\n", "")


@pytest.mark.full
@pytest.mark.parametrize(("settings", "steps"), [({}, 280), ({"max_episode_steps": 12}, 12)])
def test_make_truncates_at_the_limit(settings, steps):
    env = gymnasium.make(KITCHEN_ID, **settings)
    env.reset(seed=0)
    ends = [env.step(env.action_space.sample())[2:4] for _ in range(steps)]
    assert ends == [(False, False)] * (steps - 1) + [(False, True)]


def test_direct_construction_truncates_by_its_own_limit_and_says_so_in_compute_truncated():
    env = FrankaKitchenEnv(max_episode_steps=3)
    env.reset(seed=0)
    for expected in (False, False, True):
        observation, _, _, truncated, info = env.step(np.zeros(9))
        assert truncated == expected
        assert env.compute_truncated(observation["achieved_goal"], observation["desired_goal"], info) == expected


@pytest.mark.full
def test_compute_truncated_takes_batches():
    env = FrankaKitchenEnv(max_episode_steps=3, goal_format="flat")
    env.reset(seed=0)
    steps = [env.step(np.zeros(9)) for _ in range(3)]
    achieved, desired = (np.stack([step[0][kind] for step in steps]) for kind in ("achieved_goal", "desired_goal"))
    infos = [step[4] for step in steps]
    np.testing.assert_array_equal(env.compute_truncated(achieved, desired, infos), [False, False, True])
    np.testing.assert_array_equal(FrankaKitchenEnv().compute_truncated(achieved, desired, infos), [False] * 3)


def test_terminated_and_truncated_may_both_be_true():
    env = FrankaKitchenEnv(["microwave"], goals={"microwave": [0.1]}, max_episode_steps=1)
    env.reset(seed=0)
    assert env.step(np.zeros(9))[1:4] == (1.0, True, True)


def test_the_flat_goals_are_the_dicts_end_to_end():
    by_task, flat = (FrankaKitchenEnv(["kettle", "microwave"], goal_format=kind) for kind in ("dict", "flat"))
    one, other = by_task.reset(seed=0)[0], flat.reset(seed=0)[0]
    for kind in ("achieved_goal", "desired_goal"):
        np.testing.assert_array_equal(other[kind], np.concatenate([one[kind]["kettle"], one[kind]["microwave"]]))
        assert flat.observation_space[kind].shape == (8,)


@pytest.mark.full
@pytest.mark.parametrize("goal_format", ["dict", "flat"])
def test_the_suites_observation_follows_from_the_adapters(goal_format):
    env = FrankaKitchenEnv(["kettle", "microwave"], goal_format=goal_format)
    generator = np.random.Generator(np.random.PCG64(np.random.SeedSequence(5)))
    options = {"tasks_to_complete": ["kettle", "microwave"], "random": np.random.RandomState(generator.bit_generator)}
    plain = suite.load("kitchen", "all", {"visuals": False, **options})
    observation, timestep = env.reset(seed=5)[0], plain.reset()
    for action in actions(4):
        view = env.present_observation
        assert list(view) == list(timestep.observation)
        for key, value in timestep.observation.items():
            np.testing.assert_array_equal(view[key], value)
        frozen = copy.deepcopy(observation)
        for value in view.values():
            value[:] = np.nan
        assert_same(observation, frozen)
        observation, timestep = env.step(action)[0], plain.step(action)


@pytest.mark.full
def test_infos_are_fresh_at_every_step():
    env = FrankaKitchenEnv(**EASY, terminate_on_tasks_completed=False)
    env.reset(seed=0)
    kept = [env.step(np.zeros(9))[4] for _ in range(3)]
    frozen = copy.deepcopy(kept)
    for value in env.step(np.zeros(9))[4].values():
        if isinstance(value, list):
            value.clear()
        elif isinstance(value, np.ndarray):
            value[:] = 0
    assert_same(kept, frozen)
    assert kept[0]["step_task_completions"] == ["microwave"]
    assert kept[1]["step_task_completions"] == []
    assert env.step(np.zeros(9))[4]["episode_task_completions"] == ["microwave"]


def test_observations_are_fresh_at_every_step():
    env = FrankaKitchenEnv()
    first = env.reset(seed=0)[0]
    frozen = copy.deepcopy(first)
    second = env.step(np.zeros(9))[0]
    for kind in ("achieved_goal", "desired_goal"):
        for goal in second[kind].values():
            goal *= np.nan
    second["observation"] *= np.nan
    assert_same(first, frozen)
    assert np.isfinite(env.step(np.zeros(9))[0]["desired_goal"]["kettle"]).all()


@pytest.mark.parametrize("info_format", ["lists", "arrays"])
def test_reset_and_step_infos_have_the_same_keys_shapes_and_types(info_format):
    env = FrankaKitchenEnv(**EASY, info_format=info_format)
    infos = [env.reset(seed=0)[1], *(env.step(np.zeros(9))[4] for _ in range(3))]
    shapes = [{key: (type(value), np.shape(value)) for key, value in info.items()} for info in infos]
    if info_format == "arrays":
        assert all(shape == shapes[0] for shape in shapes)
        assert not any(isinstance(value, list) for value in infos[0].values())
    assert all(shape.keys() == shapes[0].keys() for shape in shapes)
    assert all(
        info[key].dtype == infos[0][key].dtype for info in infos for key in info if isinstance(info[key], np.ndarray)
    )


def test_masks_and_lists_agree():
    env = FrankaKitchenEnv(**EASY)
    env.reset(seed=0)
    info = env.step(np.zeros(9))[4]
    for name in ("tasks_to_complete", "step_task_completions", "episode_task_completions"):
        named = [task in info[name] for task in EASY["tasks_to_complete"]]
        np.testing.assert_array_equal(info[f"{name}_mask"], named)
    np.testing.assert_array_equal(info["completion_steps"], [1, -1])
    assert not info["is_success"]


@pytest.fixture(scope="module")
def pair():
    """An environment of two tasks, of which only the stateless functions are called."""
    return FrankaKitchenEnv(["microwave", "kettle"])


class TestComputeReward:
    """Reward and termination from goals and infos alone."""

    def steps(self, **arguments):
        env = FrankaKitchenEnv(**{**EASY, "terminate_on_tasks_completed": False, **arguments})
        env.reset(seed=0)
        return env, [env.step(action) for action in actions(20)]

    @pytest.mark.parametrize(
        ("remove", "info_format", "goal_format"),
        brief(
            itertools.product((True, False), ("lists", "arrays"), ("dict", "flat")),
            kept=[(True, "lists", "dict"), (True, "arrays", "flat"), (False, "lists", "flat")],
        ),
    )
    def test_it_is_the_reward_of_every_step_and_of_the_batch(self, goal_format, info_format, remove):
        env, steps = self.steps(goal_format=goal_format, info_format=info_format, remove_task_when_completed=remove)
        rewards = [step[1] for step in steps]
        assert sum(rewards) == (1 if remove else 20)
        achieved, desired = ([step[0][kind] for step in steps] for kind in ("achieved_goal", "desired_goal"))
        infos = [step[4] for step in steps]
        assert [env.compute_reward(*each) for each in zip(achieved, desired, infos, strict=True)] == rewards
        assert isinstance(env.compute_reward(achieved[0], desired[0], infos[0]), float)
        batched = [stack(goals) for goals in (achieved, desired)]
        for batch_of_infos in (infos, np.array(infos)):
            result = env.compute_reward(*batched, batch_of_infos)
            np.testing.assert_array_equal(result, rewards)
            assert result.dtype == np.float64

    def test_it_is_stateless(self):
        env, steps = self.steps()
        first = steps[0]
        env.reset()
        for _ in range(3):
            assert env.compute_reward(first[0]["achieved_goal"], first[0]["desired_goal"], first[4]) == 1.0

    def test_without_information_every_configured_task_may_pay(self):
        env = FrankaKitchenEnv(["microwave", "kettle", "slide cabinet"])
        desired = env.reset(seed=0)[0]["desired_goal"]
        assert env.compute_reward(desired, desired, {}) == 3.0
        batch = {task: np.broadcast_to(goal, (2, 4, goal.size)) for task, goal in desired.items()}
        np.testing.assert_array_equal(env.compute_reward(batch, desired_like(batch), {}), np.full((2, 4), 3.0))
        empty = {task: goal[0] for task, goal in batch.items()}
        np.testing.assert_array_equal(env.compute_reward(empty, empty, np.array([{}] * 4)), np.full(4, 3.0))
        assert env.compute_terminated(desired, desired, {}) is True

    def test_a_batch_may_mix_infos_that_tell_and_that_do_not(self):
        env = FrankaKitchenEnv(["microwave", "kettle"], goal_format="flat")
        goals = np.tile(env.reset(seed=0)[0]["desired_goal"], (3, 1))
        infos = [
            {},
            {"tasks_to_complete": ["kettle"], "step_task_completions": [], "episode_task_completions": ["microwave"]},
            {"tasks_to_complete_mask": [False, False], "episode_task_completions_mask": [True, True]},
        ]
        np.testing.assert_array_equal(env.compute_reward(goals, goals, infos), [2.0, 1.0, 0.0])
        np.testing.assert_array_equal(env.compute_terminated(goals, goals, infos), [True, False, True])

    def test_nothing_terminates_where_completion_does_not(self):
        env = FrankaKitchenEnv(["microwave"], terminate_on_tasks_completed=False)
        goal = env.reset(seed=0)[0]["desired_goal"]
        assert env.compute_terminated(goal, goal, {}) is False
        batch = {"microwave": np.zeros((4, 1))}
        np.testing.assert_array_equal(env.compute_terminated(batch, batch, [{}] * 4), np.zeros(4, bool))

    def test_infos_may_have_as_many_axes_as_the_goals(self):
        env = FrankaKitchenEnv(["microwave", "kettle"], goal_format="flat")
        goals = np.tile(env.reset(seed=0)[0]["desired_goal"], (2, 2, 1))
        infos = np.array([[{}, {"tasks_to_complete": []}], [{"tasks_to_complete": ["kettle"]}, {}]])
        np.testing.assert_array_equal(env.compute_reward(goals, goals, infos), [[2.0, 0.0], [1.0, 2.0]])

    @pytest.mark.parametrize(
        ("achieved", "info", "error", "shown"),
        [
            ({"kettle": np.zeros(7)}, {}, ValueError, ["achieved_goal", "microwave"]),
            (np.zeros(5), {}, ValueError, ["achieved_goal", "8"]),
            ({"microwave": np.zeros(1), "kettle": ["far"] * 7}, {}, TypeError, ["kettle"]),
            ({"microwave": np.zeros((2, 1)), "kettle": np.zeros((3, 7))}, {}, ValueError, ["leading shapes"]),
            (np.zeros((3, 8)), [{}] * 2, ValueError, ["info"]),
            (np.zeros(8), None, TypeError, ["info"]),
            (np.zeros((3, 8)), [None] * 3, TypeError, ["info"]),
            (np.zeros(8), {"tasks_to_complete_mask": np.ones((3, 2))}, ValueError, ["tasks_to_complete_mask", "(2,)"]),
            ([[1.0], [2.0, 3.0]], {}, ValueError, ["achieved_goal"]),
        ],
    )
    def test_bad_goals_and_infos_are_refused(self, pair, achieved, info, error, shown):
        with refused(error, *shown):
            pair.compute_reward(achieved, np.zeros(8), info)


def stack(goals):
    if isinstance(goals[0], dict):
        return {task: np.stack([goal[task] for goal in goals]) for task in goals[0]}
    return np.stack(goals)


def desired_like(batch):
    return {task: goal.copy() for task, goal in batch.items()}


def pickled(env):
    return pickle.loads(pickle.dumps(env))


@pytest.mark.full
@pytest.mark.parametrize(
    ("duplicate", "arguments"),
    brief(
        itertools.product((copy.deepcopy, pickled), ({}, {"feedback": "target"}, {**EASY, "goal_format": "flat"})),
        kept=[(copy.deepcopy, {"feedback": "target"}), (pickled, {**EASY, "goal_format": "flat"})],
    ),
)
def test_a_copy_goes_on_where_the_original_stands(duplicate, arguments):
    env = gymnasium.make(KITCHEN_ID, **arguments)
    env.reset(seed=2**40)
    for action in actions(15):
        env.step(action)
    twin = duplicate(env)
    assert twin.spec == env.spec
    assert twin.unwrapped.np_random_seed == env.unwrapped.np_random_seed
    for action in actions(20, seed=1):
        assert_same(env.step(action), twin.step(action))
    assert_same(env.reset(), twin.reset())


def test_a_copy_made_before_the_first_reset_starts_as_the_original():
    env = FrankaKitchenEnv()
    twin = copy.deepcopy(env)
    assert_same(env.reset(), twin.reset())


GENERATORS = [np.random.MT19937, np.random.Philox, np.random.SFC64]


@pytest.mark.parametrize("bit_generator", brief(GENERATORS, kept=[np.random.SFC64]))
def test_a_copy_draws_from_whatever_generator_the_original_was_given(bit_generator):
    env = FrankaKitchenEnv()
    env.np_random = np.random.Generator(bit_generator(3))
    env.reset()
    assert_same(copy.deepcopy(env).step(np.zeros(9)), env.step(np.zeros(9)))


@pytest.mark.full
def test_a_copy_is_built_from_the_arguments_as_they_were():
    tasks, goals = ["kettle"], {"kettle": np.arange(7.0)}
    env = FrankaKitchenEnv(tasks, goals=goals)
    env.reset(seed=0)
    tasks.append("microwave")
    goals["kettle"][:] = 5.0
    assert_same(copy.deepcopy(env).step(np.zeros(9)), env.step(np.zeros(9)))


def test_a_state_of_no_episode_starts_none():
    state = FrankaKitchenEnv().get_state()
    env = FrankaKitchenEnv()
    with pytest.raises(ValueError, match="of no episode"):
        env.reset(options={"state": state})


@pytest.mark.parametrize(("config", "error"), [({"distanc": 1.0}, ValueError), (3, TypeError)])
def test_a_camera_is_checked_when_it_is_given(config, error):
    with pytest.raises(error, match="camera"):
        FrankaKitchenEnv(default_camera_config=config)


@pytest.mark.parametrize("options", [{99: True}, {"fog": True}, {0: "yes"}, 3])
def test_unknown_visual_options_are_refused(options):
    with pytest.raises((ValueError, TypeError), match="visual"):
        FrankaKitchenEnv(visual_options=options)


def test_a_copy_is_independent():
    env = FrankaKitchenEnv()
    env.reset(seed=0)
    state = env.get_state()
    twin = copy.deepcopy(env)
    for action in actions(5):
        twin.step(action)
    assert_same(env.get_state(), state)


def test_a_state_brings_everything_back():
    env = FrankaKitchenEnv(**EASY)
    env.reset(seed=1)
    before = [env.step(action) for action in actions(10)][-1]
    state = env.get_state()
    expected = [env.step(action) for action in actions(10, seed=1)]
    observation = env.set_state(state)
    assert_same(observation, before[0])
    assert_same([env.step(action) for action in actions(10, seed=1)], expected)
    other = FrankaKitchenEnv(**EASY)
    assert_same(other.reset(options={"state": pickle.loads(pickle.dumps(state))}), (before[0], before[4]))
    assert_same([other.step(action) for action in actions(10, seed=1)], expected)


@pytest.mark.full
def test_a_moment_of_a_headless_run_can_be_set_where_it_can_be_rendered_and_back():
    headless, visual = FrankaKitchenEnv(**EASY), FrankaKitchenEnv(**EASY, visuals=True)
    assert visual.environment.physics.model.nbody > headless.environment.physics.model.nbody
    headless.reset(seed=1)
    for action in actions(10):
        headless.step(action)
    for source, target in ((headless, visual), (visual, headless)):
        source.environment.physics.data.qfrc_applied[:9] = 0.1
        state = source.get_state()
        observation, _ = target.reset(options={"state": pickle.loads(pickle.dumps(state))})
        assert observation in target.observation_space
        assert_same(target.get_state(), state)
        for name in ("time", "qpos", "qvel", "act", "ctrl", "qacc_warmstart", "qfrc_applied", "eq_active"):
            assert_same(*(np.array(getattr(env.environment.physics.data, name)) for env in (source, target)))
        for action in actions(5, seed=2):
            assert_same(source.step(action), target.step(action))
        assert_same(source.get_state(), target.get_state())


@pytest.mark.full
def test_a_state_serves_a_planner_after_the_end_of_an_episode():
    env = FrankaKitchenEnv(["microwave"], goals={"microwave": [0.1]})
    env.reset(seed=1)
    state = env.get_state()
    assert env.step(np.zeros(9))[2]
    env.set_state(state)
    assert env.step(np.zeros(9))[1:3] == (1.0, True)


@pytest.mark.full
def test_a_seed_beside_a_state_replaces_only_the_random_state():
    env = FrankaKitchenEnv()
    env.reset(seed=1)
    env.step(np.ones(9))
    state, seen = env.get_state(), env.get_state()["physics"].copy()
    observation, _ = env.reset(seed=9, options={"state": state})
    np.testing.assert_array_equal(env.get_state()["physics"], seen)
    again, _ = env.reset(options={"state": state})
    assert_same(observation, again)
    draws = []
    for seed in (9, 9, 10):
        env.reset(seed=seed, options={"state": state})
        draws.append(env.step(np.zeros(9))[0]["observation"])
    np.testing.assert_array_equal(draws[0], draws[1])
    assert not np.array_equal(draws[0], draws[2])


def test_a_step_after_termination_goes_on_in_the_same_episode():
    env = FrankaKitchenEnv(["microwave"], goals={"microwave": [0.1]})
    env.reset(seed=0)
    env.step(np.ones(9))
    _, reward, terminated, _, info = env.step(np.ones(9))
    assert (reward, terminated) == (0.0, True)
    assert info["episode_step"] == 2


@pytest.mark.full
def test_a_step_after_a_divergence_starts_a_clean_episode():
    env = FrankaKitchenEnv()
    env.reset(seed=0)
    env.environment.physics.data.qvel[0] = np.nan
    with pytest.raises(control.PhysicsError):
        env.step(np.zeros(9))
    observation, reward, terminated, _, info = env.step(np.zeros(9))
    assert (reward, terminated, info["episode_step"]) == (0.0, False, 0)
    assert np.isfinite(observation["observation"]).all()
    assert env.step(np.zeros(9))[4]["episode_step"] == 1


def test_a_new_generator_given_to_the_environment_is_used():
    env = FrankaKitchenEnv()
    env.reset(seed=0)
    env.np_random = np.random.default_rng(7)
    expected = np.random.default_rng(7).uniform(-1, 1, 59)
    env.reset()
    noise = env.get_state()["task"]["noise"]
    np.testing.assert_allclose(np.sign(noise), np.sign(expected))


@pytest.mark.full
@pytest.mark.parametrize("mode", ["sync", "async"])
def test_sub_environment_i_of_a_vector_is_the_single_one_of_seed_plus_i(mode):
    vector = gymnasium.make_vec(QUALIFIED_ID, num_envs=2, vectorization_mode=mode)
    singles = [gymnasium.make(KITCHEN_ID) for _ in range(2)]
    try:
        seen = [vector.reset(seed=11)[0]]
        seen += [vector.step(np.stack([action, -action]))[0] for action in actions(3)]
        for i, (single, sign) in enumerate(zip(singles, (1, -1), strict=True)):
            alone = [single.reset(seed=11 + i)[0]]
            alone += [single.step(sign * action)[0] for action in actions(3)]
            for one, other in zip(seen, alone, strict=True):
                np.testing.assert_array_equal(one["observation"][i], other["observation"])
                np.testing.assert_array_equal(one["achieved_goal"]["kettle"][i], other["achieved_goal"]["kettle"])
    finally:
        vector.close()


@pytest.mark.rendering
class TestRendering:
    """Pictures through Gymnasium's own renderer."""

    @pytest.mark.parametrize(
        "camera",
        brief(
            [{}, {"camera_name": "left"}, {"camera_id": 1}, {"camera_name": "franka/wrist"}], kept=[{"camera_id": 1}]
        ),
    )
    def test_rgb_has_the_size_asked_for_and_shows_something(self, camera):
        env = FrankaKitchenEnv(render_mode="rgb_array", width=160, height=120, **camera)
        env.reset(seed=0)
        picture = env.render()
        assert (picture.shape, picture.dtype) == ((120, 160, 3), np.uint8)
        assert picture.std() > 20
        env.close()

    @pytest.mark.nightly
    def test_visual_options_and_room_for_geoms_reach_the_renderer(self):
        def picture(**settings):
            env = FrankaKitchenEnv(render_mode="rgb_array", width=64, height=48, **settings)
            env.reset(seed=0)
            rendered = env.render()
            env.close()
            return rendered

        transparent = {mujoco.mjtVisFlag.mjVIS_TRANSPARENT.value: True}
        assert not np.array_equal(picture(), picture(visual_options=transparent))
        assert not np.array_equal(picture(), picture(max_geom=20))

    def test_depth_is_the_z_buffer_as_in_the_original(self):
        env = FrankaKitchenEnv(render_mode="depth_array", width=160, height=120)
        env.reset(seed=0)
        depth = env.render()
        assert depth.shape == (120, 160)
        assert 0.0 <= depth.min() < depth.max() <= 1.0
        env.close()

    @pytest.mark.full
    def test_make_collects_pictures_in_list_mode(self):
        env = gymnasium.make(KITCHEN_ID, render_mode="rgb_array_list", width=64, height=48)
        env.reset(seed=0)
        env.step(np.zeros(9))
        assert [picture.shape for picture in env.render()] == [(48, 64, 3)] * 2
        env.close()

    @pytest.mark.full
    def test_pictures_larger_than_the_models_buffer_are_possible(self):
        env = FrankaKitchenEnv(render_mode="rgb_array", width=1930, height=32)
        env.reset(seed=0)
        assert env.render().shape == (32, 1930, 3)
        env.close()

    @pytest.mark.full
    def test_a_copy_renders_too(self):
        env = FrankaKitchenEnv(render_mode="rgb_array", width=64, height=48)
        env.reset(seed=0)
        np.testing.assert_array_equal(copy.deepcopy(env).render(), env.render())
        env.close()


def test_the_frame_rate_is_that_of_the_control_steps():
    assert FrankaKitchenEnv.metadata["render_fps"] == 12.5


def test_without_a_render_mode_rendering_warns_and_returns_none():
    env = FrankaKitchenEnv()
    with pytest.warns(UserWarning, match="render_mode"):
        assert env.render() is None
