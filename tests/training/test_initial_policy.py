"""Training that starts from a trained policy."""

import json

import numpy as np
import pytest
from helpers.errors import refused
from helpers.training import METADATA, SMALL, environments, learner

from kitchen_suite.commands import train
from kitchen_suite.policies.perceptron import PerceptronPolicy

pytestmark = pytest.mark.clients


@pytest.fixture
def envs():
    made = environments(SMALL["num_envs"])
    yield made
    made.close()


@pytest.fixture
def policy(envs):
    """The policy of another seed, after two batches."""
    from kitchen_suite.training.ppo import export_policy

    taught = learner(envs, seed=1)
    taught.start(0)
    for _ in range(2):
        taught.learn()
    return export_policy(taught.agent, METADATA)


def test_a_learner_starts_with_the_actions_of_the_policy_and_trains_the_values_first(envs, policy):
    from kitchen_suite.training.ppo import export_policy

    taught, observations = learner(envs, value_batches=1), np.random.default_rng(0).normal(size=(20, 25))
    taught.adopt(policy)
    adopted = export_policy(taught.agent, METADATA)
    np.testing.assert_allclose(adopted(observations), policy(observations), rtol=1e-4, atol=1e-6)
    taught.start(0)
    taught.learn()
    np.testing.assert_array_equal(export_policy(taught.agent, METADATA)(observations), adopted(observations))
    taught.learn()
    assert (export_policy(taught.agent, METADATA)(observations) != adopted(observations)).any()


@pytest.mark.parametrize(
    ("changes", "shown"),
    [
        ({"hidden": [8, 8]}, ["[25, 8, 8]", "[25, 8, 8, 8]"]),
        ({"action_scale": [0.02] * 8}, ["action_scale"]),
        ({"standardisation_epsilon": 30.0}, ["standardisation_epsilon", "30.0"]),
    ],
)
def test_policies_of_other_networks_are_refused(envs, policy, changes, shown):
    with refused(ValueError, *shown):
        learner(envs, **changes).adopt(policy)


def test_a_run_evaluates_the_initial_policy_first(policy, tmp_path, capsys):
    policy.save(tmp_path / "initial.npz")
    arguments = [
        "--domain_name=open_cabinet",
        f"--output={tmp_path / 'run'}",
        f"--initial_policy={tmp_path / 'initial.npz'}",
        f"--hyperparameters={json.dumps(SMALL)}",
        *("--num_steps=64", "--eval_episodes=1", "--num_threads=1", "--seed=5"),
    ]
    assert train.main(arguments) == 0
    assert "seed 5: all steps were made" in capsys.readouterr().out
    # The only batch trains the values alone, so the policy is still the initial one.
    trained, observations = PerceptronPolicy.load(tmp_path / "run" / "policy.npz"), np.ones((1, 25))
    np.testing.assert_allclose(trained(observations), policy(observations), rtol=1e-4, atol=1e-6)
    without = [each for each in arguments if "initial_policy" not in each]
    assert train.main([*without, "--resume"]) == 2
    assert "on other data: pass the same" in capsys.readouterr().err


def test_a_policy_of_another_control_mode_is_refused(policy, tmp_path, capsys):
    # It has the same layers and scales, but its actions would mean something else.
    policy.save(tmp_path / "initial.npz")
    flags = ["--domain_name=open_cabinet", "--control_mode=joint_position", f"--output={tmp_path / 'run'}"]
    scale = json.dumps({**SMALL, "action_scale": policy.action_scale.tolist()})
    flags += [
        f"--initial_policy={tmp_path / 'initial.npz'}",
        f"--hyperparameters={scale}",
        "--num_threads=1",
        "--num_steps=64",
    ]
    assert train.main(flags) == 2
    assert 'was made with control_mode "joint_offset", but this run has "joint_position"' in capsys.readouterr().err


def test_a_policy_and_demonstrations_exclude_each_other(policy, tmp_path, capsys):
    policy.save(tmp_path / "initial.npz")
    flags = [f"--initial_policy={tmp_path / 'initial.npz'}", "--demonstrations=nowhere", f"--output={tmp_path / 'run'}"]
    assert train.main(flags) == 2
    assert "give one of them" in capsys.readouterr().err
