"""Options of a reset as in OGBench: the task by its number, and the goal as an observation and as a picture."""

import gymnasium
import numpy as np
import pytest

from kitchen_suite.gymnasium_env import FrankaKitchenEnv
from kitchen_suite.tasks import DEFAULT_TASKS, GOALS
from kitchen_suite.tasks.kitchen.observation import FRANKA_SLICES

ROBOT = FRANKA_SLICES.robot_positions
OBJECTS = FRANKA_SLICES.object_positions

NO_NOISE = {"object_noise_ratio": 0.0, "robot_noise_ratio": 0.0}


@pytest.fixture(scope="module")
def environment():
    return FrankaKitchenEnv(tasks_per_episode=1, goal_states=1, visuals=False, **NO_NOISE)


@pytest.mark.parametrize("task_id", range(1, 8))
def test_a_number_asks_for_its_task_and_shows_its_goal(environment, task_id):
    task = DEFAULT_TASKS[task_id - 1]
    observation, info = environment.reset(seed=0, options={"task_id": task_id})
    assert info["requested_tasks"] == [task]
    goal, start = info["goal"], observation["observation"]
    assert goal.shape == start.shape
    np.testing.assert_array_equal(np.r_[goal[ROBOT], goal[OBJECTS]], observation["goal_states"])
    elements = GOALS[task].elements_in(environment.composer_task.scene)
    np.testing.assert_allclose(goal[OBJECTS][elements], GOALS[task].value)
    # All else is as at the start, and at rest.
    others = np.setdiff1d(np.arange(21), elements)
    np.testing.assert_allclose(goal[OBJECTS][others], start[OBJECTS][others], atol=1e-6)
    moving = np.setdiff1d(np.arange(59), np.r_[ROBOT, OBJECTS])
    assert not goal[moving].any()


def test_the_goal_is_an_info_of_resets_that_ask_for_it_alone(environment):
    assert "goal" not in environment.reset(seed=0)[1]
    assert "goal" in environment.reset(seed=0, options={"task_id": 3})[1]
    assert "goal" not in environment.step(np.zeros(9, np.float32))[4]
    assert "goal" not in environment.reset()[1]
    first = environment.reset(seed=5, options={"task_id": 2})[0]["observation"]
    # The number replaces what would be drawn, and changes no other draw.
    np.testing.assert_array_equal(
        first, environment.reset(seed=5, options={"requested_tasks": ["top burner"]})[0]["observation"]
    )


def test_without_observed_goals_the_goal_has_all_tasks_done():
    environment = gymnasium.make("KitchenSuite/FrankaKitchen-v1", tasks_to_complete=["microwave", "kettle"])
    info = environment.reset(seed=0, options={"render_goal": False})[1]
    assert info["goal"].shape == (59,)
    scene = environment.unwrapped.composer_task.scene
    for task in ("microwave", "kettle"):
        np.testing.assert_allclose(info["goal"][OBJECTS][GOALS[task].elements_in(scene)], GOALS[task].value)
    environment.close()


@pytest.mark.full
@pytest.mark.rendering
def test_the_picture_of_the_goal_is_that_of_a_kitchen_there_and_leaves_nothing_behind():
    arguments = {"tasks_per_episode": 1, "goal_states": 1, "render_mode": "rgb_array", "width": 64, "height": 64}
    environment = FrankaKitchenEnv(**arguments, **NO_NOISE)
    info = environment.reset(seed=0, options={"task_id": 6, "render_goal": True})[1]
    before, picture = environment.render(), info["goal_rendered"]
    assert picture.shape == before.shape == (64, 64, 3)
    assert picture.dtype == np.uint8
    assert (picture != before).any()
    state = environment.reset(
        seed=0, options={"start_state": environment.reset(seed=0, options={"task_id": 6})[0]["goal_states"]}
    )
    np.testing.assert_array_equal(environment.render(), picture)
    del state
    environment.reset(seed=0, options={"task_id": 6})
    np.testing.assert_array_equal(environment.render(), before)
    environment.close()


@pytest.mark.full
@pytest.mark.rendering
def test_vectorised_goals_are_those_of_single_environments():
    arguments = {"tasks_per_episode": 1, "goal_states": 1, "render_mode": "rgb_array", "width": 32, "height": 32}
    vector = gymnasium.make_vec(
        "KitchenSuite/FrankaKitchen-v1", 3, vectorization_mode="vector_entry_point", **arguments
    )
    options = {"task_id": [6, None, 7], "render_goal": [True, None, False]}
    infos = vector.reset(seed=[1, 2, 3], options=options)[1]
    assert infos["_goal"].tolist() == [True, False, True]
    assert infos["_goal_rendered"].tolist() == [True, False, False]
    assert not infos["goal"][1].any()
    assert not infos["goal_rendered"][1:].any()
    environment = FrankaKitchenEnv(**arguments)
    single = environment.reset(seed=1, options={"task_id": 6, "render_goal": True})[1]
    np.testing.assert_array_equal(infos["goal"][0], single["goal"])
    np.testing.assert_array_equal(infos["goal_rendered"][0], single["goal_rendered"])
    single = environment.reset(seed=3, options={"task_id": 7})[1]
    np.testing.assert_array_equal(infos["goal"][2], single["goal"])
    # Only in environments that start an episode.
    mask = np.array([False, True, False])
    infos = vector.reset(options={"reset_mask": mask, "task_id": [1, 2, 3]})[1]
    np.testing.assert_array_equal(infos["_goal"], mask)
    assert "goal" not in vector.reset(seed=0)[1]
    vector.close()
    environment.close()


@pytest.mark.parametrize(
    ("options", "error", "shown"),
    [
        ({"task_id": 0}, ValueError, "task_id must be at least 1"),
        ({"task_id": 8}, ValueError, "task_id must be at most 7"),
        ({"task_id": 1, "requested_tasks": ["kettle"]}, ValueError, "task_id and requested_tasks"),
        ({"render_goal": 1}, TypeError, "render_goal"),
        ({"render_goal": True}, ValueError, "render_goal .*render_mode"),
        ({"task_ids": 1}, ValueError, "task_id"),
    ],
)
def test_bad_options_are_refused(environment, options, error, shown):
    with pytest.raises(error, match=shown):
        environment.reset(options=options)


@pytest.mark.full
def test_a_number_needs_tasks_that_are_drawn():
    environment = FrankaKitchenEnv(visuals=False)
    with pytest.raises(ValueError, match=r"task_id .*tasks_per_episode"):
        environment.reset(options={"task_id": 1})


def test_bad_options_of_vectorised_resets_are_refused():
    arguments = {"tasks_per_episode": 1, "visuals": False}
    vector = gymnasium.make_vec(
        "KitchenSuite/FrankaKitchen-v1", 2, vectorization_mode="vector_entry_point", **arguments
    )
    vector.reset(seed=0)
    for options, error, shown in (
        ({"task_id": 3}, TypeError, "task_id must be a sequence"),
        ({"task_id": [1, 2, 3]}, ValueError, "task_id .* 2"),
        ({"task_id": [1, 8]}, ValueError, "task_id must be at most 7"),
        ({"render_goal": [True, False]}, ValueError, "render_goal .*render_mode"),
    ):
        with pytest.raises(error, match=shown):
            vector.reset(options=options)
    # Of an environment that starts no episode, no picture is taken.
    mask = np.array([True, False])
    infos = vector.reset(options={"reset_mask": mask, "task_id": [4, None], "render_goal": [None, True]})[1]
    assert infos["_goal"].tolist() == [True, False]
    assert "goal_rendered" not in infos
    vector.close()
