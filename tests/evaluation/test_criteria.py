"""Success as publications define it, against their definitions written anew, on 100,000 random states."""

import numpy as np
import pytest

from kitchen_suite.evaluation import criteria
from kitchen_suite.evaluation.protocols import PROTOCOLS
from kitchen_suite.gymnasium_env.kitchen import FrankaKitchenEnv

COUNT = 100_000


@pytest.fixture(scope="module")
def states():
    """States about as often at as off the goals, some of which are at the start."""
    generator = np.random.default_rng(0)
    starts = np.zeros(30)
    starts[23:30] = (-0.269, 0.35, 1.62, 1, 0, 0, 0)
    goals = np.array([*[-0.88, -0.01] * 4, -0.69, -0.05, 0.37, 0.0, 0.5, -0.5, -0.23, 0.75, 1.62, 1, 0, 0, 0])
    shares = generator.choice([0.0, 0.5, 1.0], (COUNT, 30)) + generator.normal(0, 0.3, (COUNT, 30))
    states = starts + shares * (np.concatenate([np.ones(9), goals]) - starts)
    return np.concatenate([starts[np.newaxis], states])


@pytest.mark.full
def test_a_goal_is_reached_where_all_objects_are(states):
    """Against the sum of squares, state by state: those of the last of the goals count."""
    generator = np.random.default_rng(1)
    rows = states[: COUNT // 10 * 10].reshape(-1, 10, 30)
    for step in range(COUNT // len(rows)):
        goals = rows[:, (step + 1) % 10] + generator.normal(0, generator.choice([0.001, 0.03]), (len(rows), 30))
        for start, state, goal in zip(rows[:, 0], rows[:, (step + 1) % 10], goals, strict=True):
            distance = sum((one - other) ** 2 for one, other in zip(state[9:], goal[9:], strict=True)) ** 0.5
            assert criteria.goal_reached(np.stack([goal, state]), np.stack([start, goal])) == (distance <= 0.1)
        if step == 0:
            assert not criteria.goal_reached(goals[:1], goals[:1]), "the start does not count"


@pytest.mark.parametrize(
    ("task", "first", "size"),
    [
        ("bottom burner", 11, 2),
        ("top burner", 15, 2),
        ("light switch", 17, 2),
        ("slide cabinet", 19, 1),
        ("hinge cabinet", 20, 2),
        ("microwave", 22, 1),
        ("kettle", 23, 7),
    ],
)
def test_a_goal_state_has_the_goal_of_a_task_in_its_columns(task, first, size):
    value = np.linspace(1.0, 2.0, size)
    expected = np.zeros(30)
    expected[:9] = 0.5
    expected[first : first + size] = value
    np.testing.assert_array_equal(criteria.goal_state({task: value}, np.full(9, 0.5)), expected)


def test_goals_are_taken_from_recorded_states():
    states, generator = np.zeros((60, 30)), np.random.default_rng(0)
    states[40:, 22] = -0.2
    assert criteria.last_frames(states, ["kettle", "microwave"], generator) == {
        "requested_tasks": ["kettle", "microwave"],
        "goal_states": states[-2:].tolist(),
    }
    assert criteria.last_frames(states, [], generator) is None
    # Only from 10 to 29 does the microwave open within 30 steps. The robot, which has steps here, does not count.
    states[:, 0] = np.arange(60)
    drawn = [criteria.later_state(states, [], generator) for _ in range(400)]
    assert {options["start_state"][0] for options in drawn} == {*range(10, 30)}
    for options in drawn:
        first = int(options["start_state"][0])
        assert options == {"start_state": states[first].tolist(), "goal_states": [states[first + 30].tolist()]}
    assert criteria.later_state(states[:40], [], generator) is None
    assert criteria.later_state(states[:20], [], generator) is None
    # A distance of 0.1 is no movement.
    states[40:, 22] = 0.1
    assert criteria.later_state(states, [], generator) is None
    states[40:, 22] = np.nextafter(0.1, 1.0)
    assert criteria.later_state(states, [], generator) is not None


def test_a_goal_is_reached_up_to_its_distance():
    # Of the numbers, an object at either end; the robot does not count.
    for column, distance, expected in (
        (9, 0.1, True),
        (9, 0.101, False),
        (29, 0.1, True),
        (29, 0.101, False),
        (8, 9.0, True),
    ):
        start = np.zeros(30)
        goal = np.zeros(30)
        other = np.ones(30)
        goal[column] = distance
        assert criteria.goal_reached(np.stack([other, start]), np.stack([other, other, goal])) is expected
        options = {"start_state": start.tolist(), "goal_states": [other.tolist(), other.tolist(), goal.tolist()]}
        assert criteria.holds_at_start(options) is expected
        assert criteria.holds_at_start({**options, "requested_tasks": ["kettle"]}) is expected
    near = {"start_state": [0.0] * 30, "goal_states": [[0.0] * 30]}
    assert criteria.holds_at_start(near)
    for name in near:
        assert not criteria.holds_at_start({name: near[name]})
    assert not criteria.holds_at_start({})


def test_the_robot_of_gas_is_where_gas_has_it():
    robot = [-2.4308119, -1.444008, 1.0221981, -1.7869282, 0.18872257, 1.6170777, 1.2863032, 0.025421469, 0.0074267522]
    goal = criteria.goal_state({"microwave": [-0.75]}, criteria.GAS_ROBOT)
    np.testing.assert_array_equal(goal, [*robot, *[0.0] * 13, -0.75, *[0.0] * 7])


def test_goals_of_recorded_states_have_fifty_steps():
    assert PROTOCOLS["goal-reaching"].max_episode_steps == 50


def test_states_are_d4rls_positions():
    env = FrankaKitchenEnv(robot_noise_ratio=0.0, object_noise_ratio=0.0)
    observation, _ = env.reset(seed=0)
    state = observation["observation"][criteria.STATE]
    np.testing.assert_allclose(state[:3], [0.148388023, -1.76848573, 1.84390296], atol=1e-6)
    achieved = observation["achieved_goal"]
    goal = criteria.goal_state(achieved, state[:9])
    objects = [11, 12, 15, 16, 17, 18, 19, 20, 21, 22, *range(23, 30)]
    np.testing.assert_array_equal(goal[objects], state[objects])
    np.testing.assert_array_equal(goal[:9], state[:9])
    assert len(criteria.GAS_ROBOT) == 9
