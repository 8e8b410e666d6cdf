"""Completion by thresholds or by strict tolerances, decided by one object."""

import json

import numpy as np
import pytest
from helpers.errors import refused
from scipy.spatial.transform import Rotation

from kitchen_suite import suite
from kitchen_suite.entities.joints import joint_types
from kitchen_suite.experts import KitchenExpert
from kitchen_suite.gymnasium_env import FrankaKitchenEnv
from kitchen_suite.tasks import DEFAULT_TASKS, GOALS
from kitchen_suite.tasks.goals import Goal, GoalSet, Success, ThresholdSuccess, make_success

KETTLE = np.array(GOALS["kettle"].value)


def load(tasks, **options):
    return suite.load(
        "kitchen", "all", task_kwargs={"random": 0, "visuals": False, "tasks_to_complete": tasks, **options}
    )


def strict(task, **options):
    return load([task], success="strict", **options).task.mdp.success


def within(success, achieved, **options):
    return success.within(np.asarray(achieved, np.float64), **options)


@pytest.mark.full
@pytest.mark.parametrize(
    ("task", "inside", "outside"),
    [
        ("microwave", [[-0.701], [-0.799]], [[-0.699], [-0.801]]),
        ("slide cabinet", [[0.361], [0.379]], [[0.359], [0.381]]),
        ("hinge cabinet", [[0.049, 1.401]], [[0.051, 1.45], [0.0, 1.399]]),
        ("light switch", [[-0.645, -0.041]], [[-0.645, -0.039], [-0.63, -0.05]]),
        # Burners travel less than their tolerance, so that the knobs decide.
        ("bottom burner", [[-0.85, 0.0], [-0.85, -0.009]], [[-0.8, -0.009]]),
    ],
)
def test_strict_success_asks_every_joint(task, inside, outside):
    success = strict(task)
    assert within(success, inside).all()
    assert not within(success, outside).any()


def test_the_kettle_must_stand_near_its_goal_turned_or_not():
    success = strict("kettle")

    def pose(offset=(0, 0, 0), axis=(0, 0, 1), angle=0.0):
        return np.concatenate([KETTLE[:3] + offset, [np.cos(angle / 2)], np.sin(angle / 2) * np.array(axis)])

    inside = [pose(), pose((0.02, 0.02, 0)), pose(angle=2.0), pose(axis=(1, 0, 0), angle=-0.19), -pose(angle=-0.1)]
    outside = [pose((0.022, 0.022, 0)), pose((0, 0, 0.031)), pose(axis=(0, 1, 0), angle=0.21)]
    inside[-1][:3] = KETTLE[:3]
    assert within(success, inside)[:, 0].tolist() == [True] * 5
    assert within(success, outside)[:, 0].tolist() == [False] * 3
    # One row has the same numbers alone and among many.
    rows = np.array(inside + outside)
    np.testing.assert_array_equal(success.ratios(rows), [success.ratios(row) for row in rows])
    assert (success.ratios(rows) <= 1.0)[:, 0].tolist() == within(success, rows)[:, 0].tolist()


@pytest.mark.full
def test_the_kettles_tilt_is_the_angle_between_verticals_whatever_the_length_of_its_quaternion():
    quaternions = np.random.default_rng(0).normal(size=(200, 4))
    up, goal = (
        Rotation.from_quat(each[..., [1, 2, 3, 0]]).apply([0.0, 0.0, 1.0]) for each in (quaternions, KETTLE[3:])
    )
    poses = np.concatenate([np.tile(KETTLE[:3], (200, 1)), quaternions], axis=1)
    chords = np.linalg.norm(up - goal, axis=1)
    np.testing.assert_allclose(strict("kettle").ratios(poses)[:, 0], chords / (2.0 * np.sin(0.1)), rtol=1e-9)


