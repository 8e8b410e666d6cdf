"""Copies and pickles of what `suite.load` returns continue as the original; what cannot be copied says what to do."""

import copy
import dataclasses
import functools
import pickle
import threading

import gymnasium
import numpy as np
import pytest
from dm_control.composer.variation import noises
from helpers.errors import refused
from helpers.sweeps import walk

from kitchen_suite import suite
from kitchen_suite.entities import build_kitchen_scene
from kitchen_suite.environment import Environment
from kitchen_suite.suite import DOMAINS
from kitchen_suite.tasks import KitchenTask

COPIES = {
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    "pickle": lambda environment: pickle.loads(pickle.dumps(environment)),
}
STEPS = 4


def load(domain, **task_kwargs):
    return suite.load(domain, suite.default_task(domain), {"visuals": False, "random": 3, **task_kwargs})


def assert_same(one, other):
    assert (one.step_type, one.reward, one.discount) == (other.step_type, other.reward, other.discount)
    assert [*one.observation] == [*other.observation]
    for key, value in one.observation.items():
        assert value.dtype == other.observation[key].dtype
        np.testing.assert_array_equal(value, other.observation[key])


def assert_continues_equally(environment, other, steps=STEPS):
    """The two make the same steps, and then start the same episode."""
    actions = walk(environment.action_spec(), steps, seed=1)
    for action in actions:
        assert_same(environment.step(action), other.step(action))
    assert_same(environment.reset(), other.reset())
    assert_same(environment.step(actions[0]), other.step(actions[0]))


@pytest.mark.full
@pytest.mark.parametrize("quality", [False, True])
def test_a_copy_has_the_arguments_of_the_environment(quality):
    given = {"render_quality": "fast", "visuals": True, "quality": quality}
    environment = load("microwave_table", **given)
    copied = copy.deepcopy(environment)
    assert {name: copied.origin.arguments[name] for name in given} == given
    assert bool(copied.task.quality) == quality


@pytest.mark.full
@pytest.mark.parametrize("copied", COPIES.values(), ids=COPIES)
@pytest.mark.parametrize("domain", DOMAINS)
def test_a_copy_in_mid_episode_continues_to_the_bit(domain, copied):
    environment = load(domain)
    environment.reset()
    for action in walk(environment.action_spec(), STEPS):
        environment.step(action)
    assert_continues_equally(environment, copied(environment))


OPTIONS = {
    "variations": {"variations": ["dynamics", "start"]},
    "control mode": {"control_mode": "ee_delta_pose", "time_limit": None},
    "environment": {"environment_kwargs": {"flat_observation": True, "fixed_initial_state": True}},
    "visuals": {"visuals": True},
}
CASES = [(domain, name) for domain in DOMAINS for name in OPTIONS]


@pytest.mark.full
@pytest.mark.parametrize(("domain", "name"), CASES)
def test_options_are_copied(domain, name):
    options = OPTIONS[name]
    environment_kwargs = options.get("environment_kwargs", {})
    task_kwargs = {name: value for name, value in options.items() if name != "environment_kwargs"}
    environment = suite.load(
        domain,
        suite.default_task(domain),
        {"visuals": False, "random": np.random.RandomState(5), **task_kwargs},
        environment_kwargs,
        visualize_reward=True,
    )
    environment.reset()
    environment.step(walk(environment.action_spec(), 1)[0])
    twin = copy.deepcopy(environment)
    assert repr(twin) == repr(environment)
    assert twin.task.visualize_reward
    assert_continues_equally(environment, twin)


@pytest.mark.full
@pytest.mark.parametrize("domain", ["kitchen", "kitchens", "pick_and_place"])
def test_the_fast_physics_is_copied(domain):
    environment = load(domain, physics="fast")
    environment.reset()
    assert_continues_equally(environment, copy.deepcopy(environment))


@pytest.mark.full
@pytest.mark.parametrize("domain", DOMAINS)
def test_a_copy_before_the_first_episode_starts_the_same_one(domain):
    environment = load(domain)
    twin = copy.deepcopy(environment)
    assert_same(environment.reset(), twin.reset())


def test_a_copy_of_an_episode_that_has_ended_starts_the_next_one():
    environment = load("open_cabinet", time_limit=0.1)
    timestep = environment.reset()
    while not timestep.last():
        timestep = environment.step(np.zeros(8))
    twin = copy.deepcopy(environment)
    first = twin.step(np.zeros(8))
    assert first.first()
    assert_same(environment.step(np.zeros(8)), first)


