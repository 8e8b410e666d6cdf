"""Physics `fast`: the same kitchen in fewer and longer physics steps, by its name wherever it goes."""

import json

import gymnasium
import mujoco
import numpy as np
import pytest
from helpers.sweeps import brief, walk
from test_vector_autoreset import COUNT, MODES, assert_equal_for_ever, pair

from kitchen_suite import EnvironmentSpec, policies, suite
from kitchen_suite.commands import convert, record, replay, rollout

IDS = {name: suite.DOMAINS[name].env_id for name in ("kitchen", "microwave_table", "kitchens")}
LAYOUT = {"variations": ["start", "dynamics", "layout"]}
TASKS = ["kettle", "microwave", "light_switch"]


def load(domain="kitchen", **options):
    return suite.load(domain, suite.default_task(domain), {"random": 0, "visuals": False, **options})


@pytest.mark.full
@pytest.mark.parametrize(("domain", "steps"), [("kitchen", 6), ("microwave_table", 1), ("kitchens", 6)])
def test_control_steps_are_as_long_and_physics_steps_are_longer(domain, steps):
    fast, exact = (load(domain, physics=physics) for physics in ("fast", "exact"))
    assert fast.control_timestep() == exact.control_timestep()
    assert fast.task.physics_steps_per_control_step == steps < exact.task.physics_steps_per_control_step
    assert fast.physics.timestep() * steps == pytest.approx(fast.control_timestep())
    assert fast.physics.model.opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    assert fast.action_spec() == exact.action_spec()
    assert fast.observation_spec() == exact.observation_spec()


@pytest.mark.full
@pytest.mark.parametrize("task", brief(TASKS, TASKS[:1], full=TASKS))
def test_the_expert_succeeds_in_about_as_many_steps(task):
    steps = []
    for physics in ("exact", "fast"):
        environment = suite.load("kitchen", task, {"random": 0, "visuals": False, "physics": physics})
        policy, timestep = policies.find("expert")(environment, np.random.default_rng(0)), environment.reset()
        count = 0
        while not timestep.last():
            timestep, count = environment.step(policy(timestep)), count + 1
        assert environment.task.episode_metrics["success"]
        steps.append(count)
    assert abs(steps[0] - steps[1]) <= 4


def test_objects_at_rest_sleep_and_the_robot_does_not():
    environment = load(physics="fast")
    environment.reset()
    for _ in range(30):
        environment.step(np.zeros(9))
    asleep = environment.physics.data.ptr.tree_asleep >= 0
    robot = environment.physics.model.dof_treeid[:9]
    assert not asleep[robot].any()
    assert np.delete(asleep, robot).all()


TWO_TASKS = {"control_mode": "ee_delta_pose", "tasks_per_episode": 2, **LAYOUT}
CASES = [
    ("kitchen", "NextStep", {}),
    pytest.param("kitchen", "SameStep", {"control_mode": "joint_position", **LAYOUT}, marks=pytest.mark.full),
    pytest.param("kitchen", "Disabled", TWO_TASKS, marks=pytest.mark.full),
    pytest.param("kitchen", "NextStep", {"control_mode": "joint_delta"}, marks=pytest.mark.nightly),
    pytest.param("kitchen", "SameStep", {"control_mode": "ee_delta_position", **LAYOUT}, marks=pytest.mark.nightly),
    pytest.param("kitchen", "Disabled", {"control_mode": "ee_pose"}, marks=pytest.mark.nightly),
    ("microwave_table", "NextStep", {"control_mode": "joint_delta", **LAYOUT}),
    ("kitchens", "SameStep", {"control_mode": "joint_position", "variations": ["start", "dynamics"]}),
]


@pytest.mark.full
@pytest.mark.parametrize(("domain", "autoreset", "settings"), CASES)
def test_vectorised_environments_equal_single_ones_to_the_bit(domain, autoreset, settings):
    assert autoreset in MODES
    settings = {"physics": "fast", "max_episode_steps": 9, **settings}
    ours, theirs = pair(IDS[domain], autoreset, **settings)
    env = gymnasium.make(IDS[domain], **settings).unwrapped
    assert sum(assert_equal_for_ever(ours, theirs, walk(env.environment.action_spec(), 24, COUNT))) >= 2


