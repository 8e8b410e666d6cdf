"""`control_timestep`: another length of the control step, in every domain and front end, and by name where it is."""

import copy
import json

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from helpers.comparisons import assert_same
from helpers.errors import refused
from helpers.kitchen import POSITION_HIGH, POSITION_LOW
from helpers.sweeps import CASES, brief, walk

from kitchen_suite import policies, suite

# By domain: length of a physics step, the default control step, and another one [s].
STEPS = {
    "kitchen": (0.002, 0.08, 0.04),
    "kitchens": (0.08 / 6, 0.08, 0.04),
    "pick_and_place": (0.008, 0.08, 0.04),
    "open_cabinet": (0.005, 0.01, 0.025),
    "microwave_table": (0.005, 0.01, 0.025),
}
DOMAINS = [*STEPS]


def env_id(domain):
    return suite.DOMAINS[domain].env_id


def make(domain, **options):
    return gymnasium.make(env_id(domain), **{"control_timestep": STEPS[domain][2], **options})


def make_vec(domain, count=3, **options):
    options = {"control_timestep": STEPS[domain][2], "num_threads": 1, **options}
    return gymnasium.make_vec(env_id(domain), count, vectorization_mode="vector_entry_point", **options)


def load(domain, environment_kwargs=None, **options):
    options = {"random": 0, "control_timestep": STEPS[domain][2], "visuals": False, **options}
    return suite.load(domain, suite.default_task(domain), options, environment_kwargs)


def actions_of(env, count):
    spec = env.unwrapped.environment.action_spec()
    return walk(spec, count).astype(np.float32)


@pytest.mark.full
@pytest.mark.parametrize("domain", DOMAINS)
def test_a_control_step_takes_this_long(domain):
    physics_step, _, step = STEPS[domain]
    env, environment, envs = make(domain), load(domain), make_vec(domain)
    assert envs.metadata["render_fps"] == env.metadata["render_fps"] == pytest.approx(1 / step)
    env.reset(seed=0)
    start = env.unwrapped.environment.physics.time()
    for action in actions_of(env, 3):
        env.step(action)
    assert env.unwrapped.environment.physics.time() - start == pytest.approx(3 * step)
    assert environment.control_timestep() == step
    assert environment.task.physics_steps_per_control_step == round(step / physics_step)


@pytest.mark.full
@pytest.mark.parametrize("domain", DOMAINS)
def test_limits_are_of_as_many_steps_or_of_the_seconds_that_are_given(domain):
    step, default = STEPS[domain][2], suite.DOMAINS[domain].episode_steps
    assert load(domain).step_limit == default
    assert gymnasium.make(env_id(domain), control_timestep=step).spec.max_episode_steps == default
    assert load(domain, time_limit=0.5).step_limit == round(np.ceil(0.5 / step))
    env = make(domain, max_episode_steps=4)
    env.reset(seed=0)
    assert [env.step(action)[3] for action in actions_of(env, 4)] == [False, False, False, True]


@pytest.mark.full
@pytest.mark.parametrize("domain", ["kitchen", "kitchens", "pick_and_place"])
def test_targets_of_velocities_follow(domain):
    env = make(domain, feedback="true").unwrapped
    env.reset(seed=0)
    robot, action = env.environment.task.robot, np.linspace(-1.0, 1.0, 9)
    for _ in range(3):
        before = np.array(env.environment.physics.bind(robot.joints).qpos)
        env.step(action)
        expected = np.clip(before + 2.0 * action * STEPS[domain][2], POSITION_LOW, POSITION_HIGH)
        np.testing.assert_array_equal(env.environment.physics.bind(robot.actuators).ctrl, expected)


@pytest.mark.full
def test_the_greatest_distance_of_position_targets_follows():
    env = make("kitchen", control_mode="joint_position", feedback="true").unwrapped
    env.reset(seed=0)
    robot = env.environment.task.robot
    before = np.array(env.environment.physics.bind(robot.joints).qpos)
    env.step(np.full(9, 9.0))
    expected = np.clip(before + 10.0 * STEPS["kitchen"][2], POSITION_LOW, POSITION_HIGH)
    np.testing.assert_allclose(env.environment.physics.bind(robot.actuators).ctrl, expected, rtol=0, atol=1e-12)


@pytest.mark.full
@pytest.mark.parametrize("domain", DOMAINS)
def test_the_same_commanded_motion_takes_the_same_time(domain):
    # Joint speeds of 0.5 rad/s for 0.4 s, whatever the control step.
    moved = []
    for step in STEPS[domain][1:]:
        environment = load(domain, control_mode="joint_delta", control_timestep=step)
        environment.reset()
        joints = environment.task.robot.joints[:7]
        start = np.array(environment.physics.bind(joints).qpos)
        for _ in range(round(0.4 / step)):
            environment.step(np.append(np.full(7, 0.5), -1.0))
        moved.append(np.array(environment.physics.bind(joints).qpos) - start)
    assert np.median(moved[0]) > 0.1
    np.testing.assert_allclose(moved[0], moved[1], rtol=0, atol=0.05)


@pytest.mark.full
@pytest.mark.parametrize(("domain", "mode"), brief(CASES, [(d, m) for d, m in CASES if m.startswith("joint_")][::2]))
def test_vectorised_environments_are_the_single_one(domain, mode):
    options = {"control_mode": mode, "max_episode_steps": 3, "control_timestep": STEPS[domain][2]}
    settings = {"vector_kwargs": {"autoreset_mode": AutoresetMode.SAME_STEP}}
    single = gymnasium.make_vec(env_id(domain), 3, vectorization_mode="sync", **settings, **options)
    many = make_vec(domain, autoreset_mode=AutoresetMode.SAME_STEP, **options)
    assert_same(single.reset(seed=3), many.reset(seed=3))
    spec = single.unwrapped.envs[0].unwrapped.environment.action_spec()
    for actions in walk(spec, 8, 3).astype(np.float32):
        assert_same(single.step(actions), many.step(actions))


