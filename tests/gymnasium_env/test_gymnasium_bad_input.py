"""Odd arguments, actions, options and states: a clear error or valid behaviour, and the environment works on."""

import copy

import gymnasium
import numpy as np
import pytest
from helpers.errors import ODD_VALUES, assert_is_short, refused
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from kitchen_suite import suite
from kitchen_suite.gymnasium_env import KITCHEN_ID, FrankaKitchenEnv
from kitchen_suite.gymnasium_env.base import STATE
from kitchen_suite.tasks import GOALS
from kitchen_suite.tasks.orders import REQUESTED
from kitchen_suite.tasks.requests import VARIATION, VARIATION_VALUES

junk = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-(2**70), 2**70),
    st.floats(),
    st.text(max_size=8),
    st.binary(max_size=4),
    st.lists(st.floats(), max_size=10),
    st.dictionaries(st.text(max_size=4), st.floats(), max_size=2),
    st.complex_numbers(),
    st.just(object()),
    st.sampled_from([*ODD_VALUES]).map(lambda name: ODD_VALUES[name]),
)
numbers = hnp.arrays(
    st.sampled_from([np.float64, np.float32, np.int64, np.uint8, np.bool_, np.complex128]),
    hnp.array_shapes(min_dims=0, max_dims=2, max_side=10),
)
nine = hnp.arrays(st.sampled_from([np.float64, np.float32]), (9,), elements=st.floats(-3, 3, width=32))


def cases(count):
    return settings(
        max_examples=count, deadline=None, derandomize=True, database=None, suppress_health_check=list(HealthCheck)
    )


@pytest.fixture(scope="module")
def env():
    env = FrankaKitchenEnv(["kettle", "microwave"])
    env.reset(seed=0)
    return env


def attempt(function, *args, **kwargs):
    """Whether the call went well; if not, it must have raised one of the two errors, with words."""
    complaint = None
    try:
        function(*args, **kwargs)
    except (ValueError, TypeError) as error:
        complaint = str(error)
    if complaint is not None:
        assert len(complaint) > 10
        assert_is_short(complaint)
    return complaint is None


def assert_works_on(env):
    observation, reward, terminated, truncated, info = env.step(np.zeros(9))
    assert np.isfinite(observation["observation"]).all()
    assert env.observation_space.contains(observation)
    assert (reward, terminated, truncated) == (0.0, False, False)
    assert info["tasks_to_complete"] == ["kettle", "microwave"]


def check_action(env, action):
    before = env.get_state()
    if not attempt(env.step, action):
        after = env.get_state()
        np.testing.assert_array_equal(after["physics"], before["physics"])
        assert after["step_count"] == before["step_count"]
    else:
        assert np.shape(action) == (9,)
        env.reset()
    assert_works_on(env)


some_action = given(action=st.one_of(junk, numbers, nine))
test_actions = cases(20)(some_action(check_action))
test_many_actions = pytest.mark.nightly(cases(800)(some_action(check_action)))


some_reset = given(
    seed=st.one_of(st.none(), st.integers(-5, 2**80), junk),
    options=st.one_of(st.none(), st.just({}), st.dictionaries(st.sampled_from(["state", "stat", "x"]), junk), junk),
)


def check_reset(env, seed, options):
    attempt(env.reset, seed=seed, options=options)
    assert_works_on(env)


test_resets = cases(40)(some_reset(check_reset))
test_many_resets = pytest.mark.nightly(cases(600)(some_reset(check_reset)))


def test_options_of_other_libraries_are_ignored(env):
    options = {"lerobot_new_rollout": True, "low": -1.0}
    np.testing.assert_equal(env.reset(seed=4, options=options), env.reset(seed=4))
    state = env.get_state()
    env.step(np.ones(9))
    env.reset(options={**options, "state": state})
    np.testing.assert_equal(env.get_state(), state)
    assert_works_on(env)


@pytest.mark.parametrize(
    ("options", "error", "shown"),
    [
        ({"stat": {}}, ValueError, ["'stat'", "'state'"]),
        ({"variatons": []}, ValueError, ["'variatons'", "'variation'"]),
        ({"reset_mask": np.array([True])}, ValueError, ["'reset_mask'"]),
        ({"low": 0, "request_tasks": []}, ValueError, ["'requested_tasks'"]),
    ],
)
def test_misspelt_reset_options_are_refused_and_change_nothing(env, options, error, shown):
    env.reset(seed=4)
    before = env.get_state()
    with refused(error, *shown):
        env.reset(seed=5, options=options)
    np.testing.assert_equal(env.get_state(), before)


@pytest.mark.full
@pytest.mark.parametrize("name", [STATE, VARIATION, VARIATION_VALUES, REQUESTED])
def test_options_of_any_size_and_depth_are_refused_in_one_short_line(name):
    env = FrankaKitchenEnv(["kettle", "microwave"], variations=["start", "dynamics"], tasks_per_episode=1)
    for value in ODD_VALUES.values():
        assert not attempt(env.reset, options={name: value})
    assert env.reset(seed=0, options={name: None})


def mutations(state):
    """Ways to spoil a state: keys removed, added or replaced, at any depth."""

    def paths(node, prefix=()):
        for key, value in node.items():
            yield (*prefix, key)
            if isinstance(value, dict):
                yield from paths(value, (*prefix, key))

    return st.tuples(st.sampled_from(sorted(paths(state), key=str)), st.sampled_from(["remove", "replace", "add"]))


