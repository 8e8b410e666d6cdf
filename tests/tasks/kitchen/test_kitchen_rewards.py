"""Dense rewards of the kitchen follow a potential that experts climb, and pay for completion rather than waiting."""

import copy

import numpy as np
import pytest
from helpers.errors import refused

from kitchen_suite.experts import KitchenExpert
from kitchen_suite.gymnasium_env import FrankaKitchenEnv
from kitchen_suite.tasks import DEFAULT_TASKS, GOALS, KitchenTask
from kitchen_suite.tasks.rewards import REWARDS

TERMS = ("approach", "progress", "completion")
QUICK = ("kettle", "slide cabinet")
# In this order, attempts at the burners fail, and the hand comes back to them.
WITH_FAILURES = ("light switch", "slide cabinet", "hinge cabinet", "kettle", "microwave", "bottom burner", "top burner")
STEPS = 280
FLAT = {"goal_format": "flat", "info_format": "arrays"}


def make(tasks, reward, **settings):
    return FrankaKitchenEnv(tasks, reward=reward, **FLAT, **settings)


def play(env, steps, act, seed=5):
    """Plays an episode; returns its rewards, and its infos from the reset on."""
    observation, info = env.reset(seed=seed)
    rewards, infos = [], [info]
    for _ in range(steps):
        observation, reward, terminated, _, info = env.step(act(observation))
        rewards.append(reward)
        infos.append(info)
        if terminated:
            break
    return np.array(rewards), infos


def expert(env, **options):
    one = KitchenExpert.for_task(env.environment.task, **options)
    one.reset(np.random.default_rng(0))
    return lambda observation: one.act(observation["observation"])


def still(observation):
    return np.zeros(9)


def potentials(env, infos):
    """Potential of each task after each step, `(T, n)`, from positions and completions alone."""
    goals = env.environment.task.mdp.goals
    hand = np.array([info["reward_state/hand_distances"] for info in infos])
    distances = np.array([info["task_distances"] for info in infos])
    approach = np.maximum.accumulate(np.clip(1 - hand / hand[0], 0, 1), axis=0)
    progress = np.clip(1 - distances / distances[0], 0, 1)
    completed = np.array([info["episode_task_completions_mask"] for info in infos])
    assert completed.shape == (len(infos), len(goals.tasks))
    return np.where(completed, 1.0, 0.25 * approach + 0.75 * progress)[1:]


def greatest_fall(potential):
    """Greatest fall of the mean of five steps below an earlier one."""
    means = np.convolve(potential, np.ones(5) / 5, "valid")
    return (np.maximum.accumulate(means) - means).max()


@pytest.mark.full
@pytest.mark.parametrize(
    ("tasks", "seeds"),
    [
        *(((task,), 1) for task in QUICK),
        *(pytest.param((task,), 5, marks=pytest.mark.nightly) for task in GOALS),
        pytest.param(DEFAULT_TASKS, 3, marks=pytest.mark.nightly),
        pytest.param(WITH_FAILURES, 2, marks=pytest.mark.nightly),
    ],
)
def test_the_experts_climb_the_potential_and_finishing_earns_more_than_standing_still(tasks, seeds):
    dense, gain = make(tasks, "dense"), make(tasks, "dense_gain")
    steps, order = 500 if len(tasks) > 1 else STEPS, {"in_order": tasks == WITH_FAILURES}
    for seed in range(40, 40 + seeds):
        rewards, infos = play(dense, steps, expert(dense, **order), seed)
        each = potentials(dense, infos)
        np.testing.assert_allclose(each.sum(axis=1), rewards, atol=1e-12)
        assert infos[-1]["is_success"]
        for potential, step in zip(each.T, infos[-1]["completion_steps"], strict=True):
            assert greatest_fall(potential[:step]) <= 0.1
            assert (potential[step - 1 :] == 1.0).all()
            # Waiting where the potential is greatest, short of completion, earns less.
            assert potential[: step - 1].max() < 0.9
        assert play(dense, len(rewards), still, seed)[0].sum() < 0.1 * rewards.sum()
        gains, infos = play(gain, steps, expert(gain, **order), seed)
        assert gains.sum() == pytest.approx(len(tasks), abs=1e-9)
        assert infos[-1]["is_success"]
        assert play(gain, STEPS, still, seed)[0].sum() < 0.05


