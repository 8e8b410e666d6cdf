"""Fields of the model that resets write are each simulation's own, whatever the first of the resets draws."""

import gymnasium
import numpy as np
import pytest
from helpers.sweeps import groups_of

from kitchen_suite import suite
from kitchen_suite.gymnasium_env import FrankaKitchenEnv
from kitchen_suite.suite import DOMAINS
from kitchen_suite.vector_env import FrankaKitchenVectorEnv

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
