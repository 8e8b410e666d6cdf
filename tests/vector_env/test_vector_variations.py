"""Vectorised environments vary as Gymnasium's vector of single ones does, to the bit."""

import copy

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from helpers.comparisons import assert_same
from helpers.errors import refused
from helpers.sweeps import groups_of
from helpers.vectors import batch

from kitchen_suite import suite
from kitchen_suite.tasks.variations.distributions import GROUPS, SPLITS

pytestmark = pytest.mark.full

COUNT, STEPS, EPISODE = 3, 10, 4
MODES = [mode.value for mode in AutoresetMode]
# Settings of which the task's draws depend, and few tasks, of which the others may be done at the start.
SETTINGS = {
    "kitchen": {"tasks_to_complete": ["microwave", "kettle"], "goals": {"microwave": [-0.5]}},
    "open_cabinet": {"observation_noise": {"handle_offset": 0.01}},
    "microwave_table": {},
    "kitchens": {"variations": groups_of("kitchens")},
    "pick_and_place": {"variations": groups_of("pick_and_place")},
}
# A parameter of the start, and one of the model, in every domain.
EXAMPLES = {
    "kitchen": ("hinge_cabinet/doors", "kettle/mass"),
    "open_cabinet": ("cabinet/door_left", "franka/pad_friction"),
    "microwave_table": ("microwave/door", "franka/gain_scale"),
    "kitchens": ("franka/joint_offset", "franka/gain_scale"),
    "pick_and_place": ("objects/displacement", "objects/mass_scale"),
}

each_domain = pytest.mark.parametrize("domain", suite.DOMAINS)


def many(domain, mode="SameStep", num_threads=2, num_envs=COUNT, **settings):
    return gymnasium.make_vec(
        suite.DOMAINS[domain].env_id,
        num_envs,
        vectorization_mode="vector_entry_point",
        autoreset_mode=mode,
        num_threads=num_threads,
        **{"variations": [*GROUPS], **SETTINGS[domain], **settings},
    )


def singles(domain, mode="SameStep", **settings):
    return gymnasium.make_vec(
        suite.DOMAINS[domain].env_id,
        COUNT,
        vectorization_mode="sync",
        vector_kwargs={"autoreset_mode": mode},
        **{"variations": [*GROUPS], **SETTINGS[domain], **settings},
    )


def actions_of(env, step):
    scale = 0.05 if env.single_action_space.high[0] > 1 else 0.7
    return np.random.default_rng(step).uniform(-scale, scale, env.action_space.shape)


def rows(values, i):
    return {name: array[i] for name, array in values.items() if not name.startswith("_")}


def assert_equal_for_long(ours, theirs, steps=STEPS):
    """Plays both, with several resets, one of them of some environments; returns the values of all episodes."""

    def reset(**kwargs):
        # Gymnasium takes the mask out of the options.
        started = ours.reset(**copy.deepcopy(kwargs))
        assert_same(started, theirs.reset(**copy.deepcopy(kwargs)))
        seen.append(started[1]["variation_values"])

    seen = []
    reset(seed=30)
    for step in range(steps):
        if step == 2:
            # From here on their episodes end at different steps.
            reset(seed=[None, 77, 5], options={"reset_mask": np.array([True, True, False])})
        stepped = ours.step(actions_of(ours, step))
        assert_same(stepped, theirs.step(actions_of(ours, step)))
        seen.append(stepped[4]["variation_values"])
        ended = stepped[2] | stepped[3]
        if ours.metadata["autoreset_mode"] == AutoresetMode.DISABLED and ended.any():
            reset(options={"reset_mask": ended})
    reset()
    reset(seed=40, options={"variation": ["dynamics", "sensing"]})
    assert_same(ours.step(actions_of(ours, 0)), theirs.step(actions_of(ours, 0)))
    return seen


