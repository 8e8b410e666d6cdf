"""Variations of the Gymnasium environments: arguments, infos, spaces, options of resets, states and copies."""

import copy
import pickle
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from helpers.comparisons import assert_same
from helpers.errors import refused
from helpers.sweeps import brief, groups_of

from kitchen_suite import suite
from kitchen_suite.gymnasium_env import FrankaKitchenEnv
from kitchen_suite.tasks.variations.distributions import SPLITS

pytestmark = pytest.mark.full

# The parameters of each group that are looked at, in every domain.
EXAMPLES = {
    "kitchen": ["kettle/pose", "microwave/yaw", "kettle/mass", "sensing/robot_noise"],
    "open_cabinet": ["cabinet/door_left", "cabinet/yaw", "franka/pad_friction", "sensing/action_delay"],
    "microwave_table": ["microwave/door", "microwave/yaw", "franka/gain_scale", "sensing/action_delay"],
    "kitchens": ["franka/joint_offset", "franka/damping_scale", "fixtures/damping_scale", "sensing/action_delay"],
    "pick_and_place": ["objects/displacement", "objects/mass_scale", "franka/damping_scale", "sensing/action_delay"],
}
STEPS = 4
# In the layouts held out of the kitchen, two draws of the last one are refused.
SEEDS = (0, 5, 34)

each_domain = pytest.mark.parametrize("domain", suite.DOMAINS)


def plain(domain, **settings):
    return suite.DOMAINS[domain].env_class(**settings)


def make(domain, variations=None, **settings):
    """An environment in which the groups vary that are given, or else all."""
    return plain(domain, variations=groups_of(domain) if variations is None else variations, **settings)


@pytest.fixture(scope="module")
def envs():
    """One environment of each domain with all groups, for tests that begin with a seed."""
    return {domain: make(domain) for domain in suite.DOMAINS}


def play(env, seed=3, options=None, steps=STEPS):
    """Returns all that a reset and some steps return."""
    generator = np.random.default_rng(seed)
    played = [env.reset(seed=seed, options=options)]
    for _ in range(steps):
        played.append(env.step(generator.uniform(-0.5, 0.5, env.action_space.shape)))
    return played


def assert_equal_states(one, other):
    # With the random stream, which has strings.
    np.testing.assert_equal(one.get_state(), other.get_state())


@each_domain
def test_without_variations_no_key_is_added_and_nothing_is_drawn(domain):
    default, empty = plain(domain), plain(domain, variations=())
    assert_same(play(default), play(empty))
    assert_equal_states(default, empty)
    for _, *_, info in play(empty, steps=1):
        assert not {"variation_values", "variation_split", "layout_refusals"} & info.keys()
    assert "variation_values" not in empty.get_state()["task"]
    assert empty.variation_space == gymnasium.spaces.Dict()
    assert (empty.variation_values, empty.variation_split) == ({}, "seen")


@each_domain
def test_every_info_holds_the_values_in_arrays_of_fixed_shape(envs, domain):
    env = envs[domain]
    played = play(env)
    first = played[0][-1]["variation_values"]
    assert first.keys() >= {*EXAMPLES[domain]}
    for *_, info in played:
        assert ("layout_refusals" in info) == ("layout" in groups_of(domain))
        assert info.get("layout_refusals", np.array(0)).shape == ()
        assert_same(info["variation_values"], first)
    for name, value in first.items():
        assert isinstance(value, np.ndarray)
        assert value.dtype == np.float64
        assert value.shape == env.variation_space[name].shape
    # They are fresh.
    first[EXAMPLES[domain][0]][...] = 0.0
    assert env.variation_values[EXAMPLES[domain][0]].any()
    _, other = env.reset(seed=4)
    assert {name for name, value in other["variation_values"].items() if np.shape(value) != first[name].shape} == set()
    assert not np.array_equal(other["variation_values"][EXAMPLES[domain][2]], first[EXAMPLES[domain][2]])


def test_infos_of_arrays_hold_arrays_only_and_those_of_lists_name_the_split():
    lists, arrays = (make("kitchen", variation_split="held_out", info_format=form) for form in ("lists", "arrays"))
    (_, of_lists), (_, of_arrays) = (env.reset(seed=2) for env in (lists, arrays))
    assert of_lists["variation_split"] == "held_out"
    assert_same(of_lists["variation_values"], of_arrays["variation_values"])
    leaves = [*of_arrays.pop("variation_values").values(), *of_arrays.values()]
    assert all(isinstance(leaf, np.ndarray) for leaf in leaves)


