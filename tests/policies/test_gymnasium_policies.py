"""A policy `gym:module:callable` gets the observations of the Gymnasium environment, and nothing else."""

import sys
import types

import gymnasium
import numpy as np
import pytest
from helpers.sweeps import OBSERVED, brief, once_per_observation_type

from kitchen_suite import policies, suite
from kitchen_suite.commands import evaluate, record, rollout
from kitchen_suite.gymnasium_env.observations import has_pictures
from kitchen_suite.suite import DOMAINS

SEED, STEPS = 5, 3
PICTURES = {"image_size": [16, 24], "render_quality": "fast", "cameras": ["overview", "franka/hand"]}


class Watcher:
    """A policy that makes the same action at each of the observations that it keeps.

    Attributes:
      observations: what it has been called with.
      size: of the action.
    """

    def __init__(self):
        self.observations = []
        self.size = 9

    def act(self, observation):
        self.observations.append(observation)
        return np.full(self.size, 0.25, np.float32)


@pytest.fixture
def watcher(monkeypatch):
    """The policy `gym:watching:act`."""
    watcher = Watcher()
    monkeypatch.setitem(sys.modules, "watching", types.SimpleNamespace(act=watcher.act))
    return watcher


def assert_same(one, other):
    if isinstance(one, dict):
        assert [*one] == [*other]
        for key in one:
            assert_same(one[key], other[key])
    else:
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other)


def played(environment, seed):
    """The observations before each action of the policy, in the Gymnasium environment."""
    observation, _ = environment.reset(seed=seed)
    for _ in range(STEPS):
        yield observation
        observation, *_ = environment.step(np.full(environment.action_space.shape, 0.25, np.float32))


def flags_of(domain, obs_type):
    kwargs = PICTURES if has_pictures(obs_type) else {}
    json = str(kwargs).replace("'", '"')
    return kwargs, [
        f"--domain_name={domain}",
        f"--task_kwargs={json}",
        f"--obs_type={obs_type}",
        f"--seed={SEED}",
        "--policy=gym:watching:act",
        f"--max_episode_steps={STEPS}",
        "--num_episodes=2",
    ]


@pytest.mark.full
@pytest.mark.rendering
@pytest.mark.parametrize(("domain", "obs_type"), brief(OBSERVED, once_per_observation_type()[::3]))
def test_recorded_policies_see_what_the_observation_type_shows(domain, obs_type, watcher, run, folder):
    kwargs, flags = flags_of(domain, obs_type)
    environment = gymnasium.make(
        DOMAINS[domain].task_ids[suite.default_task(domain)], obs_type=obs_type, max_episode_steps=STEPS, **kwargs
    )
    watcher.size = environment.action_space.shape
    # One environment, so that the calls of the two episodes come one after the other.
    assert run(record, "--output=recording", "--num_envs=1", *flags)[0] == 0
    for index in range(2):
        for expected in played(environment, SEED + index):
            found = watcher.observations.pop(0)
            assert environment.observation_space.contains(found)
            assert_same(found, expected)
    assert not watcher.observations
    environment.close()


@pytest.mark.full
@pytest.mark.parametrize(
    ("command", "flags"),
    [(rollout, []), (evaluate, ["--task_name=kettle", "--num_envs=2"]), (record, ["--output=recording"])],
    ids=["rollout", "evaluate", "record"],
)
@pytest.mark.parametrize("goal_format", ["dict", "flat"])
def test_all_commands_pass_observations(command, flags, goal_format, watcher, run, folder):
    status, _, error = run(
        command,
        *flags,
        "--policy=gym:watching:act",
        f'--task_kwargs={{"goal_format": "{goal_format}"}}',
        "--max_episode_steps=2",
        "--num_episodes=2",
    )
    assert status == 0, error
    assert len(watcher.observations) == 4
    goal_type = dict if goal_format == "dict" else np.ndarray
    assert {type(observation["achieved_goal"]) for observation in watcher.observations} == {goal_type}


def test_a_module_of_gyms_own_name_is_still_one(monkeypatch):
    monkeypatch.setitem(sys.modules, "gym", types.SimpleNamespace(act=lambda timestep: np.zeros(9)))
    environment = suite.load("kitchen", "kettle", {"visuals": False})
    policy = policies.find("gym:act")(environment, np.random.default_rng(0))
    assert policies.takes_of(policy) == "timestep"
    assert policy(environment.reset()).shape == (9,)


@pytest.mark.full
def test_an_error_of_the_policy_names_it(run, monkeypatch):
    monkeypatch.setitem(sys.modules, "failing", types.SimpleNamespace(act=lambda observation: observation["pixels"]))
    status, _, error = run(rollout, "--policy=gym:failing:act", "--num_episodes=1", "--max_episode_steps=2")
    assert status == 2
    assert "gym:failing:act" in error
    assert "pixels" in error


@pytest.mark.parametrize("name", ["gym:no_such_module:act", "gym:math:no_such_name", "gym:math:pi"])
def test_what_cannot_be_imported_or_called_is_refused_by_name(name, refusal):
    assert name.removeprefix("gym:") in refusal(rollout, f"--policy={name}")


def test_an_observation_type_is_given_once(refusal):
    error = refusal(rollout, "--obs_type=state", '--task_kwargs={"obs_type": "goal"}')
    assert "'state'" in error
    assert "'goal'" in error