@pytest.mark.full
@pytest.mark.parametrize("reward", ["dense", "dense_gain"])
def test_the_terms_sum_to_the_reward_and_are_zero_before_the_first_step(reward):
    env = make(["kettle", "microwave"], reward)
    rewards, infos = play(env, 30, expert(env))
    assert {name for name in infos[0] if name.startswith("reward/")} == {f"reward/{name}" for name in TERMS}
    assert [infos[0][f"reward/{name}"] for name in TERMS] == [0.0] * 3
    for value, info in zip(rewards, infos[1:], strict=True):
        assert sum(info[f"reward/{name}"] for name in TERMS) == value
    assert env.environment.task.reward_terms == {name: infos[-1][f"reward/{name}"] for name in TERMS}
    assert infos[-1]["reward/completion"] == (reward == "dense")


@pytest.mark.full
@pytest.mark.parametrize("remove", [True, False])
def test_a_dense_reward_is_one_from_completion_on(remove):
    env = make(["microwave"], "dense", remove_task_when_completed=remove)
    env.reset(seed=0)
    assert env.step(np.zeros(9))[1] < 0.1
    move_door(env, -0.75)
    assert env.step(np.zeros(9))[1] == 1.0
    move_door(env, 0.0)
    assert [env.step(np.zeros(9))[1:3] for _ in range(3)] == [(1.0, False)] * 3


def move_door(env, angle):
    """Moves the microwave's door."""
    physics = env.environment.physics
    physics.bind(GOALS["microwave"].joints_in(env.environment.task.scene)).qpos = angle
    physics.forward()


def test_no_cycle_pays_more_than_once():
    env = make(["microwave"], "dense_gain")
    env.reset(seed=0)
    total = 0.0
    for turn in range(6):
        move_door(env, (0.0, -0.4)[turn % 2])
        total += env.step(np.zeros(9))[1]
    # 0.4 for the door, and the nearest that its handle came to the hand.
    assert 0.4 < total < 0.5
    move_door(env, -0.75)
    total += (step := env.step(np.zeros(9)))[1]
    assert step[2]
    assert total == pytest.approx(1.0)
    assert env.step(np.zeros(9))[1] == 0.0


def test_an_open_door_that_falls_shut_costs_dense_reward():
    env = make(["microwave"], "dense")
    env.reset(seed=0)
    move_door(env, -0.4)
    ajar = env.step(np.zeros(9))[1]
    move_door(env, 0.0)
    assert env.step(np.zeros(9))[1] < ajar - 0.35


@pytest.mark.full
@pytest.mark.parametrize(("reward", "terminates"), [("sparse", True), ("dense", False), ("dense_gain", True)])
def test_only_the_dense_reward_goes_on_after_completion_unless_told_otherwise(reward, terminates):
    for settings, expected in (({}, terminates), ({"terminate_on_tasks_completed": not terminates}, not terminates)):
        env = make(["microwave"], reward, **settings)
        env.reset(seed=0)
        move_door(env, -0.75)
        assert env.step(np.zeros(9))[2] == expected


@pytest.mark.full
def test_the_default_adds_nothing():
    plain, dense = FrankaKitchenEnv(["kettle"]), FrankaKitchenEnv(["kettle"], reward="dense")
    infos, others = plain.reset(seed=0)[1], dense.reset(seed=0)[1]
    assert not any(name.startswith("reward") for name in infos)
    assert sorted(set(others) - set(infos)) == sorted(
        [
            *(f"reward/{name}" for name in TERMS),
            *(name for name in others if name.startswith("reward_state/")),
        ]
    )
    assert {"shaping", "terms"}.isdisjoint(plain.environment.task.get_state())
    assert plain.environment.task.reward_terms == {"completion": 0.0}


@pytest.mark.full
@pytest.mark.parametrize("reward", ["dense", "dense_gain"])
def test_a_copy_continues_with_the_same_rewards(reward):
    env = make(["kettle", "microwave"], reward)
    act = expert(env)
    observation, _ = env.reset(seed=1)
    actions = []
    for _ in range(12):
        actions.append(act(observation))
        observation = env.step(actions[-1])[0]
    other = copy.deepcopy(env)
    for _ in range(8):
        action = act(observation)
        observation, value, *_, info = env.step(action)
        _, same, *_, again = other.step(action)
        assert value == same != 0.0
        assert all(np.array_equal(info[name], again[name]) for name in info)


@pytest.mark.full
def test_the_reward_is_part_of_the_policys_name():
    names = {reward: make(["kettle"], reward).environment.task.policy_inputs.names[0] for reward in REWARDS}
    assert names == {"sparse": "kettle", "dense": "kettle_dense", "dense_gain": "kettle_dense_gain"}


@pytest.mark.full
def test_a_term_of_ones_own_does_not_replace_one_of_the_reward(monkeypatch):
    monkeypatch.setattr(KitchenTask, "extra_rewards", {"completion": lambda step: np.zeros(())})
    for reward in REWARDS:
        with refused(ValueError, "extra_rewards", "completion"):
            make(["kettle"], reward)


