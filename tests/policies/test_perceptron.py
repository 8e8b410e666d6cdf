"""Trained policies: their file, their arithmetic, and equal actions in every kind of environment."""

import json
import math
import os
import resource
import subprocess
import sys
import zipfile

import gymnasium
import numpy as np
import pytest
from helpers.arrays import npy
from helpers.errors import refused

import kitchen_suite
from kitchen_suite import files, policies, suite
from kitchen_suite.commands import record
from kitchen_suite.episodes.episode import unflatten
from kitchen_suite.episodes.recording import Recording
from kitchen_suite.gymnasium_env import KITCHEN_ID, OPEN_CABINET_ID
from kitchen_suite.policies import files as policy_files
from kitchen_suite.policies.perceptron import PerceptronPolicy

TASKS = {"kitchen": "mixed", "open_cabinet": "top_drawer"}
MIXED = ["microwave", "kettle", "bottom burner", "light switch"]
# Sizes of observation and action; the kitchen's goals of these tasks have 1, 7, 2 and 2 elements.
SIZES = {"kitchen": (59 + 2 * 12, 9), "open_cabinet": (25, 8)}
IDS = {
    "kitchen": (KITCHEN_ID, {"tasks_to_complete": MIXED, "goal_format": "flat", "info_format": "arrays"}),
    "open_cabinet": (OPEN_CABINET_ID, {}),
}
DOMAINS = list(SIZES)


def make(domain="open_cabinet", hidden=(6, 4), seed=0, **changes):
    """A small policy of random weights, whose actions move a robot."""
    generator = np.random.default_rng(seed)
    observed, acted = SIZES[domain]
    sizes = [observed, *hidden, acted]

    def draw(*shape):
        return generator.normal(scale=0.5, size=shape).astype(np.float32)

    parts = {
        "mean": draw(observed),
        "deviation": np.exp(draw(observed)),
        "clip": 2.0,
        "weights": tuple(draw(sizes[i + 1], sizes[i]) for i in range(len(sizes) - 1)),
        "biases": tuple(draw(size) for size in sizes[1:]),
        "action_scale": np.linspace(0.02, 0.1, acted, dtype=np.float32),
        "metadata": {"domain_name": domain, "task_name": TASKS[domain], "task_kwargs": {}},
    }
    return PerceptronPolicy(**{**parts, **changes})


def act_by_hand(policy, observation):
    """The formula of the documentation, in plain Python."""
    values = [
        min(max((float(value) - float(mean)) / float(deviation), -policy.clip), policy.clip)
        for value, mean, deviation in zip(observation, policy.mean, policy.deviation, strict=True)
    ]
    for layer, (weight, bias) in enumerate(zip(policy.weights, policy.biases, strict=True)):
        values = [
            sum(float(factor) * value for factor, value in zip(row, values, strict=True)) + float(offset)
            for row, offset in zip(weight, bias, strict=True)
        ]
        if layer < len(policy.weights) - 1:
            values = [value if value > 0 else math.exp(value) - 1 for value in values]
    return [value * float(scale) for value, scale in zip(values, policy.action_scale, strict=True)]


@pytest.fixture
def saved(tmp_path):
    """A policy's file."""
    path = tmp_path / "policy.npz"
    make().save(path)
    return path


def rewrite(path, *, without=(), metadata=None, **arrays):
    """Changes the contents of a policy's file."""
    with np.load(path, allow_pickle=False) as file:
        present = dict(file)
    known = {**json.loads(str(present["metadata"])), **(metadata or {})}
    present |= {"metadata": np.array(json.dumps(known)), **arrays}
    np.savez(path, **{name: array for name, array in present.items() if name not in without})


@pytest.mark.parametrize("hidden", [(), (5,), (6, 4)])
def test_the_actions_are_those_of_the_formula(hidden):
    policy = make(hidden=hidden)
    # Wide enough that some observations are clipped.
    observations = np.random.default_rng(1).normal(scale=4, size=(20, 25))
    standardised = (observations - policy.mean) / policy.deviation
    assert 0.1 < (np.abs(standardised) > policy.clip).mean() < 0.9
    expected = [act_by_hand(policy, observation) for observation in observations]
    # Products of float32: some 1e-7 of numbers near one.
    np.testing.assert_allclose(policy(observations), expected, rtol=1e-5, atol=1e-6)