@pytest.mark.full
def test_a_kettle_among_other_tasks_is_judged_as_alone():
    success = load(["kettle", "microwave"], success="strict").task.mdp.success
    goal = np.array([*KETTLE, *GOALS["microwave"].value])
    achieved = goal + np.array([0.01, 0.0, 0.02, 0.0, 0.1, 0.0, 0.0, 0.025])
    expected = [*strict("kettle").ratios(achieved[:7]), 0.5]
    np.testing.assert_allclose(success.ratios(achieved), expected, rtol=1e-12)
    np.testing.assert_allclose(success.ratios(np.stack([goal, achieved])), [[0.0, 0.0], expected], atol=1e-12)
    # Relabelled goals.
    np.testing.assert_allclose(success.ratios(goal, achieved)[1], 0.5, rtol=1e-12)


# Distances from these goals, and from thresholds that are powers of two, are exact.
PAIR = GoalSet.build(
    {"lid": Goal(prop="pot", value=(1.0, 2.0)), "dial": Goal(prop="oven", value=(3.0,))}, ["lid", "dial"]
)
ACHIEVED = np.array([[1.0, 2.25, 3.5], [1.5, 2.0, 3.125]])


def test_distances_are_measured_in_thresholds():
    np.testing.assert_array_equal(ThresholdSuccess(PAIR, 0.25).ratios(ACHIEVED), [[1.0, 2.0], [2.0, 0.5]])
    by_task = ThresholdSuccess(PAIR, np.array([0.5, 1.0]))
    np.testing.assert_array_equal(by_task.ratios(ACHIEVED), [[0.5, 0.5], [1.0, 0.125]])
    np.testing.assert_array_equal(by_task.ratios(ACHIEVED[0]), [0.5, 0.5])


def test_a_distance_must_be_below_its_threshold():
    success = ThresholdSuccess(PAIR, 0.25)
    assert success.within(ACHIEVED).tolist() == [[False, False], [False, True]]
    assert success.within(ACHIEVED, factor=2.0).tolist() == [[True, False], [False, True]]
    assert success.within(ACHIEVED, np.array([1.0, 2.25, 3.5])).tolist() == [[True, True], [False, False]]
    assert success.within_distances(np.array([0.125, 0.25, 0.5])).tolist() == [True, False, False]


def test_criteria_must_measure_and_decide():
    with pytest.raises(TypeError, match="ratios"):
        type("Neither", (Success,), {"within": ThresholdSuccess.within})(PAIR)
    with pytest.raises(TypeError, match="within"):
        type("Neither", (Success,), {"ratios": ThresholdSuccess.ratios})(PAIR)


def test_a_threshold_of_zero_is_refused_on_request():
    for threshold in (0.0, {"lid": 0.0}):
        assert not make_success(PAIR, None, default=0.3, threshold=threshold).within(np.array([1.0, 2.0, 3.0]))[0]
        with refused(ValueError, "threshold", "positive"):
            make_success(PAIR, None, default=0.3, threshold=threshold, positive=True)
    with pytest.raises(TypeError):
        make_success(PAIR, None, 0.3)


@pytest.mark.full
def test_factors_widen_thresholds_and_tolerances():
    assert within(strict("microwave"), [-0.695], factor=1.2)
    thresholds = load(["microwave"], threshold=0.1).task.mdp.success
    assert [bool(within(thresholds, [-0.64], factor=factor)[0]) for factor in (1.0, 1.2)] == [False, True]


def test_types_of_joints_are_those_of_the_compiled_model():
    environment = load(list(DEFAULT_TASKS))
    environment.reset()
    for goal in GOALS.values():
        joints = goal.joints_in(environment.task.scene)
        numbers = [int(environment.physics.bind(joint).type) for joint in joints]
        assert [("free", "ball", "slide", "hinge")[number] for number in numbers] == joint_types(joints)


@pytest.mark.full
def test_thresholds_may_differ_by_task():
    environment = load(["microwave", "kettle"], threshold={"kettle": 9.0})
    environment.reset()
    environment.step(np.zeros(9))
    assert environment.task.episode_task_completions == ["kettle"]
    assert environment.task.threshold == {"microwave": 0.3, "kettle": 9.0}
    assert [load(["kettle"], **given).task.threshold for given in ({}, {"threshold": 1})] == [0.3, 1.0]
    assert load(["kettle"], success="strict").task.threshold is None


