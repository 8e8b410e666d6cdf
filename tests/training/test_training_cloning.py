"""Cloning of demonstrations, and what becomes of the clone."""

import json

import numpy as np
import pytest
from training_reference import METADATA, SMALL, environments, learner

from kitchen_suite.cli import record, train

pytestmark = pytest.mark.clients

POLICY = """
import numpy as np

def act(timestep):
    shown = np.concatenate([*timestep.observation.values()])
    return 0.02 * np.tanh(shown[:8] - shown[8:16])
"""


@pytest.fixture(scope="module")
def demonstrations(tmp_path_factory):
    """A folder of six short episodes of the cabinet, in which actions follow from what is seen."""
    folder = tmp_path_factory.mktemp("demonstrations")
    folder.joinpath("policy_to_clone.py").write_text(POLICY)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.syspath_prepend(str(folder))
        arguments = ["--domain_name=open_cabinet", "--policy=policy_to_clone:act", "--num_episodes=6"]
        assert record.main([*arguments, "--max_episode_steps=150", "--output=episodes"]) == 0
    return folder / "episodes"


@pytest.fixture(scope="module")
def shown(demonstrations):
    from kitchen_suite.training.behaviour_cloning import load_demonstrations

    return load_demonstrations(demonstrations, "open_cabinet", "top_drawer")


@pytest.fixture
def pupil():
    """Makes learners."""
    made = []

    def make(**changes):
        made.append(environments(SMALL["num_envs"]))
        return learner(made[-1], hidden=[32], clone_epochs=500, **changes)

    yield make
    for envs in made:
        envs.close()


def test_demonstrations_are_what_was_seen_and_done(shown):
    observations, actions = shown
    assert (observations.shape, actions.shape) == ((6 * 150, 25), (6 * 150, 8))
    assert observations.dtype == actions.dtype == np.float32
    np.testing.assert_allclose(actions, 0.02 * np.tanh(observations[:, :8] - observations[:, 8:16]), atol=1e-7)


def test_cloning_lowers_the_loss_and_the_policy_imitates(shown, pupil):
    from kitchen_suite.training import agent as agents

    known, losses = pupil(), []
    known.imitate(*shown, losses.append)
    assert len(losses) == 500
    assert losses[-1] < 0.1 * losses[0]
    observations, actions = shown
    missed = agents.export(known.agent, METADATA)(observations) - actions
    # What is left of the variance of the actions; a policy that ignores what it sees leaves all of it.
    assert (missed**2).mean() < 0.1 * actions.var(axis=0).mean()


def test_after_cloning_values_are_learned_before_the_policy_changes(shown, pupil):
    known = pupil(value_batches=2, kl_target=0.008)
    known.imitate(*shown, lambda loss: None)
    known.start(0)

    def state():
        parts = {name: known.agent.models[name].state_dict() for name in ("policy", "value")}
        rate = known.agent.optimizer.param_groups[0]["lr"]
        return {name: {key: value.clone() for key, value in part.items()} for name, part in parts.items()}, rate

    def changed(before, after):
        return any((before[key] != after[key]).any() for key in before)

    (before, rate), changes, rates = state(), [], []
    for _ in range(3):
        known.learn()
        after, now = state()
        changes.append((changed(before["policy"], after["policy"]), changed(before["value"], after["value"])))
        rates.append(now)
        before = after
    assert changes == [(False, True), (False, True), (True, True)]
    # A policy that is held shows no divergence, which must not drive the rate up.
    assert rates[:2] == [rate, rate]
    assert rates[2] != rate


ARGUMENTS = [
    f"--hyperparameters={json.dumps({**SMALL, 'clone_epochs': 3})}",
    "--num_steps=64",
    "--eval_episodes=1",
    "--num_threads=1",
]