def test_any_leading_axes_give_the_same_actions():
    policy, observations = make(), np.random.default_rng(1).normal(size=(2, 3, 25))
    actions = policy(observations)
    assert (actions.shape, actions.dtype) == ((2, 3, 8), np.float32)
    assert policy(observations[0]).shape == (3, 8)
    assert policy(observations[0, 0]).shape == (8,)
    # Other shapes are summed up in another order.
    np.testing.assert_allclose(policy(observations[0]), actions[0], rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(policy(observations[0, 0]), actions[0, 0], rtol=1e-5, atol=1e-7)


def test_a_saved_policy_is_loaded_unchanged(saved):
    policy, loaded = make(), PerceptronPolicy.load(saved)
    for name in ("mean", "deviation", "clip", "action_scale"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(policy, name), name)
    for one, other in zip((*loaded.weights, *loaded.biases), (*policy.weights, *policy.biases), strict=True):
        np.testing.assert_array_equal(one, other)
    assert loaded.metadata == {
        **policy.metadata,
        "format": 1,
        "kitchen_suite": kitchen_suite.__version__,
    }
    observations = np.random.default_rng(1).normal(size=(4, 25))
    np.testing.assert_array_equal(loaded(observations), policy(observations))


def test_acting_needs_no_torch(saved):
    code = f"""
import sys
from pathlib import Path
import numpy as np
from kitchen_suite.policies.perceptron import PerceptronPolicy
assert PerceptronPolicy.load(Path({str(saved)!r}))(np.zeros(25)).shape == (8,)
assert "torch" not in sys.modules
"""
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert (process.returncode, process.stderr) == (0, "")


def test_a_damaged_file_is_rejected_or_harmless(saved):
    whole, observations, rejected = saved.read_bytes(), np.random.default_rng(1).normal(size=(4, 25)), 0
    for start in range(0, len(whole), 37):
        saved.write_bytes(whole[:start] + b"damaged!" + whole[start + 8 :])
        try:
            loaded = PerceptronPolicy.load(saved)
        except (OSError, ValueError):
            rejected += 1
        else:
            # Damage to bytes that are not read, such as the time of writing.
            np.testing.assert_array_equal(loaded(observations), make()(observations))
    assert rejected > len(whole) / 37 / 2


def test_a_file_that_is_not_an_npz_is_an_os_error(saved):
    saved.write_bytes(b"text")
    with refused(OSError, "policy.npz", "trained policy"):
        PerceptronPolicy.load(saved)


def with_nan(array):
    return np.full_like(array, np.nan)


# Changes of the arrays of a policy's file: arrays left out, of another shape or type, not finite, not positive.
SPOILT = {
    "no mean": {"mean": None},
    "no layer": {"weight_1": None},
    "an axis more": {"mean": np.zeros((25, 1), np.float32)},
    "another size": {"deviation": np.ones(24, np.float32)},
    "layers that do not fit": {"weight_0": np.zeros((25, 6), np.float32)},
    "another type": {"weight_2": np.zeros((8, 4))},
    "several numbers": {"clip": np.ones(2, np.float32)},
    "nan": {"weight_1": with_nan(np.ones((4, 6), np.float32))},
    "a deviation of zero": {"deviation": np.zeros(25, np.float32)},
}


@pytest.mark.parametrize("changes", SPOILT.values(), ids=SPOILT)
def test_arrays_that_do_not_fit_are_refused_with_the_file(saved, changes):
    rewrite(
        saved,
        without=[name for name, array in changes.items() if array is None],
        **{name: array for name, array in changes.items() if array is not None},
    )
    with refused(ValueError, "policy.npz"):
        PerceptronPolicy.load(saved)


# tests/test_files.py has more of them.
CRAFTED = {
    "objects": npy("{'descr': '|O', 'fortran_order': False, 'shape': (25,)}"),
    "a bomb": npy("{'descr': '<f4', 'fortran_order': False, 'shape': (1073741824,)}", bytes(2**27)),
}


@pytest.mark.full
@pytest.mark.parametrize("content", CRAFTED.values(), ids=CRAFTED)
def test_a_crafted_array_is_refused_in_one_line_before_it_takes_memory(saved, content):
    with zipfile.ZipFile(saved) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(saved, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, member in {**members, "mean.npy": content}.items():
            archive.writestr(name, member)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with refused(OSError, "policy.npz"):
        PerceptronPolicy.load(saved)
    # In KiB; the bomb would take 128 MiB.
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 2**16


@pytest.mark.parametrize(
    ("metadata", "shown"),
    [
        ([], ()),
        ("text", ()),
        ({"format": 2, "domain_name": "kitchen", "task_name": "kettle", "task_kwargs": {}}, ("format 2", "1")),
        ({"episode": 0}, ("format",)),
        ({"format": [[]]}, ("format",)),
        ({"format": 1, "domain_name": ["x"]}, ("domain_name",)),
        ({"format": 1, "domain_name": "kitchen", "task_name": None}, ("task_name",)),
    ],
    ids=str,
)
def test_metadata_of_another_kind_are_refused_with_the_file(saved, metadata, shown):
    with np.load(saved) as file:
        arrays = {**file, "metadata": np.array(json.dumps(metadata))}
    np.savez(saved, **arrays)
    with refused((OSError, ValueError), "policy.npz", *shown):
        PerceptronPolicy.load(saved)


def test_the_representation_names_the_task_and_the_layers():
    assert repr(make()) == "<PerceptronPolicy of open_cabinet top_drawer, layers [25, 6, 4, 8]>"


def load(domain, seed=0, **kwargs):
    """Loads the suite's environment with the random stream that Gymnasium makes of the seed."""
    stream = np.random.RandomState(gymnasium.utils.seeding.np_random(seed)[0].bit_generator)
    return suite.load(domain, TASKS[domain], {"random": stream, "visuals": False, **kwargs})


def acting(path, environment):
    return policies.find(f"trained(file={str(path)!r})")(environment, np.random.default_rng(0))


@pytest.mark.full
@pytest.mark.parametrize("domain", DOMAINS)
def test_dm_env_and_gymnasium_observations_are_flattened_alike(domain):
    name, settings = IDS[domain]
    environment, gym = load(domain, seed=3), gymnasium.make(name, **settings)
    timestep, (observation, _) = environment.reset(), gym.reset(seed=3)
    flatten = environment.task.policy_inputs.flatten
    for action in 0.05 * np.random.default_rng(0).normal(size=(5, SIZES[domain][1])):
        flat = flatten(timestep.observation)
        assert flat.shape == SIZES[domain][:1]
        np.testing.assert_array_equal(flat, flatten(observation))
        timestep, (observation, *_) = environment.step(action), gym.step(action)
    assert not np.array_equal(flat, flatten(observation))


@pytest.mark.full
@pytest.mark.parametrize("domain", DOMAINS)
def test_a_policy_acts_alike_in_all_kinds_of_environments(domain, tmp_path):
    policy, steps, count = make(domain), 40, 3
    policy.save(tmp_path / "policy.npz")
    name, settings = IDS[domain]
    environments, gyms = [load(domain, seed) for seed in range(count)], [gymnasium.make(name, **settings)] * count
    vector = gymnasium.make_vec(name, count, vectorization_mode="vector_entry_point", **settings)
    flatten = environments[0].task.policy_inputs.flatten

    def of_the_suite(seed):
        act, timestep = acting(tmp_path / "policy.npz", environments[seed]), environments[seed].reset()
        for _ in range(steps):
            action = act(timestep)
            timestep = environments[seed].step(action)
            yield action, timestep.reward

    def of_gymnasium(seed):
        observation, _ = gyms[seed].reset(seed=seed)
        for _ in range(steps):
            action = policy(flatten(observation))
            observation, reward, *_ = gyms[seed].step(action)
            yield action, reward

    def of_the_vector():
        observations, _ = vector.reset(seed=0)
        for _ in range(steps):
            actions = policy(flatten(observations))
            observations, rewards, *_ = vector.step(actions)
            yield actions, rewards

    together = list(of_the_vector())
    for seed in range(count):
        alone, by_gymnasium = list(of_the_suite(seed)), list(of_gymnasium(seed))
        for (one, reward), (other, same), (many, rewards) in zip(alone, by_gymnasium, together, strict=True):
            np.testing.assert_array_equal(one, other)
            assert reward == same
            # A batch is summed up in another order than one observation: 1e-7, which the physics carries on.
            np.testing.assert_allclose(many[seed], one, rtol=1e-3, atol=1e-5)
            np.testing.assert_allclose(rewards[seed], reward, rtol=1e-3, atol=1e-4)
    vector.close()


@pytest.mark.full
@pytest.mark.parametrize("domain", DOMAINS)
def test_a_policy_can_be_recorded(domain, tmp_path):
    policy, path = make(domain), tmp_path / "policy.npz"
    policy.save(path)
    flatten = load(domain).task.policy_inputs.flatten
    arguments = [f"--domain_name={domain}", f"--task_name={TASKS[domain]}", f"--policy=trained(file={str(path)!r})"]
    if domain == "kitchen":
        arguments.append('--task_kwargs={"goal_format": "flat"}')
    arguments += ["--num_episodes=2", "--max_episode_steps=5", f"--output={tmp_path / 'episodes'}"]
    assert record.main(arguments) == 0
    for index in range(2):
        arrays = Recording.open(tmp_path / "episodes").load(index).arrays
        seen = flatten(unflatten(arrays, "observation"))[:-1]
        # Several observations are summed up in another order than one.
        np.testing.assert_allclose(policy(seen), arrays["action"], rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize(("own", "other"), [DOMAINS, DOMAINS[::-1]])
def test_a_policy_of_another_task_is_a_policy_error(own, other, tmp_path):
    make(own).save(tmp_path / "policy.npz")
    with refused(policies.PolicyError, own, TASKS[own]):
        acting(tmp_path / "policy.npz", load(other))


def test_the_error_of_another_task_has_the_arguments_of_the_policy(tmp_path):
    policy = make("kitchen")
    goals = {"goals": {"microwave": [-0.4]}}
    policy.with_metadata({**policy.metadata, "task_kwargs": goals}).save(tmp_path / "policy.npz")
    with refused(policies.PolicyError, "task_kwargs", "[-0.4]"):
        acting(tmp_path / "policy.npz", load("open_cabinet"))


def test_a_file_that_is_replaced_does_not_change_the_policy_that_was_found(tmp_path):
    environment, path = load("open_cabinet"), tmp_path / "policy.npz"
    make().save(path)
    timestep, build = environment.reset(), policies.find(f"trained(file={str(path)!r})")
    first = build(environment, np.random.default_rng(0))(timestep)
    make(seed=1).save(path)
    os.utime(path, ns=(0, 0))
    np.testing.assert_array_equal(build(environment, np.random.default_rng(0))(timestep), first)
    assert not np.array_equal(acting(path, environment)(timestep), first)


def test_a_file_of_another_digest_is_a_policy_error(tmp_path):
    environment, path = load("open_cabinet"), tmp_path / "policy.npz"
    make().save(path)
    name, digest = f"trained(file={str(path)!r})", files.file_digest(path)
    policies.find(name, digest=digest)(environment, np.random.default_rng(0))
    make(seed=1).save(path)
    with refused(policies.PolicyError, "policy.npz"):
        policies.find(name, digest=digest)(environment, np.random.default_rng(0))


@pytest.mark.full
@pytest.mark.parametrize("options", ["file=3", "speed=1", "file='nothing.npz'"])
def test_bad_options_and_files_are_policy_errors(options):
    with refused(policies.PolicyError, "trained("):
        policies.find(f"trained({options})")(load("open_cabinet"), np.random.default_rng(0))


@pytest.mark.full
def test_a_missing_shipped_policy_is_an_error_that_lists_those_that_exist(monkeypatch, tmp_path):
    monkeypatch.setattr(policy_files, "SHIPPED", tmp_path)
    make().save(tmp_path / "bottom_drawer.npz")
    with refused(policies.PolicyError, "open_cabinet", "top_drawer"):
        policies.find("trained")(load("open_cabinet"), np.random.default_rng(0))
    make().save(tmp_path / "top_drawer.npz")
    policies.find("trained")(load("open_cabinet"), np.random.default_rng(0))
    with refused(policies.PolicyError, "open_cabinet", "top_drawer_grasp", "bottom_drawer", "top_drawer"):
        policies.find("trained")(load("open_cabinet", reward="grasp"), np.random.default_rng(0))
    with refused(policies.PolicyError, "microwave_kettle_bottom_burner_light_switch"):
        policies.find("trained")(load("kitchen"), np.random.default_rng(0))
    make("kitchen").save(tmp_path / "microwave_kettle_bottom_burner_light_switch.npz")
    policies.find("trained")(load("kitchen"), np.random.default_rng(0))


def test_a_policy_acts_in_its_own_control_mode_only():
    environment = suite.load("open_cabinet", "top_drawer", {"visuals": False, "control_mode": "joint_delta"})
    with refused(policies.PolicyError, "'joint_offset'", "'joint_delta'"):
        policies.find("trained")(environment, np.random.default_rng(0))