def check_state(env, data):
    env.reset(seed=1)
    env.step(np.ones(9))
    good = env.get_state()
    path, how = data.draw(mutations(good))
    bad = copy.deepcopy(good)
    node = bad
    for key in path[:-1]:
        node = node[key]
    if how == "remove":
        del node[path[-1]]
    else:
        node[path[-1] if how == "replace" else data.draw(st.text(max_size=4))] = data.draw(st.one_of(junk, numbers))
    if not attempt(env.set_state, bad):
        np.testing.assert_array_equal(env.get_state()["physics"], good["physics"])
        assert_same_random(env.get_state(), good)
    env.set_state(good)
    assert_works_on(env)


some_state = given(data=st.data())
test_states = cases(20)(some_state(check_state))
test_many_states = pytest.mark.nightly(cases(600)(some_state(check_state)))


def assert_same_random(one, other):
    assert str(one["random"]) == str(other["random"])


ratios = st.one_of(st.floats(0, 1), junk)
flags = st.one_of(st.booleans(), junk)
arguments = st.fixed_dictionaries(
    {},
    optional={
        "tasks_to_complete": st.one_of(
            st.lists(st.sampled_from([*GOALS, "bottom_burner", "toaster"]), max_size=4), st.sampled_from([*GOALS]), junk
        ),
        "terminate_on_tasks_completed": flags,
        "remove_task_when_completed": flags,
        "object_noise_ratio": ratios,
        "robot_noise_ratio": ratios,
        "velocity_scale": ratios,
        "threshold": st.one_of(ratios, st.dictionaries(st.sampled_from([*GOALS]), ratios, max_size=2)),
        "success": st.one_of(st.sampled_from(["original", "strict", "loose"]), junk),
        "reward": st.one_of(st.sampled_from(["sparse", "dense", "dense_gain", "shaped"]), junk),
        "goals": st.one_of(st.dictionaries(st.sampled_from([*GOALS]), numbers, max_size=2), junk),
        "feedback": st.one_of(st.sampled_from(["observed", "true", "target", "seen"]), junk),
        "goal_format": st.one_of(st.sampled_from(["dict", "flat", "list"]), junk),
        "info_format": st.one_of(st.sampled_from(["lists", "arrays", "array"]), junk),
        "instructions": st.one_of(st.booleans(), junk),
        "max_episode_steps": st.one_of(st.integers(-2, 500), junk),
        "render_mode": st.one_of(st.none(), st.just("rgb_arry"), junk),
        "width": st.one_of(st.integers(-1, 640), junk),
        "camera_id": st.one_of(st.integers(-3, 9), junk),
        "camera_name": st.one_of(st.none(), st.sampled_from(["left", "lef"]), junk),
        "default_camera_config": st.one_of(st.none(), junk),
        "visuals": st.one_of(st.none(), st.booleans(), junk),
        "colour": junk,
    },
)


def check_arguments(arguments):
    built = []
    if attempt(lambda: built.append(FrankaKitchenEnv(**arguments))):
        env = built[0]
        observation, info = env.reset(seed=0)
        assert env.observation_space.contains(observation)
        assert env.step(np.zeros(9))[0]["observation"].shape == (59,)
        assert info["tasks_to_complete_mask"].all()


some_arguments = given(arguments=arguments)
test_arguments = cases(10)(some_arguments(check_arguments))
test_many_arguments = pytest.mark.nightly(cases(200)(some_arguments(check_arguments)))


def check_load(argument, value):
    domain_name, name = argument
    attempt(suite.load, domain_name, suite.default_task(domain_name), {"visuals": False, name: value})


arguments_of_tasks = [
    (domain.name, name)
    for domain in suite.DOMAINS.values()
    for name, argument in domain.arguments().items()
    if argument.owner != "environment"
]
some_load = given(argument=st.sampled_from(arguments_of_tasks), value=st.one_of(junk, st.sampled_from([1e155, 1e308])))
test_load = cases(5)(some_load(check_load))
test_many_loads = pytest.mark.full(cases(200)(some_load(check_load)))


def test_arguments_of_any_depth_are_refused_in_one_short_line():
    for name in ("variations", "tasks_to_complete", "tasks_per_episode", "tasks_in_turn", "max_task_steps", "width"):
        with refused(ValueError, name) as raised:
            gymnasium.make(KITCHEN_ID, **{name: ODD_VALUES["nested"]})
        assert_is_short(str(raised.value))


@pytest.mark.parametrize("value", [(name for name in ["kettle"]), {"kettle": 1}.keys()], ids=["generator", "keys"])
def test_arguments_that_cannot_be_copied_are_refused_in_one_short_line(value):
    with refused(TypeError, "an argument cannot be copied", "tasks_to_complete") as raised:
        gymnasium.make(KITCHEN_ID, tasks_to_complete=value)
    assert_is_short(str(raised.value).partition(" was raised from the environment creator")[0])


@pytest.mark.parametrize("name", ["width", "height", "max_geom"])
def test_pictures_too_large_for_any_gl_library_are_refused_with_the_greatest_size(name):
    with refused(ValueError, name, "at most", "1000000000"):
        gymnasium.make(KITCHEN_ID, render_mode="rgb_array", **{name: 10**9})


def test_unknown_arguments_reach_make_as_a_clear_error():
    with pytest.raises(TypeError, match="colour"):
        gymnasium.make(KITCHEN_ID, colour="red")