def test_a_run_clones_first(demonstrations, tmp_path, capsys, monkeypatch):
    from kitchen_suite.training import behaviour_cloning

    cloned, clone = [], behaviour_cloning.clone

    def noted(agent, observations, *rest):
        cloned.append(len(observations))
        clone(agent, observations, *rest)

    monkeypatch.setattr(behaviour_cloning, "clone", noted)
    arguments = [*ARGUMENTS, f"--demonstrations={demonstrations}", f"--output={tmp_path / 'run'}"]
    assert train.main(arguments) == 0
    assert cloned == [6 * 150]
    # What is resumed has been cloned already.
    assert train.main([*arguments, "--resume", "--num_steps=128"]) == 0
    assert cloned == [6 * 150]
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("--task_name=bottom_drawer", "holds episodes of open_cabinet top_drawer, not of open_cabinet bottom_drawer"),
        ("--env=kitchen", "not of kitchen complete"),
    ],
)
def test_demonstrations_of_another_task_are_refused(demonstrations, tmp_path, capsys, change, message):
    scale = json.dumps({**SMALL, "action_scale": [0.1] * (9 if "kitchen" in change else 8)})
    arguments = [f"--demonstrations={demonstrations}", f"--output={tmp_path / 'run'}", change]
    assert train.main([*ARGUMENTS, f"--hyperparameters={scale}", *arguments]) == 2
    assert message in capsys.readouterr().err
    assert not tmp_path.joinpath("run").exists()


def record_kitchen(folder, task_kwargs):
    arguments = ["--task_name=kettle", "--policy=zero", "--num_episodes=1", "--max_episode_steps=3"]
    assert record.main([*arguments, f"--task_kwargs={json.dumps(task_kwargs)}", f"--output={folder}"]) == 0


@pytest.mark.parametrize(
    ("task_kwargs", "message"),
    [
        ({}, 'record with --task_kwargs=\'{"goal_format": "flat"}\''),
        ({"goal_format": "flat", "tasks_to_complete": ["microwave"]}, "but this task has ((73,), (9,))"),
    ],
)
def test_demonstrations_that_do_not_fit_are_refused(tmp_path, capsys, task_kwargs, message):
    record_kitchen(tmp_path / "episodes", task_kwargs)
    arguments = ["--env=kitchen", "--task_name=kettle", f"--demonstrations={tmp_path / 'episodes'}"]
    scale = json.dumps({**SMALL, "action_scale": [0.1] * 9})
    arguments += [*ARGUMENTS, f"--hyperparameters={scale}", f"--output={tmp_path / 'run'}"]
    assert train.main(arguments) == 2
    assert message in capsys.readouterr().err


def test_kitchen_demonstrations_are_laid_out_as_a_policy_takes_them(tmp_path):
    from kitchen_suite.training.behaviour_cloning import load_demonstrations

    record_kitchen(tmp_path / "episodes", {"goal_format": "flat"})
    observations, actions = load_demonstrations(tmp_path / "episodes", "kitchen", "kettle")
    assert (observations.shape, actions.shape) == ((3, 59 + 2 * 7), (3, 9))
    # The desired goal comes last.
    from kitchen_suite.tasks import GOALS

    np.testing.assert_allclose(observations[:, -7:], np.tile(GOALS["kettle"].value, (3, 1)), atol=1e-6)


def test_great_actions_are_imitated_as_what_does_the_same(pupil):
    pupil = pupil()
    observations = np.random.default_rng(0).normal(size=(600, 25)).astype(np.float32)
    actions = np.tile(50 * pupil.agent.models["policy"].scale.numpy(), (600, 1))
    losses = []
    pupil.imitate(observations, actions, losses.append)
    # It begins at zero, five units away.
    assert losses[0] <= 5.0**2 + 0.1
    assert losses[-1] < 2.0


def test_what_a_clone_sees_later_does_not_change_how_it_sees(pupil):
    pupil = pupil()
    observations = np.random.default_rng(0).normal(size=(600, 25)).astype(np.float32)
    pupil.imitate(observations, np.zeros((600, 8), np.float32), lambda loss: None)
    scaler = pupil.agent.checkpoint_modules["observation_preprocessor"]
    before = scaler.running_mean.clone()
    pupil.start(0)
    pupil.learn()
    np.testing.assert_allclose(scaler.running_mean.numpy(), before.numpy(), atol=1e-6)
