"""Every task of the suite: dm_env's own contract, and properties that hold for all of them."""

import gc
import unittest

import mujoco
import numpy as np
import pytest
from dm_control.suite.wrappers import action_noise, action_scale, mujoco_profiling, pixels
from dm_env import specs, test_utils
from helpers.sweeps import brief

from kitchen_suite import suite
from kitchen_suite.tasks import DEFAULT_TASKS, GOALS

SHORT = 1.0  # [s], 13 control steps of the kitchen


def load(domain, task, seed=0, **task_kwargs):
    return suite.load(domain, task, task_kwargs={"random": seed, "visuals": False, "time_limit": SHORT, **task_kwargs})


def random_action(environment, rng):
    spec = environment.action_spec()
    bounded = isinstance(spec, specs.BoundedArray)
    return rng.uniform(spec.minimum, spec.maximum) if bounded else rng.normal(size=spec.shape)


def rollout(environment, seed=0):
    rng = np.random.default_rng(seed)
    timesteps = [environment.reset()]
    while not timesteps[-1].last():
        timesteps.append(environment.step(random_action(environment, rng)))
    return timesteps


def assert_equal_episodes(one, other):
    assert len(one) == len(other)
    for a, b in zip(one, other, strict=True):
        assert (a.step_type, a.reward, a.discount) == (b.step_type, b.reward, b.discount)
        for key in a.observation:
            np.testing.assert_array_equal(a.observation[key], b.observation[key], key)


class EnvironmentContract(test_utils.EnvironmentTestMixin):
    """dm_env's tests of any environment; the classes made from it below name one of ours each."""

    pair: tuple[str, str]

    def make_object_under_test(self):
        return load(*self.pair)

    def make_action_sequence(self):
        rng = np.random.default_rng(0)
        for _ in range(20):
            yield random_action(self.environment, rng)


# Tasks of a domain differ in their goals alone: what these do not decide is tested with one of each domain.
EXAMPLES = [
    *(("kitchen", "all"), ("open_cabinet", "bottom_drawer"), ("microwave_table", "open"), ("kitchens", "any")),
    ("pick_and_place", "any"),
]
a_task_of_each_domain = pytest.mark.parametrize(("domain", "task"), EXAMPLES)
every_task = pytest.mark.parametrize(
    ("domain", "task"),
    [pair if pair in EXAMPLES else pytest.param(*pair, marks=pytest.mark.nightly) for pair in suite.ALL_TASKS],
)

for _pair in EXAMPLES:
    _name = "TestContract_" + "_".join(_pair)
    globals()[_name] = type(_name, (EnvironmentContract, unittest.TestCase), {"pair": _pair})


def test_tables_agree():
    assert set(suite.TASKS_BY_DOMAIN) == {domain for domain, _ in suite.ALL_TASKS}
    assert sum(map(len, suite.TASKS_BY_DOMAIN.values())) == len(suite.ALL_TASKS) == len(set(suite.ALL_TASKS))
    assert set(suite.BENCHMARKING) < set(suite.ALL_TASKS)


def test_every_goal_is_a_task_and_the_sets_are_those_of_the_literature():
    expected = {name.replace(" ", "_"): [name] for name in GOALS}
    expected["complete"] = expected["partial"] = ["microwave", "kettle", "light switch", "slide cabinet"]
    expected["mixed"] = ["microwave", "kettle", "bottom burner", "light switch"]
    expected["all"] = list(DEFAULT_TASKS)
    expected |= {f"random_{count}": list(DEFAULT_TASKS) for count in range(1, 8)}
    names = suite.TASKS_BY_DOMAIN["kitchen"]
    assert {name: [*suite.task_arguments("kitchen", name)["tasks_to_complete"]] for name in names} == expected
    assert load("kitchen", "mixed").task.tasks_to_complete == expected["mixed"]


@every_task
def test_specs_fit_what_is_observed(domain, task):
    environment = load(domain, task)
    spec = environment.observation_spec()
    for timestep in rollout(environment):
        assert list(timestep.observation) == list(spec)
        for key, value in timestep.observation.items():
            spec[key].validate(value)
        if not timestep.first():
            environment.reward_spec().validate(timestep.reward)
            environment.discount_spec().validate(timestep.discount)


@pytest.mark.full
@every_task
def test_the_seed_fixes_the_episode(domain, task):
    assert_equal_episodes(rollout(load(domain, task, seed=3)), rollout(load(domain, task, seed=3)))


@pytest.mark.full
@a_task_of_each_domain
def test_another_seed_gives_another_episode(domain, task):
    one, other = (rollout(load(domain, task, seed=seed))[-1].observation for seed in (3, 4))
    assert any(not np.array_equal(one[key], other[key]) for key in one)


@pytest.mark.full
@a_task_of_each_domain
def test_episodes_of_one_environment_differ(domain, task):
    environment = load(domain, task)
    one, other = (rollout(environment)[0].observation for _ in range(2))
    assert any(not np.array_equal(one[key], other[key]) for key in one)


@pytest.mark.full
@a_task_of_each_domain
def test_observations_are_fresh_memory(domain, task):
    environment = load(domain, task)
    timesteps = rollout(environment)
    kept = [{key: value.copy() for key, value in timestep.observation.items()} for timestep in timesteps]
    for timestep in timesteps:
        for value in timestep.observation.values():
            value[...] = np.nan
    again = rollout(environment)
    # Random actions may end one of the episodes earlier.
    for before, after in zip(kept, again, strict=False):
        assert all(np.isfinite(after.observation[key]).all() for key in before)
    arrays = [value for timestep in again for value in timestep.observation.values()]
    assert not any(np.shares_memory(a, b) for i, a in enumerate(arrays) for b in arrays[:i])