@each_domain
@pytest.mark.parametrize("split", brief(SPLITS, ["held_out"]))
def test_the_space_contains_the_values_of_every_reset(domain, split):
    env = make(domain, variation_split=split)
    space, drawn = env.variation_space, []
    assert isinstance(space, gymnasium.spaces.Dict)
    assert set(space) == set(env.variation_values)
    for seed in range(8):
        _, info = env.reset(seed=seed)
        assert info["variation_values"] in space
        drawn.append(info["variation_values"][EXAMPLES[domain][2]])
    assert len(np.unique(drawn)) == 8
    assert env.variation_split == split
    # The space is that of both splits, and also of values given back.
    assert space == make(domain).variation_space


@each_domain
def test_a_sample_of_the_space_can_be_given_as_values(domain):
    env = make(domain, variations=["start", "dynamics"])
    space = env.variation_space
    space.seed(0)
    sample = space.sample()
    _, info = env.reset(seed=0, options={"variation_values": sample})
    different = [name for name, value in info["variation_values"].items() if not np.array_equal(value, sample[name])]
    # What would start nearly complete starts as by default.
    owners = {name.partition("/")[0] for name in different}
    assert (
        owners <= {"oven", "hood", "slide_cabinet", "hinge_cabinet", "microwave", "kettle"}
        if domain == "kitchen"
        else not owners
    )


def assert_given_back(domain, split, seeds):
    """Repeats episodes with the values in their infos; returns the numbers of refused layouts."""
    env, again = make(domain, variation_split=split), make(domain, variation_split=split)
    refusals = []
    for seed in seeds:
        played = play(env, seed, steps=2)
        values = played[0][1]["variation_values"]
        refusals.append(int(played[0][1].get("layout_refusals", 0)))
        assert_same(play(again, seed, {"variation_values": values}, steps=2), played)
        assert_equal_states(again, env)
        # In nested dicts, as a recording keeps them.
        nested = {}
        for name, value in values.items():
            owner, _, rest = name.partition("/")
            nested.setdefault(owner, {})[rest] = value
        assert_same(again.reset(seed=seed, options={"variation_values": nested}), played[0])
        env.reset(seed=seed)
        # The next episode draws again.
        assert_same(again.reset(), env.reset())
        again.environment.task.reset_statistics(), env.environment.task.reset_statistics()
    return refusals


@pytest.mark.parametrize(
    ("domain", "split", "seeds"),
    [
        ("kitchen", "held_out", SEEDS),
        ("open_cabinet", "seen", (0, 1)),
        ("microwave_table", "held_out", (0, 1)),
        ("kitchens", "seen", (0,)),
        ("pick_and_place", "held_out", (0,)),
    ],
)
def test_values_given_back_repeat_the_episode_to_the_bit(domain, split, seeds):
    refusals = assert_given_back(domain, split, seeds)
    # Also where the first layouts were refused.
    assert domain != "kitchen" or max(refusals) > 1


@pytest.mark.nightly
@pytest.mark.parametrize("split", SPLITS)
@each_domain
def test_values_of_many_episodes_given_back_repeat_them(domain, split):
    assert_given_back(domain, split, range(100))


def test_given_values_are_those_of_one_episode(envs):
    env = envs["kitchen"]
    drawn = env.reset(seed=5)[1]["variation_values"]
    _, info = env.reset(seed=5, options={"variation_values": {"kettle": {"mass": 1.0}, "franka/gain_scale": 1.1}})
    given = info["variation_values"]
    assert (given.pop("kettle/mass"), given.pop("franka/gain_scale")) == (1.0, 1.1)
    assert_same(given, {name: drawn[name] for name in given})
    assert env.reset(seed=5)[1]["variation_values"]["kettle/mass"] == drawn["kettle/mass"]


def test_an_option_names_what_varies_in_one_episode(envs):
    env = envs["kitchen"]
    defaults = env.environment.task.variations.randomizer.defaults
    drawn = env.reset(seed=6)[1]["variation_values"]
    for names, groups in (([], set()), ("dynamics", {"dynamics"}), (["dynamics", "layout"], {"dynamics", "layout"})):
        _, info = env.reset(seed=6, options={"variation": names})
        for name, value in info["variation_values"].items():
            varies = env.environment.task.variations.by_name[name].group in groups
            np.testing.assert_array_equal(value, (drawn if varies else defaults)[name], name)
    _, info = env.reset(seed=6, options={"variation": "kettle/mass,kettle/pose"})
    differing = {name for name, value in info["variation_values"].items() if not np.array_equal(value, defaults[name])}
    assert differing == {"kettle/mass", "kettle/pose"}
    assert_same(env.reset(seed=6)[1]["variation_values"], drawn)


