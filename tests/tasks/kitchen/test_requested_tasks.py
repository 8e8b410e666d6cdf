"""Episodes of the kitchen that ask for some of the configured tasks."""

import copy
import pickle

import numpy as np
import pytest
from helpers.errors import refused
from helpers.sweeps import brief_named

from kitchen_suite import suite
from kitchen_suite.gymnasium_env import FrankaKitchenEnv
from kitchen_suite.tasks import DEFAULT_TASKS, orders

NO_NOISE = {"object_noise_ratio": 0.0, "robot_noise_ratio": 0.0}
MIXED = ("close microwave", "bottom burner", "slide cabinet", "return kettle", "light switch", "turn off top burner")


def actions(count, seed=0):
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (count, 9)).astype(np.float32)


@pytest.mark.parametrize(
    "order",
    [
        [0, 1],
        [0, 1, 2, 3],
        [[0, 1, 2]],
        [-1, -1, -1],
        [0, 2, -1],
        [0, 0, 1],
        [-2, 0, 1],
    ],
)
def test_what_is_no_order_of_three_tasks_is_refused(order):
    with refused(ValueError, "requested_order", "3"):
        orders.checked_order(np.array(order), 3, "requested_order")


@pytest.mark.parametrize("order", [[0, 1, 2], [2, 0, 1], [-1, 0, -1], [1, -1, 0]])
def test_an_order_has_the_place_of_each_task_or_none(order):
    np.testing.assert_array_equal(orders.checked_order(np.array(order), 3, "requested_order"), order)


@pytest.mark.parametrize("size", [2, 4])
def test_a_mask_has_an_element_for_each_task(size):
    with refused(ValueError, "requested_tasks", "(3,)"):
        orders.requested_order(np.full(size, True), ["a", "b", "c"])


def test_an_array_of_names_is_no_mask():
    with refused(TypeError, "requested_tasks", "mask of bools"):
        orders.requested_order(np.array(["a", "b", "c"]), ["a", "b", "c"])


def test_the_next_in_turn_is_the_first_that_is_not_completed_and_the_last_one_in_the_end():
    order = np.array([[1, -1, 0], [1, -1, 0], [1, -1, 0], [0, 1, 2]])
    completed = np.array([[False, True, False], [False, False, True], [True, True, True], [True, False, True]])
    with np.errstate(divide="raise", invalid="raise"):
        found = orders.next_in_turn(order, completed)
    np.testing.assert_array_equal(found.argmax(axis=-1), [2, 0, 0, 1])
    np.testing.assert_array_equal(found.sum(axis=-1), 1)
    # With fewer rows than tasks as well.
    found = orders.next_in_turn(np.array([[0, 1, 2]]), np.array([[True, True, False]]))
    np.testing.assert_array_equal(found, [[False, False, True]])


@pytest.mark.full
def test_the_observation_and_the_infos_are_of_the_tasks_asked():
    env = FrankaKitchenEnv(tasks_per_episode=(2, 3), goal_format="flat")
    inputs, seen = env.environment.task.policy_inputs, set()
    for seed in range(10):
        observation, info = env.reset(seed=seed)
        names, mask = info["requested_tasks"], info["requested_tasks_mask"]
        assert env.observation_space.contains(observation)
        assert [task for task in DEFAULT_TASKS if task in names] == info["tasks_to_complete"]
        np.testing.assert_array_equal(observation["requested_tasks"], mask)
        np.testing.assert_array_equal(info["tasks_to_complete_mask"], mask)
        np.testing.assert_array_equal(np.isin(DEFAULT_TASKS, names), mask)
        assert [names.index(task) if task in names else -1 for task in DEFAULT_TASKS] == [*info["requested_order"]]
        np.testing.assert_array_equal(inputs.flatten(observation)[-7:], mask)
        seen.add(len(names))
    assert seen == {2, 3}
    assert inputs.flatten(observation).size == inputs.size == 59 + 2 * 17 + 7


