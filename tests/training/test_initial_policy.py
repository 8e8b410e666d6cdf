"""Training that starts from a trained policy."""

import json

import numpy as np
import pytest
from helpers.errors import refused
from helpers.training import METADATA, SMALL, environments, learner

from kitchen_suite.commands import record, rollout, train
from kitchen_suite.episodes.spec import EnvironmentSpec
from kitchen_suite.policies import load_policy
from kitchen_suite.policies.files import shipped_as
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

    observations = np.random.default_rng(0).normal(size=(20, 25))
    taught = learner(envs, value_batches=1, initial_policy=policy)
    adopted = export_policy(taught.agent, METADATA)
    np.testing.assert_allclose(adopted(observations), policy(observations), rtol=1e-4, atol=1e-6)
    taught.start(0)
    taught.learn()
    np.testing.assert_array_equal(export_policy(taught.agent, METADATA)(observations), adopted(observations))
    taught.learn()
    assert (export_policy(taught.agent, METADATA)(observations) != adopted(observations)).any()


def test_the_policy_keeps_its_network_and_its_least_divisor_whatever_the_hyperparameters(envs, policy):
    observations = np.random.default_rng(0).normal(size=(20, 25))
    taught = learner(envs, initial_policy=policy, hidden=[4, 4], standardisation_epsilon=30.0)
    np.testing.assert_allclose(taught.export(METADATA)(observations), policy(observations), rtol=1e-3, atol=1e-6)
    assert taught.export(METADATA).layers == policy.layers


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


def test_another_action_scale_than_the_policys_is_refused(policy, tmp_path, capsys):
    policy.save(tmp_path / "initial.npz")
    scale = json.dumps({**SMALL, "action_scale": [0.02] * 8})
    flags = [f"--initial_policy={tmp_path / 'initial.npz'}", f"--hyperparameters={scale}", "--num_threads=1"]
    assert train.main(["--domain_name=open_cabinet", f"--output={tmp_path / 'run'}", *flags]) == 2
    assert "action_scale must be that of the initial policy" in capsys.readouterr().err


CLONED = ["--domain_name=open_cabinet", "--num_threads=1", "--eval_episodes=1", "--seed=5"]


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Demonstrations of the drawer, which the expert opens."""
    folder = tmp_path_factory.mktemp("recording") / "runs"
    task = ["--domain_name=open_cabinet", "--policy=expert", "--num_episodes=2"]
    assert record.main([*task, f"--output={folder}"]) == 0
    return folder


@pytest.fixture
def cloned(recording, tmp_path, capsys):
    """Returns a function that clones the demonstrations by `bc` and returns the file of the policy."""

    def cloned(name="clone", **changes):
        small = json.dumps({"width": 32, "blocks": 1, "chunk": 4, "batch_size": 64, **changes})
        flags = [f"--demonstrations={recording}", f"--output={tmp_path / name}", f"--hyperparameters={small}"]
        assert train.main([*CLONED, "--algorithm=bc", "--num_steps=200", "--eval_interval=200", *flags]) == 0
        capsys.readouterr()
        return tmp_path / name / "policy.npz"

    return cloned


def test_ppo_starts_from_a_clone_acts_as_it_and_learns_on(cloned, tmp_path, capsys):
    file = cloned()
    flags = [f"--initial_policy={file}", f"--output={tmp_path / 'run'}", f"--hyperparameters={json.dumps(SMALL)}"]
    assert train.main([*CLONED, *flags, "--num_steps=64"]) == 0
    assert "open_cabinet top_drawer, PPO" in capsys.readouterr().out
    clone, first = load_policy(file), load_policy(tmp_path / "run" / "policy.npz")
    assert (first.metadata["algorithm"], first.given.chunk, first.given.executed) == ("bc", 1, 1)
    assert first.metadata["hyperparameters"]["num_envs"] == SMALL["num_envs"]
    inputs = np.random.default_rng(0).normal(clone.mean, clone.deviation, (50, len(clone.mean)))
    expected = np.array([clone.predict(each)[0] for each in inputs])
    # The only batch trains the values alone.
    np.testing.assert_allclose(first(inputs), expected, atol=1e-4)
    assert train.main([*CLONED, *flags, "--num_steps=1024", "--resume"]) == 0
    last = load_policy(tmp_path / "run" / "seed_5" / "last_policy.npz")
    assert np.abs(last(inputs) - expected).max() > 1e-3
    assert rollout.main(["--domain_name=open_cabinet", f"--policy={file}", "--max_episode_steps=3"]) == 0


def test_a_clone_that_applies_several_actions_of_a_chunk_is_refused(cloned, tmp_path, capsys):
    file = cloned(executed=2)
    assert train.main([*CLONED, f"--initial_policy={file}", f"--output={tmp_path / 'run'}"]) == 2
    problem = f"PPO cannot start from {file}: it applies 2 actions of each chunk: clone again with executed 1"
    assert problem in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_a_clone_that_takes_pictures_is_refused():
    with refused(ValueError, 'was made with obs_type "pixels_agent_pos"'):
        ppo_start(shipped_as("pixels"), EnvironmentSpec.make("kitchen", "all", {}))


def ppo_start(path, spec):
    from kitchen_suite.training.ppo import load_initial_policy

    return load_initial_policy(path, spec)


def test_the_clone_of_the_whole_kitchen_starts_a_task_of_it():
    shipped = load_policy(shipped_as("kitchen"))
    arguments = {name: shipped.metadata["task_kwargs"][name] for name in ("extra_observables",)}
    spec = EnvironmentSpec.make("kitchen", "kettle", arguments)
    started = ppo_start(shipped_as("kitchen"), spec)
    many = environments(3, domain="kitchen", tasks_to_complete=["kettle"], **arguments)
    observations, _ = many.reset(seed=0)
    task = many.composer_task
    rows = [{name: values[i] for name, values in observations.items()} for i in range(3)]
    one = np.array([started(started.inputs(row, task)) for row in rows])
    np.testing.assert_allclose(started(started.inputs(observations, task)), one, rtol=1e-4, atol=1e-5)
    many.close()


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