@pytest.mark.full
def test_a_state_is_restored_in_the_middle_of_an_episode_with_another_layout():
    first, second = (load(physics="fast", **LAYOUT) for _ in range(2))
    actions = np.random.default_rng(0).uniform(-1, 1, (40, 9))
    second.random_state = 7
    for environment, count in ((first, 20), (second, 3)):
        environment.reset()
        for action in actions[:count]:
            environment.step(action)
    second.set_state(first.get_state())
    np.testing.assert_array_equal(second.physics.data.geom_xpos, first.physics.data.geom_xpos)
    for action in actions[20:]:
        ours, theirs = (environment.step(action).observation for environment in (second, first))
        for name, value in theirs.items():
            np.testing.assert_array_equal(ours[name], value)


@pytest.mark.full
def test_infos_name_it_and_those_of_the_exact_physics_do_not():
    # The environments of generated kitchens are fast by default.
    for env_id, options in zip(IDS.values(), ({}, {}, {"physics": "exact"}), strict=True):
        fast, exact = (gymnasium.make(env_id, **each) for each in ({"physics": "fast"}, options))
        assert fast.reset(seed=0)[1]["physics"] == "fast"
        assert fast.step(fast.action_space.sample())[-1]["physics"] == "fast"
        assert "physics" not in exact.reset(seed=0)[1]
        assert "physics" not in exact.step(exact.action_space.sample())[-1]
        vector = gymnasium.make_vec(env_id, 2, vectorization_mode="vector_entry_point", physics="fast")
        assert vector.reset(seed=0)[1]["physics"].tolist() == ["fast", "fast"]
        assert vector.step(vector.action_space.sample())[-1]["physics"].tolist() == ["fast", "fast"]


@pytest.mark.full
def test_states_of_the_other_physics_are_refused():
    fast, exact = load(physics="fast"), load()
    fast.reset(), exact.reset()
    for environment, other in ((fast, exact), (exact, fast)):
        before = environment.get_state()
        with pytest.raises(ValueError, match=r"'exact'.*'fast'|'fast'.*'exact'"):
            environment.set_state(other.get_state())
        np.testing.assert_array_equal(environment.get_state()["physics"], before["physics"])


def test_a_state_with_a_damaged_record_of_what_sleeps_is_refused():
    environment = load(physics="fast")
    environment.reset()
    for _ in range(30):
        environment.step(np.zeros(9))
    state = environment.get_state()
    assert (state["asleep"] >= 0).any()
    for value in (5000, -5000, int(state["asleep"].max())):
        damaged = state["asleep"].copy()
        damaged[0] = value
        with pytest.raises(ValueError, match="asleep"):
            environment.set_state({**state, "asleep": damaged})
    environment.set_state(state)


@pytest.mark.parametrize("sleep", [True, False])
def test_sleep_beside_it_is_refused(sleep):
    with pytest.raises(ValueError, match="leave out sleep"):
        load(physics="fast", sleep=sleep)


@pytest.mark.full
def test_a_scene_without_it_says_so():
    for make in (
        lambda: load("open_cabinet", physics="fast"),
        lambda: gymnasium.make("kitchen_suite:KitchenSuite/TopDrawer-v1", physics="fast"),
        lambda: EnvironmentSpec.make("open_cabinet", None, {"physics": "fast"}).make_vector_env(2, 1),
    ):
        with pytest.raises(ValueError, match=r"^open_cabinet has no fast physics: leave out physics$"):
            make()
    # As the message says.
    load("open_cabinet").close()
    with pytest.raises(ValueError, match=r"'slow'.*'exact'"):
        load(physics="slow")


@pytest.mark.full
def test_rollouts_and_recordings_name_it_and_replay(run, folder):
    arguments = ("--domain_name=kitchen", "--task_name=kettle", "--physics=fast", "--num_episodes=2")
    status, output, _ = run(rollout, *arguments, "--policy=expert")
    assert (status, "fast physics" in output) == (0, True)
    recorded = ("--output=recorded", "--max_episode_steps=12", "--policy=expert")
    assert run(record, *arguments, *recorded)[0] == 0
    assert run(convert, "recorded", "--dataset=kitchen-suite/fast-v0")[0] == 0
    status, output, _ = run(replay, "recorded")
    assert (status, "2 of 2" in output) == (0, True)
    [metadata] = folder.glob("datasets/**/metadata.json")
    assert "fast" in json.dumps(json.loads(metadata.read_text()))
