"""Policies by name: actions on bounded and unbounded specs, options, and a user's own."""

import sys
import types

import dm_env
import numpy as np
import pytest
from dm_env import specs
from helpers.errors import refused

from kitchen_suite import checks, policies, suite

START = dm_env.restart(observation={})


def build(name, minimum, maximum, size=8, seed=0):
    spec = specs.BoundedArray((size,), np.float64, minimum, maximum)
    task = types.SimpleNamespace(
        checked_action=lambda action: checks.vector(action, size, "action").copy(), hidden_keys=()
    )
    environment = types.SimpleNamespace(action_spec=lambda: spec, task=task)
    return policies.find(name)(environment, np.random.default_rng(seed))


def draw(policy, count=2000):
    return np.stack([policy(START) for _ in range(count)])


def test_random_is_uniform_within_the_bounds():
    actions = draw(build("random", [-1, 0], [1, 0.04], size=2))
    assert (actions >= [-1, 0]).all()
    assert (actions <= [1, 0.04]).all()
    # Five standard errors of the mean of 2,000 numbers uniform in [0, 1]: 5 * 0.2887 / sqrt(2000) = 0.032.
    np.testing.assert_allclose((actions.mean(axis=0) - [-1, 0]) / [2, 0.04], 0.5, atol=0.032)


def test_random_is_standard_normal_where_actions_are_unbounded():
    actions = draw(build("random", -np.inf, np.inf))
    # 16,000 numbers; five standard errors of their mean are 0.040, of their deviation 0.028.
    assert abs(actions.mean()) < 0.04
    assert abs(actions.std() - 1) < 0.028
    assert np.abs(actions).max() > 3


def test_random_differs_by_seed_only():
    one, same, other = (draw(build("random", -1, 1, seed=seed), 3) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, same)
    assert not np.array_equal(one, other)


@pytest.mark.parametrize("bound", [1.0, np.inf])
def test_zero_is_zero(bound):
    action = build("zero", -bound, bound)(START)
    np.testing.assert_array_equal(action, np.zeros(8))


def test_actions_become_float64_unrounded_and_are_copies(monkeypatch):
    buffer = np.full(8, 0.1, np.float32)
    module = types.SimpleNamespace(act=lambda timestep: buffer)
    monkeypatch.setitem(sys.modules, "module_of_a_user", module)
    action = build("module_of_a_user:act", -1, 1)(START)
    assert action.dtype == np.float64
    buffer[:] = 0
    np.testing.assert_array_equal(action, np.float64(np.float32(0.1)))


def test_importing_a_module_that_exits_does_not_exit(tmp_path, monkeypatch):
    tmp_path.joinpath("script_of_a_user.py").write_text("raise SystemExit(0)")
    monkeypatch.syspath_prepend(tmp_path)
    with refused(ValueError, "'script_of_a_user:act'"):
        policies.find("script_of_a_user:act")


@pytest.fixture(scope="module")
def kettle():
    return suite.load("kitchen", "kettle", {"visuals": False})


def test_the_expert_takes_options_by_name(kettle):
    policies.find("expert(speed=0.5, action_noise=0.1, jitter=0.01, threshold=0.15)")(kettle, np.random.default_rng(0))


MALFORMED = {
    "expert(0.5)": (),
    "expert(speed=fast)": (),
    "expert(speed=": (),
    "expert(**{})": (),
    "import os; expert()": (),
    "zero(speed=1)": ("zero",),
    "expert(speed=" + "-" * 50_000 + "1)": (),
    "expert(speed=" + "[" * 2_000 + "]" * 2_000 + ")": (),
    # Without quotes: the error has the name to write.
    "trained(file=runs/policy.npz)": ("trained(file='policy.npz')",),
}


@pytest.mark.parametrize("name", MALFORMED, ids=lambda name: name[:20])
def test_malformed_names_are_refused(name):
    with refused(ValueError, *MALFORMED[name]):
        policies.find(name)