@pytest.mark.parametrize(
    ("domain", "mode", "split", "num_threads"),
    [
        ("kitchen", "NextStep", "held_out", 2),
        ("kitchen", "SameStep", "seen", 1),
        ("kitchen", "Disabled", "held_out", 2),
        ("open_cabinet", "NextStep", "seen", 1),
        ("open_cabinet", "SameStep", "held_out", 2),
        ("open_cabinet", "Disabled", "seen", 2),
        ("microwave_table", "SameStep", "held_out", 1),
        ("kitchens", "Disabled", "seen", 2),
        ("pick_and_place", "Disabled", "seen", 2),
    ],
)
def test_environments_are_gymnasiums_vector_of_single_ones(domain, mode, split, num_threads):
    settings = {"variation_split": split, "max_episode_steps": EPISODE}
    ours, theirs = many(domain, mode, num_threads, **settings), singles(domain, mode, **settings)
    seen = assert_equal_for_long(ours, theirs)
    for name in EXAMPLES[domain]:
        # Those of a mask that leaves environments out are 0 there.
        drawn = {row.tobytes() for values in seen for row in values[name] if row.any()}
        assert len(drawn) >= 3 * COUNT, name


@pytest.mark.nightly
@pytest.mark.parametrize("split", SPLITS)
@pytest.mark.parametrize("mode", MODES)
@each_domain
def test_long_runs_are_gymnasiums_vector_of_single_ones(domain, mode, split):
    settings = {"variation_split": split, "max_episode_steps": 25}
    assert_equal_for_long(many(domain, mode, **settings), singles(domain, mode, **settings), steps=200)


@pytest.mark.parametrize(
    ("domain", "settings"),
    [
        ("kitchen", {"info_format": "arrays", "control_mode": "ee_delta_pose", "extra_observables": ["kettle/pose"]}),
        ("open_cabinet", {"variations": {"cabinet/yaw": {"uniform": [-0.1, 0.1]}, "sensing/action_delay": 1.0}}),
        ("microwave_table", {"control_mode": "joint_position"}),
        ("kitchens", {"variations": {"fixtures/damping_scale": {"uniform": [0.8, 1.2]}, "sensing/action_delay": 1.0}}),
        ("microwave_table", {"variations": {"microwave/door": {"uniform": [-0.2, 0]}, "sensing/action_delay": 1.0}}),
    ],
)
def test_other_settings_equal_single_ones_too(domain, settings):
    ours, theirs = many(domain, **settings), singles(domain, **settings)
    assert_same(ours.reset(seed=1), theirs.reset(seed=1))
    for step in range(3):
        assert_same(ours.step(actions_of(ours, step)), theirs.step(actions_of(ours, step)))


@each_domain
def test_values_given_back_repeat_the_episodes(domain):
    env = many(domain, variation_split="held_out")
    played = [env.reset(seed=3), env.step(actions_of(env, 0))]
    values = played[0][1]["variation_values"]
    assert {name for name in values if name.startswith("_")} == {f"_{name}" for name in values if name[0] != "_"}
    given = {name: array.copy() for name, array in values.items() if not name.startswith("_")}
    env.reset(seed=9)
    assert_same(env.reset(seed=3, options={"variation_values": given}), played[0])
    assert_same(env.step(actions_of(env, 0)), played[1])
    # Every environment has its own.
    name = EXAMPLES[domain][1]
    given[name] = np.array([1.1, 1.15, 1.2])
    _, info = env.reset(seed=3, options={"variation_values": {name: given[name]}})
    np.testing.assert_array_equal(info["variation_values"][name], given[name])
    assert_same(rows(info["variation_values"], 1) | {name: 0}, rows(values, 1) | {name: 0})
    # They are of one episode.
    mask = np.array([False, True, False])
    _, info = env.reset(seed=[None, 4, None], options={"reset_mask": mask, "variation_values": {name: given[name]}})
    assert info["variation_values"][name].tolist() == [0.0, 1.15, 0.0]
    _, info = env.reset(seed=3)
    assert_same(info["variation_values"], values)