@pytest.mark.full
@every_task
def test_the_discount_is_zero_only_at_true_ends(domain, task):
    timesteps = rollout(load(domain, task))
    assert [timestep.discount for timestep in timesteps[1:-1]] == [1.0] * (len(timesteps) - 2)
    assert timesteps[-1].last()
    assert timesteps[-1].discount == (1.0 if len(timesteps) - 1 == load(domain, task).step_limit else 0.0)


@pytest.mark.full
@a_task_of_each_domain
def test_flat_observation_is_the_concatenation(domain, task):
    flat = suite.load(
        domain,
        task,
        task_kwargs={"random": 0, "visuals": False, "time_limit": SHORT},
        environment_kwargs={"flat_observation": True},
    )
    spec = flat.observation_spec()
    assert list(spec) == ["observations"]
    for one, other in zip(rollout(flat), rollout(load(domain, task)), strict=True):
        spec["observations"].validate(one.observation["observations"])
        np.testing.assert_array_equal(one.observation["observations"], np.concatenate([*other.observation.values()]))


def test_the_kitchens_observables_have_the_public_keys_in_the_order_of_the_59_numbers():
    spec = load("kitchen", "mixed").observation_spec()
    tasks = ("microwave", "kettle", "bottom burner", "light switch")
    assert list(spec) == [
        "franka/joint_positions",
        "franka/joint_velocities",
        "object_positions",
        "object_velocities",
        *(f"achieved_goal/{task}" for task in tasks),
        *(f"desired_goal/{task}" for task in tasks),
    ]
    assert [part.shape for part in list(spec.values())[:4]] == [(9,), (9,), (21,), (20,)]
    assert {part.dtype for part in spec.values()} == {np.dtype(np.float64)}


LIMITS = [(22.4, 280), (7.0, 88), (0.56, 7), (0.08, 1), (0.01, 1), (0.8, 10)]


@pytest.mark.full
@pytest.mark.parametrize(("time_limit", "steps"), brief(LIMITS, kept=[(0.56, 7), (0.01, 1), (0.8, 10)]))
def test_an_episode_has_exactly_as_many_steps_as_fit(time_limit, steps):
    assert len(rollout(load("kitchen", "all", time_limit=time_limit))) == steps + 1


@pytest.mark.full
def test_without_a_time_limit_nothing_ends():
    environment = load("kitchen", "all", time_limit=None)
    environment.reset()
    assert not any(environment.step(np.zeros(9)).last() for _ in range(300))


@pytest.mark.full
def test_action_scale_wraps_the_kitchen():
    plain, scaled = (load("kitchen", "all") for _ in range(2))
    scaled = action_scale.Wrapper(scaled, minimum=-2.0, maximum=2.0)
    plain.reset()
    scaled.reset()
    action = np.linspace(-1, 1, 9)
    for _ in range(3):
        one, other = plain.step(action), scaled.step(2 * action)
        np.testing.assert_allclose(
            one.observation["franka/joint_positions"], other.observation["franka/joint_positions"], atol=1e-9
        )


@pytest.mark.full
def test_action_noise_draws_from_the_tasks_random_state():
    def positions(scale):
        environment = action_noise.Wrapper(load("kitchen", "all", robot_noise_ratio=0.0), scale=scale)
        environment.reset()
        return [environment.step(np.zeros(9)).observation["franka/joint_positions"] for _ in range(3)]

    np.testing.assert_array_equal(positions(0.1), positions(0.1))
    assert not np.array_equal(positions(0.1), positions(0.0))


def test_profiling_wraps_the_kitchen(request):
    # The wrapper leaves a callback in MuJoCo, which then refuses to step batches.
    request.addfinalizer(lambda: mujoco.set_mjcb_time(None))
    environment = mujoco_profiling.Wrapper(load("kitchen", "all"))
    environment.reset()
    assert environment.step(np.zeros(9)).observation["step_timing"].shape == (2,)


@pytest.mark.full
@pytest.mark.rendering
def test_pixels_wraps_the_kitchen():
    environment = suite.load("kitchen", "kettle", task_kwargs={"random": 0})
    environment = pixels.Wrapper(environment, render_kwargs={"camera_id": "overview", "height": 60, "width": 80})
    timestep = environment.reset()
    assert list(timestep.observation) == ["pixels"]
    environment.observation_spec()["pixels"].validate(timestep.observation["pixels"])
    assert timestep.observation["pixels"].std() > 20


@pytest.mark.nightly
def test_a_hundred_thousand_random_steps_neither_warn_nor_leak(caplog):
    share = 100_000 // len(suite.ALL_TASKS)
    sizes = []
    for domain, task in suite.ALL_TASKS:
        environment = suite.load(domain, task, task_kwargs={"random": 0, "visuals": False})
        rng = np.random.default_rng(0)
        timestep = environment.reset()
        for step in range(share):
            timestep = environment.step(random_action(environment, rng))
            if not timestep.first():
                assert np.isfinite(timestep.reward)
            assert all(np.isfinite(value).all() for value in timestep.observation.values())
            if step in (share // 2, share - 1):
                gc.collect()
                sizes.append(resident_memory())
        assert not environment.physics.data.warning.number.any()
        assert sizes[-1] - sizes[-2] < 2**20, f"{domain} {task} grew by {sizes[-1] - sizes[-2]} bytes"
        environment.close()
    assert not caplog.records


def resident_memory():
    with open("/proc/self/statm", encoding="ascii") as statm:
        return int(statm.read().split()[1]) * 4096
