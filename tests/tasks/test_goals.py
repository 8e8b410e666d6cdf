"""Goals by prop, and the tables that scenes derive from the order of their props."""

import dataclasses

import numpy as np
import pytest
from dm_control import mjcf
from helpers.errors import refused

from kitchen_suite.entities import build_kitchen_scene
from kitchen_suite.entities.joints import addresses
from kitchen_suite.entities.scenes import build_microwave_table_scene
from kitchen_suite.tasks import GOALS
from kitchen_suite.tasks.goals import Goal, GoalSet, Progress
from kitchen_suite.tasks.kitchen import observation as noise
from kitchen_suite.tasks.kitchen.goals import INITIAL_QPOS
from kitchen_suite.tasks.sensors import SceneIndices

# Greatest noise of each element at a ratio of 1.
AMPLITUDES = noise.noise_scale(robot_ratio=1.0, object_ratio=1.0)


@pytest.fixture(scope="module")
def kitchen():
    return build_kitchen_scene(visuals=False)


@pytest.fixture(scope="module")
def physics(kitchen):
    return mjcf.Physics.from_mjcf_model(kitchen.arena.mjcf_model)


def test_the_goals_elements_in_the_kitchen_are_their_joints(kitchen):
    assert {task: tuple(goal.elements_in(kitchen)) for task, goal in GOALS.items()} == {
        "bottom burner": (2, 3),
        "top burner": (6, 7),
        "light switch": (8, 9),
        "slide cabinet": (10,),
        "hinge cabinet": (11, 12),
        "microwave": (13,),
        "kettle": (14, 15, 16, 17, 18, 19, 20),
        "bottom right burner": (0, 1),
        "top right burner": (4, 5),
        "left hinge cabinet": (11,),
        "close microwave": (13,),
        "close slide cabinet": (10,),
        "close hinge cabinet": (12,),
        "close left hinge cabinet": (11,),
        "turn off bottom burner": (2, 3),
        "turn off top burner": (6, 7),
        "turn off bottom right burner": (0, 1),
        "turn off top right burner": (4, 5),
        "turn off light switch": (8, 9),
        "return kettle": (14, 15, 16, 17, 18, 19, 20),
    }


@pytest.mark.parametrize("task", GOALS)
def test_elements_are_of_the_goals_joints(kitchen, physics, task):
    in_qpos, _ = addresses(physics, kitchen.object_joints)
    expected, _ = addresses(physics, GOALS[task].joints_in(kitchen))
    np.testing.assert_array_equal(in_qpos[GOALS[task].elements_in(kitchen)], expected)


# Two episodes of two tasks: which are within their thresholds after each step.
WITHIN = ([[0, 0], [0, 0]], [[1, 0], [0, 0]], [[1, 0], [0, 0]], [[0, 1], [0, 1]], [[0, 0], [0, 0]])


@pytest.mark.parametrize(("removed", "again"), [(True, [[0, 0], [0, 0]]), (False, [[1, 0], [0, 0]])])
def test_the_steps_of_first_completions_are_counted_from_one(removed, again):
    progress = Progress.initial((2, 2))
    assert progress.completion_steps.tolist() == [[-1, -1]] * 2
    seen = []
    for within in WITHIN:
        progress = progress.update(np.array(within, bool), remove_task_when_completed=removed)
        seen.append(progress)
    assert [each.step.tolist() for each in seen] == [[[number]] * 2 for number in (1, 2, 3, 4, 5)]
    assert [each.within.astype(int).tolist() for each in seen] == [*WITHIN]
    assert [each.completions.astype(int).tolist() for each in seen] == [*WITHIN[:2], again, *WITHIN[3:]]
    assert [each.advanced.tolist() for each in seen] == [[0, 0], [1, 0], [0, 0], [1, 1], [0, 0]]
    assert [each.steps_since_completion.tolist() for each in seen] == [[1, 1], [0, 2], [1, 3], [0, 0], [1, 1]]
    assert progress.completion_steps.tolist() == [[2, 4], [-1, 4]]
    assert progress.completed.tolist() == [[1, 1], [0, 1]]
    assert progress.remaining.tolist() == ([[0, 0], [1, 0]] if removed else [[1, 1]] * 2)
    # An episode alone has the same progress as among others.
    alone = Progress.initial((2,))
    for within, each in zip(WITHIN, seen, strict=True):
        alone = alone.update(np.array(within[0], bool), remove_task_when_completed=removed)
        for name in (*Progress._fields, "advanced", "steps_since_completion"):
            np.testing.assert_array_equal(getattr(alone, name), getattr(each, name)[0])


def test_masks_of_progress_are_boolean():
    progress = Progress.initial((2, 2))
    # Numpy warns of nothing.
    with np.errstate(all="raise"):
        for within in WITHIN:
            progress = progress.update(np.array(within, bool), remove_task_when_completed=False)
            for mask in (progress.within, progress.completions, progress.remaining, progress.completed):
                assert mask.dtype == bool
            assert progress.advanced.shape == (2,)


def test_tasks_may_all_be_completed_in_the_first_step():
    progress = Progress.initial((2,)).update(np.array([True, True]), remove_task_when_completed=True)
    assert progress.completed.tolist() == [True, True]
    assert progress.advanced
    assert progress.steps_since_completion == 0
    later = progress.update(np.array([True, True]), remove_task_when_completed=True)
    assert later.steps_since_completion == 1
    assert not later.advanced