@pytest.mark.parametrize(
    ("options", "error", "shown"),
    [
        ({"variation_values": {"kettle/mass": 1.0}}, ValueError, ["variation_values", "'kettle/mass'", "3"]),
        ({"variation_values": {"kettle/mass": [1.0, 1.0]}}, ValueError, ["3", "(2,)"]),
        ({"variation_values": {"kettle/mass": [1.0, 1.0, 7.0]}}, ValueError, ["within 0.4 and 1.5, got 7.0"]),
        ({"variation_values": {"kettle/mass": [[1.0]] * 3}}, ValueError, ["kettle/mass"]),
        ({"variation_values": {"kettle/mas": [1.0] * 3}}, ValueError, ["'kettle/mass'"]),
        ({"variation_values": 3}, TypeError, ["variation_values"]),
        ({"variation": ["strat"]}, ValueError, ["'strat'"]),
        ({"state": {}}, ValueError, ["'state'"]),
    ],
)
def test_bad_options_are_refused_and_change_nothing(kitchens, options, error, shown):
    env, twin = kitchens
    for each in kitchens:
        each.reset(seed=6)
    with refused(error, *shown):
        env.reset(seed=1, options=options)
    assert_same(env.step(actions_of(env, 0)), twin.step(actions_of(env, 0)))
    assert_same(env.reset(), twin.reset())


@pytest.fixture(scope="module")
def kitchens():
    return many("kitchen"), many("kitchen")


def test_without_variations_nothing_is_added():
    plain, empty = (many("kitchen", variations=variations, max_episode_steps=3) for variations in (None, []))
    assert_same(plain.reset(seed=0), empty.reset(seed=0))
    for step in range(4):
        one, other = (env.step(actions_of(env, step)) for env in (plain, empty))
        assert_same(one, other)
        assert not [key for key in one[4] if "variation" in key or "layout" in key]
    assert plain.unwrapped.variation_space == gymnasium.spaces.Dict()
    with pytest.raises(ValueError, match="nothing varies"):
        plain.reset(options={"variation": ["start"]})


@each_domain
def test_the_space_and_the_split_are_those_of_every_environment(domain):
    env = many(domain, variation_split="held_out")
    space = env.unwrapped.variation_space
    assert env.get_attr("variation_space") == (space,) * COUNT
    assert env.get_attr("variation_split") == ("held_out",) * COUNT
    _, info = env.reset(seed=0)
    for i in range(COUNT):
        values = rows(info["variation_values"], i)
        assert {name: np.asarray(value) for name, value in values.items()} in space
    if domain == "kitchen":
        assert info["variation_split"].tolist() == ["held_out"] * COUNT


@each_domain
def test_resets_compile_no_model(domain):
    env = many(domain, max_episode_steps=2, variation_split="held_out")
    inner = env.unwrapped
    model = inner.template_env.environment.physics.model.ptr
    arrays = {name: id(array) for name, array in inner._episodes._model_fields.items()}
    env.reset(seed=0)
    for step in range(6):
        env.step(actions_of(env, step))
    assert inner.template_env.environment.physics.model.ptr is model
    assert {name: id(array) for name, array in inner._episodes._model_fields.items()} == arrays


def test_final_infos_hold_the_values_of_the_episode_that_ended():
    env = many("kitchen", max_episode_steps=2)
    _, first = env.reset(seed=0)
    env.step(actions_of(env, 0))
    *_, info = env.step(actions_of(env, 1))
    final = info["final_info"]
    assert final["variation_values"].keys() == info["variation_values"].keys()
    for i in range(COUNT):
        assert_same(rows(final["variation_values"], i), rows(first["variation_values"], i))
        assert final["variation_values"]["kettle/mass"][i] != info["variation_values"]["kettle/mass"][i]
    # They stay as they are.
    kept = copy.deepcopy(final)
    env.step(actions_of(env, 2))
    assert_same(final, kept)


def test_rewards_are_computed_from_infos_with_variations():
    # The microwave's goal lies within its threshold from the start: it pays in the first step.
    env = many("kitchen", goals={"microwave": [0.1]}, threshold=0.37, max_episode_steps=9)
    inner = env.unwrapped
    env.reset(seed=0)
    paid = 0.0
    for step in range(4):
        observation, reward, terminated, truncated, info = env.step(actions_of(env, step))
        computed = inner.compute_reward(observation["achieved_goal"], observation["desired_goal"], info)
        np.testing.assert_array_equal(computed, reward)
        achieved, desired = observation["achieved_goal"], observation["desired_goal"]
        np.testing.assert_array_equal(inner.compute_terminated(achieved, desired, info), terminated)
        np.testing.assert_array_equal(inner.compute_truncated(achieved, desired, info), truncated)
        paid += reward.sum()
    assert paid == COUNT