@pytest.mark.parametrize(
    ("options", "error", "shown"),
    [
        ({"variation": ["strat"]}, ValueError, ["'strat'"]),
        ({"variation": 3}, TypeError, ["variation", "3"]),
        ({"variation_values": 3}, TypeError, ["variation_values", "3"]),
        ({"variation_values": {"kettle": {"mas": 1.0}}}, ValueError, ["'kettle/mass'"]),
        ({"variation_values": {"kettle": 1.0}}, ValueError, ["variation_values", "'kettle'"]),
        ({"variation_values": {"kettle/mass": 3.0}}, ValueError, ["kettle/mass", "0.4", "1.5", "3.0"]),
        ({"variation_values": {"kettle/mass": [1.0, 1.0]}}, ValueError, ["kettle/mass"]),
        ({"variation_values": {"kettle/pose": 0.0}}, ValueError, ["kettle/pose", "(3,)"]),
        ({"variation_values": {"kettle/mass": None}}, TypeError, ["kettle/mass"]),
        ({"variation_values": {"kettle/pose": [0, 0, np.inf]}}, ValueError, ["finite"]),
        ({"variation_values": {"kettle/burner": 0.5}}, ValueError, ["kettle/burner"]),
        ({"variations": ["start"]}, ValueError, ["'variations'"]),
    ],
)
def test_bad_options_are_refused_and_change_nothing(envs, options, error, shown):
    env = envs["kitchen"]
    env.reset(seed=1)
    env.step(np.full(9, 0.2))
    before = env.get_state()
    with refused(error, *shown):
        env.reset(seed=2, options=options)
    np.testing.assert_equal(env.get_state(), before)
    # Nor the next reset.
    after = env.reset()
    env.set_state(before)
    assert_same(env.reset(), after)


@each_domain
def test_options_of_variations_need_variations(domain):
    env = plain(domain)
    for options in ({"variation": ["start"]}, {"variation_values": {"franka/gain_scale": 1.0}}):
        with pytest.raises(ValueError, match="build the environment with variations"):
            env.reset(options=options)
    env.reset(options={"variation": [], "variation_values": {}})


def test_a_state_has_its_own_values(envs):
    env = envs["microwave_table"]
    env.reset(seed=0)
    state = env.get_state()
    for options in ({"variation": "start"}, {"variation_values": {"microwave/door": -0.1}}):
        with refused(ValueError, "variation_values"):
            env.reset(options={"state": state, **options})
    np.testing.assert_equal(env.get_state(), state)
    env.reset(seed=8)
    _, info = env.reset(options={"state": state})
    assert_same(info["variation_values"], state["task"]["variation_values"])


@pytest.mark.parametrize(
    ("settings", "error", "shown"),
    [
        ({"variations": "strat"}, ValueError, ["'start'"]),
        ({"variations": {"kettle/mass": {"unifrom": [0, 1]}}}, ValueError, ["'uniform'"]),
        ({"variations": "start", "variation_split": "test"}, ValueError, ["variation_split", "'test'"]),
        ({"variation": "start"}, TypeError, ["variations"]),
    ],
)
def test_bad_arguments_are_refused(settings, error, shown):
    with refused(error, *shown):
        FrankaKitchenEnv(**settings)


@each_domain
@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))], ids=["copy", "pickle"])
def test_copies_go_on_with_the_values_of_the_original(envs, domain, copied):
    env = envs[domain]
    play(env, seed=9)
    other = copied(env)
    assert_same(other.variation_values, env.variation_values)
    for _ in range(3):
        action = np.full(env.action_space.shape, 0.1)
        assert_same(other.step(action), env.step(action))
    assert_same(other.reset(), env.reset())
    assert_equal_states(other, env)


@each_domain
def test_a_state_continues_in_another_environment(envs, domain):
    env, other = envs[domain], make(domain)
    play(env, seed=10)
    play(other, seed=11, steps=1)
    other.set_state(env.get_state())
    for _ in range(3):
        action = np.full(env.action_space.shape, -0.1)
        assert_same(other.step(action), env.step(action))
    assert_same(other.reset(), env.reset())


def test_a_state_of_other_variations_does_not_fit(envs):
    state = make("kitchen", "start").get_state()
    for other in (envs["kitchen"], FrankaKitchenEnv(), make("kitchen", "dynamics")):
        before = other.get_state()
        with refused(ValueError, "differs in variations"):
            other.set_state(state)
        np.testing.assert_equal(other.get_state(), before)


@each_domain
def test_gymnasiums_checker_has_nothing_to_say_about_variations(domain):
    env = gymnasium.make(suite.DOMAINS[domain].env_id, variations=groups_of(domain))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        # Not the renderings, which take long.
        check_env(env.unwrapped, skip_render_check=True)
    # Observations and actions are unbounded, as without variations.
    assert [str(each.message) for each in caught if "Box" not in str(each.message)] == []


