"""The environment: substeps made in one call, time limits, divergence, states, random streams."""

import dm_env
import numpy as np
import pytest
from dm_control import composer
from dm_control.composer.observation import observable
from dm_control.composer.variation import distributions, noises
from dm_control.entities.props.primitive import Primitive
from dm_control.rl import control
from helpers.errors import refused
from helpers.sweeps import brief

from kitchen_suite import suite
from kitchen_suite.entities import build_kitchen_scene
from kitchen_suite.environment import Environment
from kitchen_suite.environment.random_states import legacy_generator, make_random_state
from kitchen_suite.tasks import KitchenTask


def make_task(cls=KitchenTask, **options):
    return cls(build_kitchen_scene(visuals=False), **options)


def trajectory(environment, steps=20):
    rng = np.random.default_rng(0)
    timesteps = [environment.reset()]
    timesteps += [environment.step(rng.uniform(-1, 1, 9)) for _ in range(steps)]
    return [np.concatenate([value.ravel() for value in timestep.observation.values()]) for timestep in timesteps]


def count_physics_calls(environment):
    calls = []
    step = environment.physics.step
    environment.physics.step = lambda nstep=1: (calls.append(nstep), step(nstep))
    environment.step(np.zeros(9))
    return calls


@pytest.mark.full
@pytest.mark.parametrize("legacy_step", [True, False])
def test_it_steps_exactly_as_composer_does(legacy_step):
    ours = Environment(make_task(), random_state=1, legacy_step=legacy_step)
    stock = composer.Environment(make_task(), random_state=1, legacy_step=legacy_step)
    np.testing.assert_array_equal(trajectory(ours), trajectory(stock))


@pytest.mark.full
def test_all_substeps_are_one_call_without_substep_hooks_and_buffers():
    environment = Environment(make_task())
    environment.reset()
    assert count_physics_calls(environment) == [40]


class PropWithSubstepHook(Primitive):
    substeps = 0

    def after_substep(self, physics, random_state):
        self.substeps += 1


@pytest.mark.full
def test_an_entitys_substep_hook_is_called_for_each_substep():
    task, prop = make_task(), PropWithSubstepHook(geom_type="sphere", size=(0.02,), name="ball")
    task.scene.attach(prop)
    environment = Environment(task)
    environment.reset()
    assert count_physics_calls(environment) == [1] * 40
    assert prop.substeps == 40


@pytest.mark.full
def test_a_users_substep_hook_is_called_for_each_substep_even_when_added_late():
    environment = Environment(make_task())
    environment.reset()
    environment.step(np.zeros(9))
    times = []
    environment.add_extra_hook("after_substep", lambda physics, random_state: times.append(physics.time()))
    environment.step(np.zeros(9))
    np.testing.assert_allclose(times, 0.08 + 0.002 * np.arange(1, 41))


@pytest.mark.full
@pytest.mark.parametrize(
    "settings", brief([{"buffer_size": 5}, {"update_interval": 10}, {"delay": 3}], kept=[{"delay": 3}])
)
def test_an_observable_that_needs_them_sees_every_substep(settings):
    def make(cls):
        task = make_task()
        clock = observable.Generic(lambda physics: np.array([physics.time()]), **settings)
        clock.enabled = True
        task.observed["clock"] = clock
        return cls(task, random_state=1)

    ours, stock = make(Environment), make(composer.Environment)
    for environment in (ours, stock):
        environment.reset()
    for _ in range(3):
        one, other = (environment.step(np.zeros(9)).observation["clock"] for environment in (ours, stock))
        np.testing.assert_array_equal(one, other)
    assert count_physics_calls(ours) == [1] * 40


def test_an_observable_enabled_later_counts_from_the_next_reset():
    environment = Environment(make_task())
    prop = environment.task.scene.props["microwave"].observables.joint_positions
    prop.configure(enabled=True, buffer_size=2)
    assert environment.reset().observation["microwave/joint_positions"].shape == (2, 1)
    assert count_physics_calls(environment) == [1] * 40


@pytest.mark.parametrize("raise_exception", [True, False])
def test_after_a_divergence_the_next_step_starts_a_clean_episode(raise_exception):
    kwargs = {"raise_exception_on_physics_error": raise_exception}
    environment = suite.load("kitchen", "all", {"random": 0, "visuals": False}, kwargs)
    environment.reset()
    environment.step(np.zeros(9))
    environment.physics.data.qvel[0] = np.nan
    if raise_exception:
        with pytest.raises(control.PhysicsError):
            environment.step(np.zeros(9))
    else:
        timestep = environment.step(np.zeros(9))
        assert (timestep.step_type, timestep.reward, timestep.discount) == (dm_env.StepType.LAST, 0.0, 0.0)
    timestep = environment.step(np.zeros(9))
    assert timestep.first()
    assert all(np.isfinite(value).all() for value in timestep.observation.values())
    assert environment.step(np.zeros(9)).mid()


def test_a_true_end_has_discount_zero_and_then_a_new_episode_begins():
    options = {"goals": {"microwave": [0.2]}, "random": 0, "visuals": False}
    environment = suite.load("kitchen", "microwave", options)
    assert environment.reset().first()
    timestep = environment.step(np.zeros(9))
    assert (timestep.step_type, timestep.reward, timestep.discount) == (dm_env.StepType.LAST, 1.0, 0.0)
    assert environment.step(np.zeros(9)).first()
    assert environment.task.tasks_to_complete == ["microwave"]


def test_seeds_beyond_32_bits_are_folded_not_cut():
    draws = {make_random_state(seed).uniform() for seed in (3, 3 + 2**32, 3 + 2**33, 3 + 2**80)}
    assert len(draws) == 4
    assert make_random_state(3).uniform() == np.random.RandomState(3).uniform()


