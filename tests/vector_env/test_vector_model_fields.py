"""Fields of the model that resets write are each simulation's own, whatever the first of the resets draws."""

import gymnasium
import numpy as np
import pytest
from helpers.sweeps import groups_of

from kitchen_suite import suite
from kitchen_suite.entities import build_kitchen_scene
from kitchen_suite.gymnasium_env import FrankaKitchenEnv
from kitchen_suite.gymnasium_env.base import SuiteEnv
from kitchen_suite.suite import DOMAINS
from kitchen_suite.tasks import KitchenTask
from kitchen_suite.vector_env import FrankaKitchenVectorEnv
from kitchen_suite.vector_env.base import SuiteVectorEnv

# isort: split
from dm_control.entities.props.primitive import Primitive

LAYOUTS = {"variations": ["start", "layout", "dynamics"]}


@pytest.fixture
def first_seed(monkeypatch):
    """Sets the seed of every stream that is given none, which is the operating system's otherwise."""
    original = gymnasium.utils.seeding.np_random

    def seeded(number):
        monkeypatch.setattr(
            gymnasium.utils.seeding, "np_random", lambda seed=None: original(number if seed is None else seed)
        )

    return seeded


def fill_kettle(physics, random_state):
    """Gives the kettle a mass of its own in each episode [kg]."""
    physics.named.model.body_mass["kettle/kettle"] = random_state.uniform(0.5, 2.0)


class Water(Primitive):
    """A drop on the counter that fills the kettle at the start of an episode."""

    def initialize_episode(self, physics, random_state):
        fill_kettle(physics, random_state)


def build_scene_with_water(**options):
    scene = build_kitchen_scene(**options)
    scene.attach(Water(geom_type="sphere", size=(0.01,), name="water"), pos=(-0.65, -0.35, 1.7))
    return scene


def assert_kettles_are_filled_alike(envs, single):
    """Compares masses of the kettle after resets with those of a single environment, which differ."""
    masses = set()
    for seed in (0, 2):
        envs.reset(seed=seed)
        for i in range(2):
            single.reset(seed=seed + i)
            mass = single.environment.physics.model.body_mass
            np.testing.assert_array_equal(envs._episodes.batch.get_model(i).body_mass, mass)
            masses.add(single.environment.physics.named.model.body_mass["kettle/kettle"])
    assert len(masses) == 4


WATER = suite.Domain(
    "water_kitchen",
    scene=build_scene_with_water,
    task=KitchenTask,
    tasks={"kettle": {}},
    env_id="Mine/WaterKitchen-v1",
    episode_steps=280,
)


def test_masses_that_a_users_entity_writes_differ_from_environment_to_environment(monkeypatch):
    monkeypatch.setitem(suite._domains, WATER.name, WATER)
    single = SuiteEnv(domain=WATER.name)
    assert_kettles_are_filled_alike(SuiteVectorEnv(2, domain=WATER.name, num_threads=1), single)


def test_masses_that_an_extra_hook_writes_differ_from_environment_to_environment():
    envs = FrankaKitchenVectorEnv(2, num_threads=1)
    single = FrankaKitchenEnv()
    for environment in (envs.template_env.environment, single.environment):
        environment.add_extra_hook("initialize_episode", fill_kettle)
    assert_kettles_are_filled_alike(envs, single)


def written_fields(env, seeds):
    """Returns which arrays of the compiled model resets of a single environment change."""
    model = env.environment.physics.model.ptr
    names = [name for name in dir(model) if not name.startswith("_") and isinstance(getattr(model, name), np.ndarray)]
    built = {name: np.array(getattr(model, name)) for name in names}
    written = set()
    for seed in seeds:
        env.reset(seed=seed)
        written |= {name for name in names if not np.array_equal(built[name], getattr(model, name))}
    return written


@pytest.mark.full
@pytest.mark.parametrize("domain", DOMAINS)
def test_the_table_of_variations_names_all_fields_of_the_model_that_resets_write(domain):
    env = suite.DOMAINS[domain].env_class(domain=domain, variations=groups_of(domain), visuals=True)
    randomizer = env.composer_task.variations.randomizer
    assert written_fields(env, range(20)) <= {*randomizer.model_fields, *randomizer.visual_fields}


def assert_follows_single_environments(vector, single, resets):
    """Compares observations a few steps after resets."""
    env, singles = vector(2), [single(), single()]
    for seed in range(resets):
        env.reset(seed=2 * seed)
        actions = np.full(env.action_space.shape, 0.3)
        for _ in range(3):
            observations, *_ = env.step(actions)
        for i, one in enumerate(singles):
            one.reset(seed=2 * seed + i)
            for _ in range(3):
                observation, *_ = one.step(actions[i])
            np.testing.assert_array_equal(observations["observation"][i], observation["observation"])
    env.close()


@pytest.mark.full
def test_layouts_and_masses_vary_where_the_first_draw_moves_no_camera(first_seed):
    first_seed(4)
    assert_follows_single_environments(
        lambda count: FrankaKitchenVectorEnv(count, num_threads=1, **LAYOUTS), lambda: FrankaKitchenEnv(**LAYOUTS), 5
    )


@pytest.mark.nightly
@pytest.mark.parametrize("domain", DOMAINS)
def test_vectors_built_under_a_hundred_first_seeds_have_the_same_fields_and_reset(domain, first_seed):
    fields = set()
    for seed in range(100):
        first_seed(seed)
        env = suite.DOMAINS[domain].vector_env_class(2, domain=domain, num_threads=1, variations=groups_of(domain))
        before = {*env._episodes._model_fields}
        for number in range(4):
            env.reset(seed=1000 * seed + number)
        assert {*env._episodes._model_fields} == before
        fields.add(frozenset(before))
        env.close()
    assert len(fields) == 1