def test_wrappers_keep_the_infos():
    inner = gymnasium.make(suite.DOMAINS["kitchen"].env_id, variations="start,dynamics", max_episode_steps=2)
    env = gymnasium.wrappers.RecordEpisodeStatistics(gymnasium.wrappers.NormalizeReward(inner))
    _, info = env.reset(seed=1, options={"variation_values": {"kettle/mass": 1.2}})
    assert info["variation_values"]["kettle/mass"] == 1.2
    for _ in range(2):
        *_, truncated, info = env.step(np.zeros(9))
    assert truncated
    assert info["episode"]["l"] == 2
    assert info["variation_values"]["kettle/mass"] == 1.2
    assert env.get_wrapper_attr("variation_space") == inner.unwrapped.variation_space


def test_distributions_as_json_describes_them():
    env = make("kitchen", {"kettle/mass": {"uniform": [0.5, 1.0]}, "microwave/yaw": {"choice": [0.25, 0.35]}})
    masses = {float(env.reset(seed=seed)[1]["variation_values"]["kettle/mass"]) for seed in range(5)}
    assert len(masses) == 5
    assert max(masses) <= 1.0
    assert list(env.variation_values) == ["microwave/yaw", "kettle/mass"]
    assert env.reset()[1]["variation_values"]["microwave/yaw"] in (0.25, 0.35)


# Pictures.

PICTURES = {"obs_type": "pixels", "image_size": (32, 40), "render_quality": "fast"}


@pytest.mark.rendering
def test_a_state_goes_from_an_environment_with_pictures_to_one_without_and_back():
    seeing, blind = make("microwave_table", **PICTURES), make("microwave_table")
    first, info = seeing.reset(seed=4)
    blind.reset(seed=4)
    # Draws do not depend on visuals.
    assert_equal_states(seeing, blind)
    action = np.full(8, 0.3)
    seeing.step(action)
    blind.reset(seed=6)
    blind.set_state(seeing.get_state())
    seen, _, _, _, info = seeing.step(action)
    *_, blind_info = blind.step(action)
    assert_same(blind_info["variation_values"], info["variation_values"])
    assert_equal_states(seeing, blind)
    other, _ = seeing.reset(seed=5)
    assert np.abs(other.astype(int) - seen).mean() > 5
    np.testing.assert_array_equal(seeing.set_state(blind.get_state()), seen)
    again, _ = seeing.reset(seed=4, options={"variation_values": blind.variation_values})
    np.testing.assert_array_equal(again, first)
    seeing.close()


@pytest.mark.rendering
def test_pictures_show_the_appearance():
    env = make("kitchen", ["appearance"], render_mode="rgb_array", width=64, height=48, render_quality="fast")
    pictures = []
    for color in ([0.9, 0.2, 0.2], [0.2, 0.2, 0.9]):
        _, info = env.reset(seed=0, options={"variation": [], "variation_values": {"kettle/color": color}})
        assert info["variation_values"]["kettle/color"].tolist() == color
        pictures.append(env.render().astype(int))
    env.reset(seed=0, options={"variation": []})
    plain = FrankaKitchenEnv(render_mode="rgb_array", width=64, height=48, render_quality="fast")
    plain.reset(seed=0)
    default = env.render()
    env.reset(seed=0)
    assert np.abs(env.render().astype(int) - default).mean() > 5
    changed = np.abs(pictures[0] - pictures[1]).sum(axis=-1) > 30
    assert 0 < changed.mean() < 0.2
    red, blue = (picture[changed].mean(axis=0) for picture in pictures)
    assert red[0] > blue[0]
    assert red[2] < blue[2]
    np.testing.assert_array_equal(default, plain.render())
    for each in (env, plain):
        each.close()


@pytest.mark.rendering
@pytest.mark.nightly
@each_domain
def test_values_given_back_repeat_the_pictures(domain):
    groups = [group for group in groups_of(domain) if group in ("layout", "appearance", "camera")]
    env, again = (make(domain, groups, **PICTURES) for _ in range(2))
    default, _ = plain(domain, **PICTURES).reset(seed=7)
    seen, info = env.reset(seed=7)
    again.reset(seed=8)
    np.testing.assert_array_equal(again.reset(seed=7, options={"variation_values": info["variation_values"]})[0], seen)
    assert np.abs(seen.astype(int) - default).mean() > 5
    for each in (env, again):
        each.close()


@each_domain
def test_the_cameras_of_images_are_among_those_that_vary(domain):
    env = plain(domain, variations="camera")
    varied = env.composer_task.variations.ranges
    for camera in env.default_cameras:
        assert f"camera/{camera}_offset" in varied
    env.close()