@pytest.mark.parametrize("seed", [0, 3, 2**40 + 7])
def test_a_legacy_generator_draws_what_the_seed_draws(seed):
    wrapped = np.random.RandomState(legacy_generator(seed).bit_generator)
    expected = make_random_state(seed)
    for _ in range(3):
        np.testing.assert_array_equal(wrapped.uniform(-1.0, 1.0, 59), expected.uniform(-1.0, 1.0, 59))
        assert wrapped.normal() == expected.normal()


def test_a_recompiling_environment_gives_the_same_episode():
    once, always = (
        suite.load("kitchen", "all", {"random": 0, "visuals": False}, {"recompile_mjcf_every_episode": recompile})
        for recompile in (False, True)
    )
    np.testing.assert_array_equal(trajectory(once, 3), trajectory(always, 3))


def test_a_fixed_initial_state_repeats_itself():
    environment = suite.load("kitchen", "all", {"random": 0, "visuals": False}, {"fixed_initial_state": True})
    np.testing.assert_array_equal(trajectory(environment, 3), trajectory(environment, 3))


@pytest.mark.full
@pytest.mark.parametrize("random", [5, np.random.RandomState(np.random.PCG64(5))])
def test_a_random_state_given_to_an_environment_with_a_fixed_initial_state_is_the_fixed_one(random):
    environment = suite.load("kitchen", "all", {"random": 0, "visuals": False}, {"fixed_initial_state": True})
    before = trajectory(environment, 3)
    environment.random_state = random
    after = trajectory(environment, 3)
    assert not np.array_equal(after, before)
    np.testing.assert_array_equal(trajectory(environment, 3), after)


@pytest.mark.full
@pytest.mark.parametrize("legacy_step", [True, False])
def test_a_state_brings_back_physics_task_and_random_stream(legacy_step):
    environment = Environment(make_task(), random_state=1, legacy_step=legacy_step, time_limit=1.0)
    trajectory(environment, 5)
    state = environment.get_state()
    expected = [environment.step(np.ones(9)) for _ in range(10)]
    environment.set_state(state)
    for before in expected:
        after = environment.step(np.ones(9))
        assert after.step_type == before.step_type
        for key, value in before.observation.items():
            np.testing.assert_array_equal(after.observation[key], value)


@pytest.fixture(scope="module")
def environment():
    return Environment(make_task(), random_state=1)


@pytest.mark.full
def test_setting_a_state_returns_the_observation_of_that_moment():
    environment = Environment(make_task(), random_state=1, flat_observation=True)
    environment.reset()
    seen = environment.step(np.ones(9)).observation
    state = environment.get_state()
    environment.step(np.ones(9))
    np.testing.assert_array_equal(environment.set_state(state)["observations"], seen["observations"])


@pytest.mark.parametrize(
    ("spoil", "error", "shown"),
    [
        (lambda state: state.pop("physics"), ValueError, ["['physics']"]),
        (lambda state: state.update(physics=np.zeros(3)), ValueError, ["['physics']"]),
        (lambda state: state["task"].update(noise=np.full(59, np.nan)), ValueError, ["['noise']"]),
        (lambda state: state["physics"].fill(1e11), ValueError, ["must not exceed 1e"]),
        (lambda state: state.update(step_count=-5), ValueError, ["step_count", "0"]),
        (lambda state: state["task"].update(tasks="microwave"), ValueError, ["['tasks']"]),
        (lambda state: state["task"]["desired"].fill(1.0), ValueError, ["other goals"]),
        (lambda state: state["task"].update(target="far"), TypeError, ["['target']"]),
        (lambda state: state.update(random=np.random.default_rng().bit_generator.state), ValueError, ["MT19937"]),
        (lambda state: state.update(random=3), TypeError, ["['random']"]),
        (lambda state: state["random"].update(state={}), ValueError, ["is no state of a MT19937"]),
    ],
)
def test_a_broken_state_is_refused_and_changes_nothing(environment, spoil, error, shown):
    environment.reset()
    state = environment.get_state()
    spoil(state)
    before = environment.get_state()
    with refused(error, *shown):
        environment.set_state(state)
    np.testing.assert_array_equal(environment.get_state()["physics"], before["physics"])
    assert str(environment.get_state()["random"]) == str(before["random"])


@pytest.mark.full
def test_a_state_continues_the_stream_although_a_users_corruptor_draws():
    def make():
        environment = Environment(make_task(), random_state=1)
        prop = environment.task.scene.props["microwave"].observables.joint_positions
        prop.configure(enabled=True, corruptor=noises.Additive(distributions.Uniform(-1.0, 1.0)))
        environment.reset()
        return environment

    environment = make()
    environment.step(np.ones(9))
    state = environment.get_state()
    expected = environment.step(np.ones(9)).observation
    other = make()
    other.set_state(state)
    found = other.step(np.ones(9)).observation
    for key, value in expected.items():
        np.testing.assert_array_equal(found[key], value)


def test_colours_follow_a_state():
    options = {"random": 0, "goals": {"microwave": [0.1]}, "terminate_on_tasks_completed": False}
    environment = suite.load("kitchen", "all", options, visualize_reward=True)
    environment.reset()
    door = environment.physics.bind(environment.task.scene.props["microwave"].mjcf_model.find("geom", "door_visual"))
    state, plain = environment.get_state(), door.rgba.copy()
    environment.step(np.zeros(9))
    assert not np.array_equal(door.rgba, plain)
    environment.set_state(state)
    np.testing.assert_array_equal(door.rgba, plain)