class TestComputeReward:
    """Dense rewards from goals and infos alone."""

    @pytest.mark.parametrize("reward", ["dense", "dense_gain"])
    @pytest.mark.parametrize("remove", [True, False])
    def test_it_is_the_reward_of_every_step_and_of_the_batch(self, reward, remove):
        env = make(["kettle", "slide cabinet"], reward, remove_task_when_completed=remove)
        act, observation = expert(env), env.reset(seed=3)[0]
        steps = []
        for _ in range(90):
            steps.append(env.step(act(observation)))
            observation = steps[-1][0]
            if steps[-1][2]:
                break
        assert steps[-1][4]["is_success"]
        rewards, infos = [step[1] for step in steps], [step[4] for step in steps]
        achieved, desired = (np.stack([step[0][f"{kind}_goal"] for step in steps]) for kind in ("achieved", "desired"))
        assert [env.compute_reward(*each) for each in zip(achieved, desired, infos, strict=True)] == rewards
        np.testing.assert_array_equal(env.compute_reward(achieved, desired, infos), rewards)

    def test_gains_towards_another_goal_sum_to_what_its_potential_has_gained(self):
        env = make(["slide cabinet"], "dense_gain", threshold=0.01)
        env.reset(seed=0)
        steps = []
        for _ in range(20):
            joint = env.environment.physics.bind(GOALS["slide cabinet"].joints_in(env.environment.task.scene))
            joint.qpos = 0.2 * np.random.default_rng(len(steps)).random()
            env.environment.physics.forward()
            steps.append(env.step(np.zeros(9)))
        achieved, infos = np.stack([step[0]["achieved_goal"] for step in steps]), [step[4] for step in steps]
        goal = np.array([0.3])
        approach = 0.25 * infos[-1]["reward_state/best_approach"][0]
        expected = 0.75 * max(1 - abs(achieved[-1] - goal)[0] / 0.3, 0.0) + approach
        total = env.compute_reward(achieved, np.tile(goal, (20, 1)), infos).sum()
        assert total == pytest.approx(expected, abs=1e-3)

    def test_an_info_without_what_the_reward_remembers_is_refused(self):
        env = make(["kettle"], "dense")
        observation, info = env.reset(seed=0)
        goals = observation["achieved_goal"], observation["desired_goal"]
        with refused(ValueError, "'reward_state/initial_achieved'"):
            env.compute_reward(*goals, {})
        with refused(ValueError, "reward_state/hand_distances", "(1,)"):
            env.compute_reward(*goals, {**info, "reward_state/hand_distances": np.zeros(2)})

    def test_an_info_of_a_batch_that_does_not_fit_is_refused_and_shown(self):
        env = make(["kettle"], "dense")
        observation, info = env.reset(seed=0)
        goals = [np.tile(observation[name], (3, 1)) for name in ("achieved_goal", "desired_goal")]

        def rewards(name, value):
            return env.compute_reward(*goals, [info, {**info, f"reward_state/{name}": value}, info])

        with refused(ValueError, "reward_state/initial_achieved must have shape (7,), got shape (6,)"):
            rewards("initial_achieved", np.zeros(6))
        with refused(ValueError, "reward_state/initial_achieved must be finite", "nan"):
            rewards("initial_achieved", np.full(7, np.nan))
        with refused(TypeError, "reward_state/initial_achieved must hold 7 numbers"):
            rewards("initial_achieved", ["x"] * 7)
        # A number counts as a vector of one element.
        expected = rewards("hand_distances", np.array([0.1]))
        assert expected[1] != expected[0]
        np.testing.assert_array_equal(rewards("hand_distances", 0.1), expected)

    def test_a_mask_of_none_is_refused(self):
        env = make(["kettle"], "sparse")
        observation, info = env.reset(seed=0)
        with refused(ValueError, "tasks_to_complete_mask", "(1,)"):
            env.compute_reward(
                observation["achieved_goal"], observation["desired_goal"], {**info, "tasks_to_complete_mask": None}
            )

    def test_infinitely_far_goals_pay_no_progress(self):
        env = make(["microwave"], "dense")
        info = env.reset(seed=0)[1]
        assert env.compute_reward(np.array([1e200]), np.array([-1e200]), info) < 0.01


@pytest.mark.full
@pytest.mark.parametrize(
    ("settings", "error", "shown"),
    [
        ({"reward": "dens"}, ValueError, ["'dense'"]),
        ({"reward": None}, TypeError, ["reward"]),
        ({"reward": "dense", "terminate_on_tasks_completed": 1}, TypeError, ["must be True or False, got 1"]),
    ],
)
def test_bad_input_is_refused(settings, error, shown):
    with refused(error, *shown):
        FrankaKitchenEnv(["kettle"], **settings)