@pytest.mark.full
def test_the_suite_observes_the_tasks_asked_last():
    environment = suite.load("kitchen", "random_4", task_kwargs={"random": 0})
    timestep = environment.reset()
    assert list(timestep.observation)[-1] == "requested_tasks"
    assert timestep.observation["requested_tasks"].sum() == 4.0
    task = environment.task
    assert task.policy_inputs.flatten(timestep.observation).size == task.policy_inputs.size
    task.follow(task.checked_reset({"requested_tasks": ["kettle", "microwave"]}))
    assert environment.reset().observation["requested_tasks"].tolist() == [0, 0, 0, 0, 0, 1, 1]
    assert task.requested_tasks == ["kettle", "microwave"]
    environment.reset()
    assert len(task.requested_tasks) == 4
    with pytest.raises(ValueError, match="fixes"):
        suite.load("kitchen", "random_4", task_kwargs={"tasks_per_episode": 3})


@pytest.mark.full
def test_the_instruction_is_in_the_order_asked():
    env = FrankaKitchenEnv(tasks_per_episode=2, instructions=True)
    _, info = env.reset(options={"requested_tasks": ["microwave", "light switch"]})
    assert info["instruction"] == "open the microwave door, then turn on the light switch"
    assert env.instructions[1] == "open the microwave, then switch on the light"
    env.reset(options={"requested_tasks": ["light switch", "microwave"]})
    assert env.instruction == "turn on the light switch, then open the microwave door"


@pytest.mark.parametrize(
    "obs_type",
    brief_named(
        {name: name for name in ("state", "environment_state_agent_pos", "pixels", "pixels_agent_pos")}, ["state"]
    ),
)
def test_every_observation_type_has_the_tasks_asked(obs_type):
    env = FrankaKitchenEnv(tasks_per_episode=2, obs_type=obs_type)
    observation, info = env.reset(seed=0)
    assert env.observation_space.contains(observation)
    found = observation[-7:] if obs_type == "state" else observation["requested_tasks"]
    np.testing.assert_array_equal(found, info["requested_tasks_mask"])
    state = env.observations.recover_flat(observation)
    assert state is None if "pixels" in obs_type else state.size == 59


# Displacements that props keep only where they are not asked for: near goals, or far from the start of a reverse task.
DISPLACED = {
    "oven/knobs": [-0.3] * 4,
    "hood/switch": -0.2,
    "slide_cabinet/door": 0.2,
    "kettle/pose": [0.01, 0.01, 0.1],
    "tasks/done": [0] * 7,
}
SETTINGS = {
    "sparse": {"threshold": 0.9},
    "dense": {"reward": "dense", "threshold": 0.9},
    "dense_gain": {"reward": "dense_gain", "remove_task_when_completed": False, "threshold": 0.9},
    "strict": {"success": "strict", "reward": "dense_gain"},
    "variations": {"variations": ["start"], "threshold": 0.7},
    "layout": {"variations": ["start", "layout"], "reward": "dense"},
}


@pytest.mark.full
@pytest.mark.parametrize("settings", brief_named(SETTINGS, ["dense_gain"], full=["sparse", "variations"]))
def test_an_episode_is_that_of_an_environment_with_only_the_tasks_asked(settings):
    """To the bit; also where the tasks asked have reverse ones among them, which alone move the start."""
    full = FrankaKitchenEnv(MIXED, tasks_per_episode=3, **NO_NOISE, **settings)
    for seed in range(2):
        _, info = full.reset(seed=seed)
        options = {}
        if "variation_values" in info:
            options["variation_values"] = {**info["variation_values"], **DISPLACED}
        only = [task for task in MIXED if task in info["requested_tasks"]]
        part = FrankaKitchenEnv(only, **NO_NOISE, **settings)
        one, _ = full.reset(seed=seed, options={**options, "requested_tasks": info["requested_tasks"]})
        other, _ = part.reset(seed=seed, options=options)
        np.testing.assert_array_equal(one["observation"], other["observation"])
        for action in actions(20, seed):
            one, *outcome, info = full.step(action)
            other, *expected, expected_info = part.step(action)
            np.testing.assert_array_equal(one["observation"], other["observation"])
            assert outcome == expected
            for key in ("is_success", "tasks_to_complete", "step_task_completions", "episode_task_completions"):
                assert info[key] == expected_info[key]
            done = info["episode_task_completions_mask"]
            assert {task for task, is_done in zip(MIXED, done, strict=True) if is_done} <= set(only)
            goals = one["achieved_goal"], one["desired_goal"]
            assert full.compute_reward(*goals, info) == outcome[0]
            assert full.compute_terminated(*goals, info) == outcome[1]


