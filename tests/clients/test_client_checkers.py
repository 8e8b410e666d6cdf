"""Gymnasium's and TorchRL's checkers take every domain and observation type; Minari records each of these.

The checker of Stable-Baselines3 is in its own module, as are the steps of training of each client.
"""

import gymnasium
import numpy as np
import pytest
from helpers.sweeps import OBSERVED, brief, once_per_observation_type

from kitchen_suite.suite import DOMAINS

pytestmark = [pytest.mark.clients, pytest.mark.rendering]

PICTURES = {"image_size": (24, 32), "render_quality": "fast"}


def make(domain, obs_type, **options):
    pictures = PICTURES if "pixels" in obs_type else {}
    arrays = {"info_format": "arrays"} if domain == "kitchen" else {}
    return gymnasium.make(DOMAINS[domain].env_id, obs_type=obs_type, **pictures, **arrays, **options)


@pytest.mark.filterwarnings("ignore::UserWarning")  # Observations without bounds, as the original's.
@pytest.mark.parametrize(("domain", "obs_type"), brief(OBSERVED, once_per_observation_type()))
def test_gymnasiums_checker_finds_no_errors(domain, obs_type):
    from gymnasium.utils.env_checker import check_env

    environment = make(domain, obs_type)
    check_env(environment.unwrapped, skip_render_check=True)
    environment.close()


@pytest.mark.parametrize(("domain", "obs_type"), brief(OBSERVED, once_per_observation_type()))
def test_torchrls_checker_finds_no_errors(domain, obs_type):
    from torchrl.envs import GymWrapper
    from torchrl.envs.utils import check_env_specs

    environment = GymWrapper(make(domain, obs_type))
    check_env_specs(environment)
    environment.close()


@pytest.mark.parametrize(("domain", "obs_type"), brief(OBSERVED, once_per_observation_type()))
def test_skrls_wrapper_takes_a_step(domain, obs_type):
    import torch
    from skrl.envs.wrappers.torch import wrap_env

    environment = wrap_env(make(domain, obs_type), verbose=False)
    observations, _ = environment.reset()
    stepped, rewards, *_ = environment.step(torch.zeros(1, environment.action_space.shape[0]))
    assert observations.shape == stepped.shape
    assert rewards.shape == (1, 1)
    environment.close()


@pytest.mark.filterwarnings("ignore::UserWarning")  # No `eval_env` is set.
@pytest.mark.parametrize(("domain", "obs_type"), brief(OBSERVED, once_per_observation_type()))
def test_minari_stores_what_was_observed(domain, obs_type, folder):
    import minari

    environment = minari.DataCollector(make(domain, obs_type, max_episode_steps=2), jpeg_encoding=False)
    observation, _ = environment.reset(seed=0)
    for _ in range(2):
        environment.step(np.zeros(environment.action_space.shape, np.float32))
    stored = environment.create_dataset("checks/all-v0")[0].observations
    environment.close()
    assert_first_is(stored, observation)


def assert_first_is(stored, observation):
    if isinstance(observation, dict):
        for key, part in observation.items():
            assert_first_is(stored[key], part)
    else:
        np.testing.assert_array_equal(stored[0], observation)
