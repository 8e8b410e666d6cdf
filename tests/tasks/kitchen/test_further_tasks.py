"""Tasks beyond the reference's seven: their goals, their starts, which exclude each other, and variations of them."""

import itertools

import gymnasium
import numpy as np
import pytest
from helpers.sweeps import brief

from kitchen_suite import experts, gymnasium_env, suite
from kitchen_suite.commands import rollout
from kitchen_suite.entities.joints import addresses
from kitchen_suite.gymnasium_env import FrankaKitchenEnv
from kitchen_suite.tasks import DEFAULT_TASKS, GOALS, KitchenTask
from kitchen_suite.tasks.kitchen.goals import INITIAL_QPOS, REVERSES
from kitchen_suite.vector_env import FrankaKitchenVectorEnv

# Pairs of tasks that exclude each other, and why.
EXCLUDED = [
    *((pair, f"{pair[0]!r} undoes {pair[1]!r}") for pair in REVERSES.items()),
    (("left hinge cabinet", "hinge cabinet"), "the goal of 'hinge cabinet' has the left door closed"),
]

# All default tasks done at the start.
DONE = {"tasks/done": np.ones(7)}

FURTHER = [task for task in GOALS if task not in DEFAULT_TASKS]


def load(*tasks, **options):
    kwargs = {"random": 0, "visuals": False, "tasks_to_complete": tasks, **options}
    environment = suite.load("kitchen", "all", kwargs)
    environment.reset()
    return environment


def columns(environment, task):
    return addresses(environment.physics, GOALS[task].joints_in(environment.task.scene))[0]


def test_every_task_has_a_reverse_and_the_default_is_the_references_seven():
    assert {*REVERSES} | {*REVERSES.values()} == {*GOALS}
    assert KitchenTask.__init__.__kwdefaults__["tasks_to_complete"] == DEFAULT_TASKS
    assert FrankaKitchenEnv.__init__.__defaults__[0] == DEFAULT_TASKS
    assert suite.task_arguments("kitchen", "all") == {"tasks_to_complete": DEFAULT_TASKS}
    assert "turn_off_top_right_burner" not in suite.DOMAINS["kitchen"].benchmark_tasks
    assert gymnasium_env.TASK_IDS["kitchen", "close_microwave"] == "KitchenSuite/CloseMicrowave-v1"


@pytest.mark.full
def test_goals_are_within_the_ranges_of_their_joints():
    environment = load(*DEFAULT_TASKS)
    for task in GOALS:
        if GOALS[task].prop == "kettle":
            continue
        joints = environment.physics.bind(GOALS[task].joints_in(environment.task.scene))
        low, high = joints.range.T
        # The initial state and the reference's goals are outside by up to this [rad, m].
        assert (low - 0.002 <= GOALS[task].value).all()
        assert (GOALS[task].value <= high + 0.002).all()


@pytest.mark.full
@pytest.mark.parametrize("task", brief(FURTHER, kept=["top right burner", "turn off bottom burner", "return kettle"]))
def test_no_task_is_complete_at_its_start_and_each_starts_at_rest(task):
    environment = load(task)
    distance = environment.task.task_distances[0]
    assert distance > 1.2 * environment.task.threshold
    for _ in range(25):
        environment.step(np.zeros(9))
    assert not environment.task.episode_task_completions
    # A knob's spring turns it by 4e-4 rad in a second.
    assert abs(environment.task.task_distances[0] - distance) < 2e-3


@pytest.mark.full
@pytest.mark.parametrize(
    ("reverse", "forward"),
    brief(REVERSES.items(), kept=[("close hinge cabinet", "hinge cabinet"), ("return kettle", "kettle")]),
)
def test_a_reverse_starts_where_the_other_task_ends_and_leads_to_the_initial_state(reverse, forward):
    environment = load(reverse)
    data, indices = environment.physics.data, columns(environment, reverse)
    wanted = np.array(GOALS[forward].value)[-indices.size :]
    # Burners and the lamp end up to 0.001 m beyond the goal that they can reach.
    np.testing.assert_allclose(data.qpos[indices], wanted, atol=1.1e-3)
    np.testing.assert_array_equal(INITIAL_QPOS[indices], GOALS[reverse].value)
    joints = environment.physics.bind(GOALS[reverse].joints_in(environment.task.scene))
    if indices.size == len(GOALS[reverse].joints_in(environment.task.scene)):
        assert (joints.range.T[0] <= data.qpos[indices]).all()
        assert (data.qpos[indices] <= joints.range.T[1]).all()
    others = np.setdiff1d(np.arange(30), indices)
    np.testing.assert_array_equal(data.qpos[others], INITIAL_QPOS[others])
    np.testing.assert_array_equal(data.qvel, 0.0)


@pytest.mark.full
@pytest.mark.parametrize("tasks", [DEFAULT_TASKS, ("left hinge cabinet", "top right burner")])
def test_the_start_without_reverses_is_the_references(tasks):
    environment = load(*tasks)
    np.testing.assert_array_equal(environment.physics.data.qpos, INITIAL_QPOS)


