"""Episodes of the kitchen that ask for one task after the other."""

import copy

import numpy as np
import pytest
from helpers.errors import refused

from kitchen_suite import suite
from kitchen_suite.gymnasium_env import FrankaKitchenEnv
from kitchen_suite.tasks import DEFAULT_TASKS
from kitchen_suite.tasks.orders import next_in_turn

ASKED = ["kettle", "microwave", "top burner"]
ORDER = np.array([-1, 2, -1, -1, -1, 1, 0])


def start(**arguments):
    """Returns an environment at the start of an episode, in which the tasks asked lie within their thresholds.

    The light switch, which is not asked, does so too.
    """
    thresholds = dict.fromkeys([*ASKED, "light switch"], 10.0)
    env = FrankaKitchenEnv(tasks_per_episode=3, tasks_in_turn=True, threshold=thresholds, **arguments)
    return env, *env.reset(seed=0, options={"requested_tasks": ASKED})


def shown(mask):
    return [task for task, is_shown in zip(DEFAULT_TASKS, mask, strict=True) if is_shown]


def step(env):
    return env.step(np.zeros(9, np.float32))


def test_tasks_are_shown_and_completed_one_after_the_other():
    env, observation, info = start(instructions=True)
    assert shown(observation["requested_tasks"]) == ["kettle"]
    assert info["instruction"] == "move the kettle to the top left burner"
    assert info["requested_tasks"] == ASKED
    for done, following in ((1, "microwave"), (2, "top burner"), (3, "top burner")):
        observation, reward, terminated, _, info = step(env)
        assert (reward, terminated) == (1.0, done == 3)
        assert info["episode_task_completions"] == ASKED[:done]
        assert {*info["tasks_to_complete"]} == {*ASKED[done:]}
        assert shown(observation["requested_tasks"]) == [following]
        assert {*shown(info["attempted_tasks_mask"])} == {*ASKED[:done]}
        goals = observation["achieved_goal"], observation["desired_goal"]
        assert env.compute_reward(*goals, info) == reward
        assert env.compute_terminated(*goals, info) == terminated


def test_without_removal_completed_tasks_are_rewarded_again():
    env, *_ = start(remove_task_when_completed=False, terminate_on_tasks_completed=False)
    assert [step(env)[1] for _ in range(4)] == [1.0, 2.0, 3.0, 3.0]


@pytest.mark.full
@pytest.mark.parametrize("reward", ["dense", "dense_gain"])
def test_dense_rewards_start_again_where_the_last_task_ended(reward):
    exact = {"reward": reward, "object_noise_ratio": 0.0, "robot_noise_ratio": 0.0}
    names, actions = ["kettle", "microwave"], np.random.default_rng(0).uniform(-1.0, 1.0, (2, 9)).astype(np.float32)
    env = FrankaKitchenEnv(names, tasks_per_episode=2, tasks_in_turn=True, threshold={"kettle": 10.0}, **exact)
    env.reset(options={"requested_tasks": names})
    assert env.step(actions[0])[1] == pytest.approx(1.0)
    alone = FrankaKitchenEnv(["microwave"], **exact)
    alone.reset()
    alone.step(actions[0])
    observation, earned, *_, info = env.step(actions[1])
    # The way to the handle is counted from the hand's place when the task was asked, not from that at the reset.
    place = alone.environment.task.state.shaping.hand_distances[0]
    assert info["reward_state/initial_hand_distances"][1] == place
    assert info["reward_state/best_approach"][1] == 0.0
    goals = observation["achieved_goal"], observation["desired_goal"]
    assert env.compute_reward(*goals, info) == pytest.approx(earned)


@pytest.mark.full
def test_copies_and_states_continue_with_the_same_task():
    env, *_ = start(reward="dense_gain")
    step(env)
    other, *_ = start(reward="dense_gain")
    other.reset(options={"state": env.get_state()})
    for each in (copy.deepcopy(env), other):
        observation, *_, info = step(each)
        assert shown(observation["requested_tasks"]) == ["top burner"]
        assert info["episode_task_completions"] == ASKED[:2]


def test_the_current_task_is_the_first_that_remains_and_the_last_at_the_end():
    completed = np.zeros((4, 7), bool)
    completed[1:, 6] = completed[2:, 5] = completed[3:, 1] = True
    masks = next_in_turn(np.broadcast_to(ORDER, (4, 7)), completed)
    assert [shown(mask) for mask in masks] == [["kettle"], ["microwave"], ["top burner"], ["top burner"]]


def test_the_suite_and_its_policies_tell_such_tasks_apart():
    environment = suite.load("kitchen", "random_4", task_kwargs={"tasks_in_turn": True, "random": 0})
    assert environment.reset().observation["requested_tasks"].sum() == 1.0
    assert environment.task.policy_inputs.names[0] == "seven_in_turn"


@pytest.mark.full
def test_bad_arguments_are_refused():
    with refused(ValueError, "tasks_in_turn", "tasks_per_episode"):
        FrankaKitchenEnv(tasks_in_turn=True)
    with refused(TypeError, "tasks_in_turn", "1"):
        FrankaKitchenEnv(tasks_in_turn=1, tasks_per_episode=2)