def test_tasks_that_are_not_asked_are_never_rewarded_nor_needed():
    env = FrankaKitchenEnv(
        ["microwave", "kettle"], tasks_per_episode=1, threshold=10.0, remove_task_when_completed=False
    )
    env.reset(options={"requested_tasks": ["kettle"]})
    observation, reward, terminated, _, info = env.step(np.zeros(9, np.float32))
    assert (reward, terminated, info["is_success"]) == (1.0, True, True)
    assert env.environment.task.progress.within.tolist() == [False, True]
    assert info["episode_task_completions"] == ["kettle"]
    assert info["completion_steps"].tolist() == [-1, 1]
    assert env.environment.task.episode_metrics == {"success": True, "tasks_completed": {"kettle": 1}}
    goals = observation["achieved_goal"], observation["desired_goal"]
    assert env.compute_reward(*goals, {"requested_tasks_mask": np.array([False, True])}) == 1.0
    assert env.compute_reward(*goals, {}) == 2.0
    assert env.compute_terminated(*goals, {"requested_tasks": ["kettle"], "episode_task_completions": ["kettle"]})
    assert not env.compute_terminated(*goals, {"requested_tasks": ["kettle"], "episode_task_completions": []})


def test_tasks_that_are_not_asked_may_be_done_at_the_start():
    env = FrankaKitchenEnv(tasks_per_episode=2, variations={"tasks/done": [1] * 7})
    _, info = env.reset(options={"requested_tasks": ["kettle", "slide cabinet"]})
    near = dict(zip(DEFAULT_TASKS, info["task_distances"] < 0.3, strict=True))
    # The open hinge cabinet would be in the way of the slide cabinet.
    assert [task for task, is_near in near.items() if not is_near] == ["slide cabinet", "hinge cabinet", "kettle"]
    assert info["tasks_to_complete"] == ["slide cabinet", "kettle"]


@pytest.mark.full
def test_copies_and_states_continue_with_the_same_tasks_and_draws():
    env = FrankaKitchenEnv(tasks_per_episode=(1, 4), reward="dense")
    env.reset(seed=1)
    env.environment.task.task_weights = {"kettle": 5.0, "microwave": 0.0}
    env.step(actions(1)[0])
    copies = [
        copy.deepcopy(env),
        pickle.loads(pickle.dumps(env)),
        FrankaKitchenEnv(tasks_per_episode=(1, 4), reward="dense"),
    ]
    copies[-1].reset(seed=5)
    copies[-1].reset(options={"state": env.get_state()})
    outcomes = []
    for each in (env, *copies):
        observation, reward, *_, info = each.step(actions(2)[1])
        drawn = [each.reset()[1]["requested_tasks"] for _ in range(3)]
        outcomes.append((observation["requested_tasks"].tolist(), reward, info["requested_tasks"], drawn))
    assert all(outcome == outcomes[0] for outcome in outcomes)


@pytest.mark.full
def test_bad_states_are_refused():
    env = FrankaKitchenEnv(tasks_per_episode=2)
    env.reset(seed=0)
    for key, value in (
        ("requested_order", np.zeros(7, int)),
        ("requested_order", np.full(7, -1)),
        ("task_weights", np.zeros(7)),
    ):
        state = env.get_state()
        state["task"][key] = value
        with pytest.raises(ValueError, match=key):
            env.set_state(state)
    state = FrankaKitchenEnv().get_state()
    with pytest.raises(ValueError, match="differs in tasks_per_episode"):
        env.set_state(state)