@pytest.mark.full
@pytest.mark.parametrize("domain", DOMAINS)
def test_front_ends_play_the_same_episode(domain):
    env, environment = make(domain), load(domain)
    env.reset(seed=0)
    environment.random_state = np.random.RandomState(gymnasium.utils.seeding.np_random(0)[0].bit_generator)
    environment.reset()
    for action in actions_of(env, 4):
        env.step(action)
        environment.step(action)
    one, other = (each.physics.data.qpos for each in (env.unwrapped.environment, environment))
    np.testing.assert_array_equal(one, other)


@pytest.mark.full
@pytest.mark.parametrize("domain", DOMAINS)
def test_the_default_by_its_number_is_the_default(domain):
    given, omitted = make(domain, control_timestep=STEPS[domain][1]), make(domain, control_timestep=None)
    assert_same(given.reset(seed=0), omitted.reset(seed=0))
    for action in actions_of(given, 3):
        one = given.step(action)
        assert_same(one, omitted.step(action))
    assert "control_timestep" not in one[-1]
    assert "control_timestep" not in given.unwrapped.get_state()
    envs = make_vec(domain, control_timestep=STEPS[domain][1])
    assert "control_timestep" not in envs.reset(seed=0)[1]


@pytest.mark.full
@pytest.mark.parametrize("domain", DOMAINS)
def test_infos_name_it_where_it_is_not_the_default(domain):
    step = STEPS[domain][2]
    env, envs = make(domain, **suite.DOMAINS[domain].env_class.array_options), make_vec(domain)
    for info in (env.reset(seed=0)[1], env.step(actions_of(env, 1)[0])[-1]):
        assert info["control_timestep"].shape == ()
        assert info["control_timestep"].dtype == np.float64
        assert info["control_timestep"] == step
    for infos in (envs.reset(seed=0)[1], envs.step(np.zeros(envs.action_space.shape))[-1]):
        np.testing.assert_array_equal(infos["control_timestep"], [step] * 3)
        assert infos["_control_timestep"].all()


def test_infos_of_lists_have_a_number():
    info = make("kitchen").reset(seed=0)[1]
    assert type(info["control_timestep"]) is float
    json.dumps(info["control_timestep"])


@pytest.mark.full
@pytest.mark.parametrize("domain", DOMAINS)
def test_states_of_other_control_steps_are_refused(domain):
    default, step = STEPS[domain][1:]
    changed, plain = make(domain).unwrapped, make(domain, control_timestep=None).unwrapped
    changed.reset(seed=0)
    plain.reset(seed=0)
    for env, other in ((changed, plain), (plain, changed)):
        before = env.get_state()
        with refused(ValueError, f"{default:g} s", f"{step:g} s"):
            env.set_state(other.get_state())
        assert_same(env.get_state(), before)
    with refused(ValueError, f"{default:g} s", f"{step:g} s"):
        load(domain).set_state(load(domain, control_timestep=None).get_state())


@pytest.mark.full
@pytest.mark.parametrize("domain", DOMAINS)
def test_copies_keep_it(domain):
    env = make(domain).unwrapped
    env.reset(seed=0)
    actions = actions_of(env, 6)
    for action in actions[:3]:
        env.step(action)
    other = copy.deepcopy(env)
    for action in actions[3:]:
        assert_same(env.step(action), other.step(action))


@pytest.mark.parametrize("domain", DOMAINS)
def test_bad_values_are_refused(domain):
    physics_step = STEPS[domain][0]
    # No whole number of physics steps, less than one, none, an hour.
    broken = 2.5 * physics_step
    values = [(load, value) for value in (broken, 0.01 * physics_step, 0.0, 3600.0)]
    for build, value in (*values, (make, broken), (make_vec, broken)):
        with refused(ValueError, "control_timestep", repr(value)):
            build(domain, control_timestep=value)


@pytest.mark.full
@pytest.mark.parametrize("domain", DOMAINS)
def test_the_nearest_length_that_the_error_names_is_accepted(domain):
    physics_step = STEPS[domain][0]
    with refused(ValueError, f"{physics_step:g} s") as raised:
        load(domain, control_timestep=3.4 * physics_step)
    nearest = float(str(raised.value).rpartition(" ")[2])
    assert load(domain, control_timestep=nearest).task.physics_steps_per_control_step == 3


def test_in_fast_physics_its_steps_count():
    assert load("kitchen", physics="fast").task.physics_steps_per_control_step == 3
    with refused(ValueError, "0.0133333", "0.02"):
        load("kitchen", physics="fast", control_timestep=0.02)


def test_composers_own_number_of_substeps_is_refused_beside_it():
    with refused(ValueError, "control_timestep", "n_sub_steps"):
        load("kitchen", {"n_sub_steps": 10})


@pytest.mark.full
@pytest.mark.parametrize("domain", DOMAINS)
def test_the_expert_says_that_it_acts_at_the_default_and_leaving_it_out_helps(domain):
    with refused(ValueError, f"{STEPS[domain][1]:g} s", f"{STEPS[domain][2]:g} s", "leave out control_timestep"):
        policies.find("expert")(load(domain), np.random.default_rng(0))
    policies.find("expert")(load(domain, control_timestep=None), np.random.default_rng(0))