def test_the_path_of_a_file_is_a_trained_policy():
    assert policies.PolicyRef.parse("runs/policy.npz") == policies.PolicyRef(
        text="trained(file='runs/policy.npz')", key="trained", options={"file": "runs/policy.npz"}
    )


def test_a_policy_that_exits_is_a_policy_error(kettle, monkeypatch):
    def act(timestep):
        raise SystemExit(0)

    monkeypatch.setitem(sys.modules, "module_of_a_user", types.SimpleNamespace(act=act))
    policy = policies.find("module_of_a_user:act")(kettle, np.random.default_rng(0))
    with pytest.raises(policies.PolicyError, match="raised SystemExit: 0"):
        policy(START)


def test_a_policy_with_an_instruction_is_assigned_the_sentence(monkeypatch):
    class Act:
        instruction = ""

        def __call__(self, timestep):
            return np.full(8, float(len(self.instruction)))

    class Constant(Act):
        instruction = property(lambda self: "")

    module = types.SimpleNamespace(act=Act(), constant=Constant(), bare=lambda timestep: np.zeros(8))
    monkeypatch.setitem(sys.modules, "module_of_a_user", module)
    policy, constant, bare = (build(f"module_of_a_user:{name}", -1, 1) for name in ("act", "constant", "bare"))
    policies.instruct(policy, lambda: "open")
    policies.instruct(bare, lambda: pytest.fail("it has no such attribute"))
    np.testing.assert_array_equal(policy(START), np.full(8, 4.0))
    with refused(policies.PolicyError, "'module_of_a_user:constant'"):
        policies.instruct(constant, lambda: "open")


@pytest.mark.parametrize(
    ("options", "shown"),
    [("speed=2", ["speed"]), ("sped=1", ["'sped'", "'speed'"]), ("jitter='much'", ["jitter", "'much'"])],
)
def test_options_that_the_expert_refuses_are_policy_errors(options, shown, kettle):
    with refused(policies.PolicyError, "expert(", *shown):
        policies.find(f"expert({options})")(kettle, np.random.default_rng(0))


class Named:
    """Returns its number, and counts the episodes that it starts."""

    def __init__(self, number):
        self._number, self.starts = number, 0

    def __call__(self, timestep):
        self.starts += timestep.first()
        return np.full(2, self._number)


@pytest.mark.parametrize("step", [0, 2, 9])
def test_a_policy_takes_over_at_a_step_as_if_an_episode_began(step):
    first, second = Named(1.0), Named(2.0)
    policy, timesteps = policies.Takeover(first, second, step), [START, *[dm_env.transition(0.0, {})] * 4]
    for _ in range(2):
        actions, labels = [], []
        for timestep in timesteps:
            actions.append(policy(timestep)[0])
            labels.append(policies.labels_of(policy)["is_intervention"])
        assert actions == [1.0 + (number >= step) for number in range(5)]
        np.testing.assert_array_equal(labels, np.array(actions) == 2.0)
    assert (first.starts, second.starts) == (2 * (step > 0), 2 * (step < 5))


def test_a_policy_without_labels_says_nothing():
    assert policies.labels_of(build("zero", -1, 1)) == {}


@pytest.mark.full
def test_the_expert_takes_over_from_a_trained_policy_at_a_step_of_the_seed():
    environment = suite.load("kitchen", "kettle", {"random": 0, "visuals": False})
    taken = []
    for seed in (1, 1, 2):
        policy = policies.find("takeover(latest=6, speed=0.9)")(environment, np.random.default_rng(seed))
        timestep, labels = environment.reset(), []
        for _ in range(8):
            timestep = environment.step(policy(timestep))
            labels.append(bool(policies.labels_of(policy)["is_intervention"]))
        assert labels == sorted(labels)
        assert labels[-1]
        taken.append(labels.index(True))
    assert taken[0] == taken[1] != taken[2]
    with pytest.raises(policies.PolicyError, match="latest"):
        policies.find("takeover(latest=-1)")(environment, np.random.default_rng(0))