def test_a_request_uses_the_random_numbers_of_the_draw_and_lasts_for_one_reset():
    env = FrankaKitchenEnv(tasks_per_episode=2)
    expected = [env.reset(seed=4), env.reset()]
    found = [env.reset(seed=4, options={"requested_tasks": ["kettle", "microwave", "top burner"]}), env.reset()]
    assert found[0][1]["requested_tasks"] == ["kettle", "microwave", "top burner"]
    np.testing.assert_array_equal(found[0][0]["observation"], expected[0][0]["observation"])
    assert found[1][1]["requested_tasks"] == expected[1][1]["requested_tasks"]
    mask = np.isin(DEFAULT_TASKS, ["kettle", "top burner"])
    assert env.reset(options={"requested_tasks": mask})[1]["requested_tasks"] == ["top burner", "kettle"]


def test_weights_choose_the_tasks_of_later_episodes():
    env = FrankaKitchenEnv(tasks_per_episode=1)
    env.reset(seed=0)
    np.testing.assert_array_equal(env.environment.task.task_weights, np.ones(7))
    env.environment.task.task_weights = np.eye(7)[3]
    assert {env.reset()[1]["requested_tasks"][0] for _ in range(5)} == {"slide cabinet"}


@pytest.mark.full
@pytest.mark.parametrize(
    ("value", "error", "shown"),
    [
        (0, ValueError, ["at least 1"]),
        (8, ValueError, ["7", "tasks_to_complete"]),
        ((3, 2), ValueError, ["pair of the least and greatest number"]),
        ((1, 2, 3), ValueError, ["pair of the least and greatest number"]),
        ((2,), ValueError, ["pair of the least and greatest number"]),
        (2.5, TypeError, ["must be an integer"]),
        ("4", TypeError, ["must be an integer"]),
    ],
)
def test_bad_numbers_of_tasks_are_refused(value, error, shown):
    with refused(error, *shown):
        FrankaKitchenEnv(tasks_per_episode=value)


@pytest.mark.full
def test_bad_requests_and_weights_are_refused():
    env = FrankaKitchenEnv(tasks_per_episode=2)
    env.reset(seed=0)
    for request, error, message in (
        ([], ValueError, "is empty"),
        (["kettl"], ValueError, "did you mean 'kettle'"),
        (["kettle", "kettle"], ValueError, "more than once"),
        ("kettle", TypeError, "must be a sequence of names"),
        (np.zeros(7), TypeError, "mask of bools"),
        (np.zeros(7, bool), ValueError, "at least one task"),
        (np.ones(6, bool), ValueError, r"mask \(7,\)"),
    ):
        with pytest.raises(error, match=message):
            env.reset(options={"requested_tasks": request})
    with refused(ValueError, "variation_values", "requested_tasks"):
        env.reset(options={"state": env.get_state(), "requested_tasks": ["kettle"]})
    for weights, message in (
        ({"kettl": 1.0}, "did you mean"),
        (np.ones(6), r"shape \(7,\)"),
        (-np.ones(7), "non-negative"),
        (np.eye(7)[0], "positive for at least 2 tasks"),
    ):
        with pytest.raises(ValueError, match=message):
            env.environment.task.task_weights = weights


@pytest.mark.full
def test_without_draws_nothing_is_added_and_requests_are_refused():
    env = FrankaKitchenEnv()
    observation, info = env.reset(seed=0)
    assert not any("requested" in key for key in (*observation, *info, *env.get_state()["task"]))
    assert env.environment.task.requested_tasks == list(DEFAULT_TASKS)
    with refused(ValueError, "tasks_per_episode"):
        env.reset(options={"requested_tasks": ["kettle"]})
    with refused(ValueError, "tasks_per_episode"):
        env.environment.task.task_weights = np.ones(7)


@pytest.mark.full
@pytest.mark.parametrize(
    ("arguments", "key"),
    [
        ({"tasks_to_complete": ["kettle", "microwave"]}, "kettle_microwave"),
        ({}, "seven"),
        ({"tasks_per_episode": 1}, "seven_in_turn"),
        ({"tasks_per_episode": 4, "tasks_in_turn": True}, "seven_in_turn"),
        ({"tasks_per_episode": (1, 2)}, "seven_random"),
        ({"tasks_per_episode": 2, "reward": "dense"}, "seven_random_dense"),
    ],
)
def test_policies_are_named_by_tasks_and_by_how_they_are_asked(arguments, key):
    assert FrankaKitchenEnv(**arguments).environment.task.policy_inputs.names[0] == key