@pytest.mark.full
def test_success_is_strict_where_a_file_says_so():
    assert load(["kettle"], **json.loads('{"success": "strict"}')).task.threshold is None


def test_original_success_is_the_default():
    assert load(["kettle"], success="original").task.threshold == 0.3


@pytest.mark.full
def test_gymnasium_decides_as_the_task_does():
    env = FrankaKitchenEnv(["microwave", "kettle"], success="strict", goal_format="flat")
    desired = env.reset(seed=0)[0]["desired_goal"]
    near = desired + np.array([0.2, *np.zeros(7)])
    assert [env.compute_reward(goal, desired, {}) for goal in (desired, near)] == [2.0, 1.0]
    assert [env.compute_terminated(goal, desired, {}) for goal in (desired, near)] == [True, False]
    # The goals of a relabelled step decide, not those of the task.
    assert env.compute_reward(near, near, {}) == 2.0


@pytest.mark.full
def test_recordings_show_what_was_reached():
    task = load(["microwave"], success="strict").task
    arrays = {"observation/achieved_goal": np.array([[0.0], [-0.6], [-0.74]])}
    assert task.records.goals_reached(arrays)[1].tolist() == [[False], [False], [True]]
    # Distances do not say which joints are off.
    assert task.records.goals_reached({"info/task_distances": np.zeros((3, 1))}) is None
    by_distance = load(["microwave"]).task.records.goals_reached({"info/task_distances": np.array([[0.5], [0.1]])})
    assert by_distance[1].tolist() == [[False], [True]]


@pytest.mark.full
def test_no_asked_task_starts_within_a_widened_tolerance():
    for angle, start in ((-0.25, 0.0), (-0.22, -0.22)):
        options = {"goals": {"microwave": [-0.3]}, "variations": {"microwave/door": angle}}
        environment = load(["microwave"], success="strict", **options)
        environment.reset()
        assert environment.task.state.achieved[0] == pytest.approx(start, abs=5e-3)


STRICT_TASKS = ("slide cabinet", "light switch")


@pytest.mark.full
@pytest.mark.parametrize(
    "task",
    [*STRICT_TASKS, *(pytest.param(task, marks=pytest.mark.nightly) for task in GOALS if task not in STRICT_TASKS)],
)
def test_the_expert_is_strict_where_the_environment_is(task):
    environment = load([task], success="strict")
    expert = KitchenExpert.for_task(environment.task)
    successes = 0
    for seed in range(60, 63):
        environment.random_state.seed(seed)
        timestep = environment.reset()
        expert.reset(np.random.default_rng(0))
        while not timestep.last():
            flat = np.concatenate([np.ravel(part) for part in timestep.observation.values()])[:59]
            timestep = environment.step(expert.act(flat))
        successes += environment.task.episode_metrics["success"]
    assert successes >= (2 if task == "kettle" else 3)


@pytest.mark.full
def test_an_experts_own_threshold_replaces_the_tasks_success():
    task = load(["kettle"], success="strict").task
    KitchenExpert.for_task(task, threshold=0.1)
    KitchenExpert.for_task(load(["kettle"], threshold=0.2).task, success="strict")


@pytest.mark.full
@pytest.mark.parametrize(
    ("settings", "error", "shown"),
    [
        ({"success": "strikt"}, ValueError, ["'strict'"]),
        ({"success": 1}, TypeError, ["success", "1"]),
        ({"success": "strict", "threshold": 0.1}, ValueError, ["exclude each other"]),
        ({"success": "original", "threshold": 0.3}, ValueError, ["exclude each other"]),
        ({"threshold": {"kettel": 0.1}}, ValueError, ["'kettel'", "'kettle'"]),
        ({"threshold": {"microwave": 0.1}}, ValueError, ["['kettle']"]),
        ({"threshold": {"kettle": -1}}, ValueError, ["'kettle'"]),
        ({"threshold": {"kettle": True}}, TypeError, ["'kettle'"]),
        ({"threshold": [0.1]}, TypeError, ["threshold", "[0.1]"]),
    ],
)
def test_bad_input_is_refused(settings, error, shown):
    with refused(error, *shown):
        load(["kettle"], **settings)