@pytest.mark.full
def test_copies_are_independent_and_can_be_copied_again():
    environment = load("open_cabinet")
    environment.reset()
    twin = copy.deepcopy(copy.deepcopy(environment))
    before = environment.get_state()
    for _ in range(STEPS):
        twin.step(np.full(8, 0.1))
    np.testing.assert_array_equal(environment.get_state()["physics"], before["physics"])


@pytest.mark.full
def test_changing_the_arguments_afterwards_does_not_change_copies():
    goals = {"kettle": [-0.2, 0.7, 1.6, 1.0, 0.0, 0.0, 0.0]}
    environment = suite.load("kitchen", "kettle", {"goals": goals, "visuals": False})
    environment.reset()
    goals["kettle"][0] = 0.5
    goal = copy.deepcopy(environment).task.mdp.goals.desired
    np.testing.assert_array_equal(goal, environment.task.mdp.goals.desired)


def make_by_hand():
    return Environment(KitchenTask(build_kitchen_scene(visuals=False)), random_state=0)


def edited(edit):
    environment = load("kitchen")
    environment.reset()
    edit(environment)
    return environment


def add_hook(environment):
    environment.add_extra_hook("after_step", lambda *args: None)


def enable_another(environment):
    part = next(part for part in environment.task.observables.values() if not part.enabled)
    part.enabled = True


def corrupt(environment):
    part = next(part for part in environment.task.observables.values() if part.enabled)
    part.corruptor = noises.Additive(0.1)


def change_friction(environment):
    environment.physics.model.geom_friction[:] *= 2.0


def change_gravity(environment):
    environment.task.root_entity.mjcf_model.option.gravity = [0.0, 0.0, -1.0]


class Locked(KitchenTask):
    """Takes an argument that cannot be copied."""

    def __init__(self, scene, *, lock, **arguments):
        super().__init__(scene, **arguments)
        self.lock = lock


def load_locked():
    domain = dataclasses.replace(DOMAINS["kitchen"], task=Locked)
    return domain.load(lock=threading.Lock(), visuals=False, random=0)


EDITS = {
    "built from a task": make_by_hand,
    "an argument that cannot be copied": load_locked,
    **{
        edit.__name__: functools.partial(edited, edit)
        for edit in (add_hook, enable_another, corrupt, change_friction, change_gravity)
    },
}


# Copies and pickles ask the same function.
@pytest.mark.full
@pytest.mark.parametrize("make", EDITS.values(), ids=EDITS)
@pytest.mark.parametrize(
    "copied", [copy.deepcopy, pytest.param(COPIES["pickle"], marks=pytest.mark.nightly)], ids=["deepcopy", "pickle"]
)
def test_what_a_copy_would_lose_is_refused_with_the_way_to_take(make, copied):
    environment = make()
    with refused(TypeError, "get_state", "set_state"):
        copied(environment)


@pytest.mark.full
def test_the_way_that_the_errors_name_continues_to_the_bit():
    environment, other = make_by_hand(), make_by_hand()
    for each in (environment, other):
        each.reset()
    environment.step(np.zeros(9))
    other.set_state(environment.get_state())
    assert_continues_equally(environment, other)


@pytest.mark.parametrize("domain", DOMAINS.values(), ids=DOMAINS)
def test_records_of_domains_are_pickled(domain):
    for twin in (pickle.loads(pickle.dumps(domain)), copy.deepcopy(domain)):
        assert twin == domain
        assert twin.task_ids == domain.task_ids


@pytest.mark.full
def test_vectors_cannot_be_copied_and_say_so():
    environments = gymnasium.make_vec(DOMAINS["open_cabinet"].env_id, 2, num_threads=1)
    for copied in COPIES.values():
        with refused(TypeError, "make_vec", "template_env"):
            copied(environments)
    assert_continues_equally(
        environments.template_env.environment, copy.deepcopy(environments.template_env).environment
    )
    environments.close()


@pytest.mark.full
@pytest.mark.parametrize("episode_seeds", [True, 3])
def test_a_copy_with_episode_seeds_and_another_control_step_plays_the_same_later_episodes(episode_seeds):
    options = {"random": 5, "visuals": False, "episode_seeds": episode_seeds, "control_timestep": 0.04}
    environment = suite.load("kitchen", "kettle", options)
    environment.reset()
    environment.step(np.zeros(9))
    copied = pickle.loads(pickle.dumps(environment))
    for _ in range(2):
        one, other = environment.step(np.ones(9)), copied.step(np.ones(9))
        np.testing.assert_array_equal(one.observation["object_positions"], other.observation["object_positions"])
        one, other = environment.reset(), copied.reset()
        np.testing.assert_array_equal(one.observation["object_positions"], other.observation["object_positions"])