@each_domain
def test_values_are_the_same_read_only_arrays_until_an_episode_starts(domain):
    env, name = many(domain, "NextStep"), EXAMPLES[domain][1]
    _, started = env.reset(seed=[1, 2, 3])
    infos = [env.step(actions_of(env, step))[4] for step in range(2)]
    first, second = infos[0]["variation_values"], infos[1]["variation_values"]
    assert first is not second
    assert first[name] is second[name]
    assert not first[name].flags.writeable
    np.testing.assert_array_equal(first[name], started["variation_values"][name])
    before = first[name].copy()
    env.reset(options={"reset_mask": np.array([False, True, False])})
    after = env.step(actions_of(env, 0))[4]["variation_values"][name]
    np.testing.assert_array_equal(first[name], before)
    assert (after != before).tolist() == [False, True, False]


@each_domain
@pytest.mark.filterwarnings("error")
def test_a_simulation_that_diverged_starts_with_new_values(domain):
    env, twin = (many(domain, "SameStep") for _ in range(2))
    for each in (env, twin):
        _, before = each.reset(seed=2)
        each.step(actions_of(each, 0))
    batch(env).qvel[1] = np.nan
    _, _, terminated, _, info = env.step(actions_of(env, 1))
    _, _, _, _, twin_info = twin.step(actions_of(env, 1))
    assert terminated.tolist() == info["physics_error"].tolist() == [False, True, False]
    name = EXAMPLES[domain][1]
    changed = info["variation_values"][name] != before["variation_values"][name]
    assert changed.tolist() == [False, True, False]
    for i in (0, 2):
        assert_same(rows(info["variation_values"], i), rows(twin_info["variation_values"], i))


# Pictures.

PICTURES = {"obs_type": "pixels", "image_size": [24, 32], "render_quality": "fast"}


def assert_pictures(domain, **settings):
    ours = many(domain, "NextStep", num_envs=2, max_episode_steps=2, **PICTURES, **settings)
    one = gymnasium.make(
        suite.DOMAINS[domain].env_id,
        **{"variations": [*GROUPS], **SETTINGS[domain], "max_episode_steps": 2, **PICTURES, **settings},
    )
    seen, _ = ours.reset(seed=[5, 6])
    pictures = [one.reset(seed=6)[0]]
    np.testing.assert_array_equal(seen[1], pictures[0])
    # Different walls, lights and cameras; of generated kitchens the cameras alone.
    least = 1 if domain in ("kitchens", "pick_and_place") else 5
    assert np.abs(seen[0].astype(int) - seen[1]).mean() > least
    for step in range(4):
        actions = actions_of(ours, step)
        seen, *_ = ours.step(actions)
        # The third step starts the next episode.
        pictures.append(one.reset()[0] if step == 2 else one.step(actions[1])[0])
        np.testing.assert_array_equal(seen[1], pictures[-1])
    assert np.abs(pictures[-1].astype(int) - pictures[0]).mean() > least
    for env in (ours, one):
        env.close()


@pytest.mark.rendering
def test_pictures_are_those_of_single_environments():
    assert_pictures("microwave_table")


@pytest.mark.nightly
@pytest.mark.rendering
@pytest.mark.parametrize("split", SPLITS)
@each_domain
def test_pictures_of_all_domains_are_those_of_single_environments(domain, split):
    assert_pictures(domain, variation_split=split)


@pytest.mark.rendering
def test_every_environment_is_rendered_with_its_own_values():
    settings = {"variations": ["appearance"], "render_mode": "rgb_array", "width": 48, "height": 40}
    env = many("microwave_table", num_envs=2, render_quality="fast", **settings)
    env.reset(seed=0)
    first, second = (image.astype(int) for image in env.render())
    assert np.abs(first - second).mean() > 5
    np.testing.assert_array_equal(env.unwrapped.render_some([0])[0], first)
    env.close()