def test_whether_completed_tasks_are_removed_is_named():
    with pytest.raises(TypeError):
        Progress.initial((1,)).update(np.array([True]), True)


def test_goals_share_joints_of_one_prop():
    def goal(prop, *joints):
        # A name that is equal to another, but not the same object, as in a user's own table.
        return Goal(prop="".join([*prop]), joints=joints or None, value=(0.0,))

    whole, left, right, both = goal("oven"), goal("oven", "left"), goal("oven", "right"), goal("oven", "right", "left")
    for one, other in ((whole, whole), (whole, left), (left, left), (both, left), (both, right)):
        assert one.shares_joints(other)
        assert other.shares_joints(one)
    assert not left.shares_joints(right)
    # Props before and after it in the alphabet.
    for other in ("hood", "table"):
        for one in (whole, left):
            for another in (goal(other), goal(other, "left")):
                assert not one.shares_joints(another)
                assert not another.shares_joints(one)


PAIR = {"lid": Goal(prop="pot", value=(1.0, 2.0)), "dial": Goal(prop="oven", value=(3.0,))}


def test_goals_and_their_sets_are_constant_and_named():
    for record, field in ((PAIR["lid"], "prop"), (GoalSet.build(PAIR, ["lid"]), "tasks")):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(record, field, "other")
        with pytest.raises(TypeError):
            type(record)(*vars(record).values())


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_goals_are_at_most_mujocos_greatest_position(sign):
    goals = GoalSet.build(PAIR, ["lid", "dial"], {"lid": [0.0, sign * 1e10]})
    assert goals.desired.tolist() == [0.0, sign * 1e10, 3.0]
    with refused(ValueError, "'lid'", "1e+10", f"{sign * 1.5:g}e+10"):
        GoalSet.build(PAIR, ["dial", "lid"], {"lid": [sign * 1.5e10, 0.0]})


def test_completed_tasks_are_in_the_order_of_completion():
    goals = GoalSet.build(PAIR, ["dial", "lid"])
    assert [*goals.by_completion(np.array([7, 1])).items()] == [("lid", 1), ("dial", 7)]
    assert [*goals.by_completion(np.array([1, 7])).items()] == [("dial", 1), ("lid", 7)]
    assert goals.by_completion(np.array([-1, 3])) == {"lid": 3}


def test_masks_and_steps_are_of_all_tasks():
    goals = GoalSet.build(PAIR, ["dial", "lid"])
    assert goals.names(np.array([False, True])) == ["lid"]
    for size in (1, 3):
        with pytest.raises(ValueError, match="zip"):
            goals.names(np.ones(size, bool))
        with pytest.raises(ValueError, match="zip"):
            goals.by_completion(np.ones(size, int))


def test_noise_and_initial_positions_are_the_references():
    positions = [0.1, *[0.005] * 2, *[0.0005] * 6, *[0.005] * 3, *[0.1] * 3, *[0.005] * 3, *[0.1] * 3]
    velocities = [*[0.005] * 11, *[0.1] * 3, *[0.005] * 3, *[0.1] * 3]
    np.testing.assert_array_equal(AMPLITUDES, [*[0.1] * 18, *positions, *velocities])
    # fmt: off
    expected = [
        1.48388023e-01, -1.76848573e+00, 1.84390296e+00, -2.47685760e+00, 2.60252026e-01, 7.12533105e-01,
        1.59515394e+00, 4.79267505e-02, 3.71350919e-02, -2.66279850e-04, -5.18043486e-05, 3.12877220e-05,
        -4.51199853e-05, -3.90842156e-06, -4.22629655e-05, 6.28065475e-05, 4.04984708e-05, 4.62730939e-04,
        -2.26906415e-04, -4.65501369e-04, -6.44129196e-03, -1.77048263e-03, 1.08009684e-03, -2.69397440e-01,
        3.50383255e-01, 1.61944683e+00, 1.00618764e+00, 4.06395120e-03, -6.62095997e-03, -2.68278933e-04,
    ]
    # fmt: on
    np.testing.assert_array_equal(INITIAL_QPOS, expected)


def test_the_microwaves_goal_holds_in_another_scene():
    scene = build_microwave_table_scene(visuals=False)
    indices = SceneIndices(
        scene, GoalSet.build(GOALS, ["microwave"]), mjcf.Physics.from_mjcf_model(scene.arena.mjcf_model)
    )
    np.testing.assert_array_equal(indices.goal_qpos, indices.object_qpos)
    np.testing.assert_array_equal(GOALS["microwave"].elements_in(scene), [0])
    with refused(ValueError, "'kettle'"):
        GOALS["kettle"].joints_in(scene)


@pytest.mark.parametrize(
    ("goal", "shown"),
    [
        (Goal(prop="toaster", value=(0.0,)), ["'toaster'"]),
        (Goal(prop="oven", joints=("knob",), value=(0.0,)), ["'oven'"]),
        (Goal(prop="kettle", value=(0.0,)), ["'mine'", "7"]),
    ],
)
def test_goals_must_fit_the_scene(kitchen, physics, goal, shown):
    with refused(ValueError, *shown):
        SceneIndices(kitchen, GoalSet.build({"mine": goal}, ["mine"]), physics)
