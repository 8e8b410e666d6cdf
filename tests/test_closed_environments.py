"""What has been closed may be closed again; what then cannot be used says that it is closed."""

import copy
import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ClosedEnvironmentError

from kitchen_suite import suite
from kitchen_suite.entities import build_kitchen_scene
from kitchen_suite.environment import Environment
from kitchen_suite.suite import DOMAINS
from kitchen_suite.tasks import KitchenTask


def load(**task_kwargs):
    environment = suite.load("open_cabinet", "top_drawer", {"visuals": False, "random": 0, **task_kwargs})
    environment.reset()
    return environment


def by_hand():
    return Environment(KitchenTask(build_kitchen_scene(visuals=False)), random_state=0)


@pytest.mark.parametrize("make", [load, pytest.param(by_hand, marks=pytest.mark.full)])
def test_an_environment_is_closed_twice(make):
    environment = make()
    environment.close()
    environment.close()


def test_an_environment_is_closed_as_a_context_and_before():
    with load() as environment:
        environment.close()


USES = {
    "step": lambda environment, state: environment.step(np.zeros(8)),
    "reset": lambda environment, state: environment.reset(),
    "start_episode": lambda environment, state: environment.start_episode(),
    "get_state": lambda environment, state: environment.get_state(),
    "set_state": lambda environment, state: environment.set_state(state),
    "physics": lambda environment, state: environment.physics,
    "deepcopy": lambda environment, state: copy.deepcopy(environment),
}


@pytest.mark.parametrize("steps", [0, 1])
@pytest.mark.parametrize("use", USES.values(), ids=USES)
def test_what_uses_a_closed_environment_raises_that_it_is_closed(use, steps):
    environment = load()
    for _ in range(steps):
        environment.step(np.zeros(8))
    state = environment.get_state()
    environment.close()
    with pytest.raises(ClosedEnvironmentError, match="build another one"):
        use(environment, state)


def test_specs_of_a_closed_environment_can_still_be_read():
    environment = load()
    specs = environment.action_spec(), environment.observation_spec(), environment.step_limit
    environment.close()
    assert (environment.action_spec(), environment.observation_spec(), environment.step_limit) == specs


@pytest.mark.full
@pytest.mark.parametrize("domain", DOMAINS)
@pytest.mark.parametrize("options", [{}, {"render_mode": "rgb_array"}, {"obs_type": "pixels"}], ids=str)
def test_gymnasium_environments_are_closed_twice(domain, options):
    env = gymnasium.make(DOMAINS[domain].env_id, **options)
    env.reset(seed=0)
    if env.render_mode:
        env.render()
    for _ in range(2):
        env.close()
    vectors = gymnasium.make_vec(DOMAINS[domain].env_id, 2, vectorization_mode="vector_entry_point", **options)
    vectors.reset(seed=0)
    if vectors.render_mode:
        vectors.render()
    for _ in range(2):
        vectors.close()
    with pytest.raises(ClosedEnvironmentError):
        vectors.step(vectors.action_space.sample())


# As after a close of the original, which frees the renderer alone.
@pytest.mark.full
def test_a_single_gymnasium_environment_continues_after_it_was_closed():
    kept, closed = (gymnasium.make("KitchenSuite/FrankaMicrowaveTable-v1", obs_type="pixels") for _ in range(2))
    for env in (kept, closed):
        env.reset(seed=0)
    closed.close()
    action = np.full(8, 0.1, np.float32)
    np.testing.assert_equal(closed.step(action), kept.step(action))
    kept.close()
    closed.close()


ORIGINAL = """
import gymnasium, kitchen_suite.original
env = gymnasium.make("FrankaKitchen-v1", tasks_to_complete=["kettle"], render_mode="rgb_array")
env.reset(seed=0)
env.render()
env.close()
env.close()
print("closed")
"""


@pytest.mark.full
def test_the_replacement_of_the_original_is_closed_twice():
    done = subprocess.run([sys.executable, "-W", "ignore", "-c", ORIGINAL], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["closed"]