@pytest.mark.full
@pytest.mark.parametrize(
    ("pair", "reason"),
    brief(EXCLUDED, kept=[EXCLUDED[0], EXCLUDED[-1]]),
)
def test_tasks_that_exclude_each_other_are_refused_everywhere(pair, reason):
    for build in (
        lambda: load("light switch", *pair) if "light switch" not in pair else load(*pair),
        lambda: FrankaKitchenEnv(list(pair)),
        lambda: FrankaKitchenVectorEnv(2, tasks_to_complete=list(pair)),
        lambda: experts.KitchenExpert(pair),
    ):
        with pytest.raises(ValueError, match=f"tasks .* and .* cannot be asked together: {reason}"):
            build()


@pytest.mark.full
def test_doors_of_the_hinge_cabinet_are_tasks_of_their_own():
    environment = load("close left hinge cabinet", "hinge cabinet", "close slide cabinet")
    np.testing.assert_allclose(environment.task.task_distances, [1.2436, np.hypot(1.25, 1.4518), 0.3705], atol=1e-3)
    environment = load("close hinge cabinet", "close left hinge cabinet")
    assert (environment.task.task_distances > 1.2).all()
    environment = load("close hinge cabinet", "left hinge cabinet")
    np.testing.assert_allclose(environment.task.task_distances, [1.4518, 1.2436], atol=1e-3)


@pytest.mark.full
def test_reverses_highlight_their_props():
    environment = suite.load("kitchen", "close_microwave", {"random": 0}, visualize_reward=True)
    environment.reset()
    geoms = environment.task.scene.joints("microwave")[0].parent.find_all("geom")
    environment.physics.data.qpos[columns(environment, "close microwave")] = 0.0
    environment.step(np.zeros(9))
    np.testing.assert_allclose(environment.physics.bind(geoms).rgba, np.tile((0.25, 0.75, 0.3, 1.0), (len(geoms), 1)))


@pytest.mark.full
def test_gymnasium_single_and_vectorised_start_and_step_alike():
    tasks = ["close slide cabinet", "return kettle", "turn off top burner", "left hinge cabinet"]
    many = FrankaKitchenVectorEnv(2, tasks_to_complete=tasks, num_threads=1)
    observed, _ = many.reset(seed=5)
    actions = np.full((2, 9), 0.3, np.float32)
    stepped, *_ = many.step(actions)
    for i in range(2):
        single = FrankaKitchenEnv(tasks)
        one, _ = single.reset(seed=5 + i)
        np.testing.assert_array_equal(one["observation"], observed["observation"][i])
        assert list(one["achieved_goal"]) == tasks
        one, _, _, _, info = single.step(actions[i])
        np.testing.assert_array_equal(one["observation"], stepped["observation"][i])
        np.testing.assert_array_equal(
            single.compute_reward(one["achieved_goal"], one["desired_goal"], info), info["is_success"]
        )
    reached = gymnasium.make("KitchenSuite/ReturnKettle-v1").reset(seed=0)[0]
    assert reached["achieved_goal"]["return kettle"][1] == 0.75


@pytest.mark.full
def test_commands_know_the_tasks(capsys):
    assert rollout.main(["--task_name=turn_off_light_switch", "--policy=expert", "--num_episodes=1"]) == 0
    assert "success rate          100% (1 of 1)" in capsys.readouterr().out
    assert rollout.main(["--task_name=turn_of_light_switch"]) == 2
    assert "did you mean 'turn_off_light_switch'?" in capsys.readouterr().err


@pytest.mark.full
@pytest.mark.parametrize(
    ("task", "split"),
    brief(
        itertools.product(FURTHER, ["seen", "held_out"]),
        kept=[("close microwave", "seen"), ("return kettle", "held_out"), ("left hinge cabinet", "seen")],
    ),
)
def test_variations_leave_the_start_within_the_ranges_and_away_from_the_goal(task, split):
    environment = load(task, variations=["start"], variation_split=split)
    for _ in range(20):
        environment.reset()
        assert environment.task.task_distances[0] >= 1.2 * environment.task.threshold
        for start in environment.task._starts.values():
            assert start.allows(environment.physics.data.qpos)


@pytest.mark.full
@pytest.mark.parametrize("task", brief(FURTHER, kept=["return kettle", "close hinge cabinet"]))
def test_variations_of_the_layout_can_be_drawn(task):
    environment = load(task, variations="layout")
    before = environment.physics.data.qpos[columns(environment, task)]
    for _ in range(3):
        environment.reset()
    if task == "return kettle":
        # The kettle stays on the top left burner, whichever burner it would start on otherwise.
        np.testing.assert_array_equal(environment.physics.data.qpos[columns(environment, task)], before)


@pytest.mark.full
@pytest.mark.parametrize("task", brief(FURTHER, kept=["turn off bottom burner"]))
def test_what_is_done_at_the_start_never_touches_the_joints_of_asked_tasks(task):
    plain, varied = load(task), load(task, variations=DONE)
    indices = columns(plain, task)
    np.testing.assert_array_equal(plain.physics.data.qpos[indices], varied.physics.data.qpos[indices])


def test_the_right_door_is_not_opened_where_that_would_close_the_left_one():
    np.testing.assert_allclose(varied_doors("close left hinge cabinet", DONE), [-1.25, 0.0], atol=0.01)


def varied_doors(task, variations):
    environment = load(task, variations=variations)
    return environment.physics.bind(environment.task.scene.joints("hinge_cabinet")).qpos
