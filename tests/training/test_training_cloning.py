"""Behaviour cloning of demonstrations, and learning after it."""

import json
import re
import shutil

import numpy as np
import pytest
from helpers.training import METADATA, SMALL, environments, learner

from kitchen_suite.commands import play, record, train
from kitchen_suite.episodes.recording import Recording
from kitchen_suite.episodes.spec import EnvironmentSpec
from kitchen_suite.policies import PolicyRef

pytestmark = pytest.mark.clients

POLICY = """
import numpy as np

def act(timestep):
    observation = np.concatenate([*timestep.observation.values()])
    return 0.02 * np.tanh(observation[:8] - observation[8:16])
"""


def spec_of(domain_name, task_name, **task_kwargs):
    """Returns the specification of the environments that a run trains in."""
    return EnvironmentSpec.make(domain_name=domain_name, task_name=task_name, task_kwargs=task_kwargs)


@pytest.fixture(scope="module")
def demonstrations(tmp_path_factory):
    """A folder of six short episodes of the cabinet, whose actions are a function of the observations."""
    folder = tmp_path_factory.mktemp("demonstrations")
    folder.joinpath("policy_to_clone.py").write_text(POLICY)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.syspath_prepend(str(folder))
        arguments = ["--domain_name=open_cabinet", "--policy=policy_to_clone:act", "--num_episodes=6"]
        assert record.main([*arguments, "--max_episode_steps=150", "--output=episodes"]) == 0
    return folder / "episodes"


@pytest.fixture(scope="module")
def samples(demonstrations):
    from kitchen_suite.training.demonstrations import load_to_clone

    return load_to_clone(demonstrations, spec_of("open_cabinet", "top_drawer"))


@pytest.fixture
def make_learner():
    """Returns a function that makes learners."""
    opened = []

    def make(**changes):
        opened.append(environments(SMALL["num_envs"]))
        return learner(opened[-1], hidden=[32], clone_epochs=500, **changes)

    yield make
    for envs in opened:
        envs.close()


def test_demonstrations_are_observations_and_the_actions_taken_on_them(samples):
    observations, actions = samples
    assert (observations.shape, actions.shape) == ((6 * 150, 25), (6 * 150, 8))
    assert observations.dtype == actions.dtype == np.float32
    np.testing.assert_allclose(actions, 0.02 * np.tanh(observations[:, :8] - observations[:, 8:16]), atol=1e-7)


@pytest.mark.parametrize("part", ["observation", "action"])
def test_demonstrations_that_are_not_finite_are_refused(demonstrations, tmp_path, part):
    from kitchen_suite.training.demonstrations import load_to_clone

    shutil.copytree(demonstrations, tmp_path / "episodes")
    folder = Recording.open(tmp_path / "episodes")
    episode = folder.load(3)
    next(array for name, array in episode.arrays.items() if name.startswith(part))[2] = np.nan
    folder.remove(3)
    folder.append(episode)
    with pytest.raises(OSError, match=r"episode_000003.* not finite"):
        load_to_clone(tmp_path / "episodes", spec_of("open_cabinet", "top_drawer"))


def test_cloning_lowers_the_loss_and_the_policy_imitates(samples, make_learner):
    from kitchen_suite.training.ppo import export_policy

    clone = make_learner()
    losses = clone.imitate(*samples)
    assert len(losses) == 500
    assert losses[-1] < 0.1 * losses[0]
    observations, actions = samples
    errors = export_policy(clone.agent, METADATA)(observations) - actions
    # A policy that ignores its observations would leave all of the variance of the actions.
    assert (errors**2).mean() < 0.1 * actions.var(axis=0).mean()


def test_after_cloning_values_are_learned_before_the_policy_changes(samples, make_learner):
    clone = make_learner(value_batches=2, kl_target=0.008)
    clone.imitate(*samples)
    clone.start(0)

    def state():
        parts = {name: clone.agent.networks[name].state_dict() for name in ("policy", "value")}
        rate = clone.agent.optimizer.param_groups[0]["lr"]
        return {name: {key: value.clone() for key, value in part.items()} for name, part in parts.items()}, rate

    def changed(before, after):
        return any((before[key] != after[key]).any() for key in before)

    (before, rate), changes, rates = state(), [], []
    for _ in range(3):
        clone.learn()
        after, now = state()
        changes.append((changed(before["policy"], after["policy"]), changed(before["value"], after["value"])))
        rates.append(now)
        before = after
    assert changes == [(False, True), (False, True), (True, True)]
    # A frozen policy shows no divergence, which must not raise the learning rate.
    assert rates[:2] == [rate, rate]
    assert rates[2] != rate


ARGUMENTS = [
    "--domain_name=open_cabinet",
    f"--hyperparameters={json.dumps({**SMALL, 'clone_epochs': 3})}",
    "--num_steps=64",
    "--eval_episodes=1",
    "--num_threads=1",
]


def test_a_run_clones_first(demonstrations, tmp_path, capsys, monkeypatch):
    from kitchen_suite.training import ppo

    cloned, clone = [], ppo.clone

    def counted(agent, observations, *rest):
        cloned.append(len(observations))
        return clone(agent, observations, *rest)

    monkeypatch.setattr(ppo, "clone", counted)
    arguments = [*ARGUMENTS, f"--demonstrations={demonstrations}", f"--output={tmp_path / 'run'}"]
    assert train.main(arguments) == 0
    assert cloned == [6 * 150]
    # A resumed run has been cloned already.
    assert train.main([*arguments, "--resume", "--num_steps=128"]) == 0
    assert cloned == [6 * 150]
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("--task_name=bottom_drawer", "holds episodes of open_cabinet top_drawer, not of open_cabinet bottom_drawer"),
        ("--domain_name=kitchen", "not of kitchen complete"),
    ],
)
def test_demonstrations_of_another_task_are_refused(demonstrations, tmp_path, capsys, change, message):
    scale = json.dumps({**SMALL, "action_scale": [0.1] * (9 if "kitchen" in change else 8)})
    arguments = [f"--demonstrations={demonstrations}", f"--output={tmp_path / 'run'}", change]
    assert train.main([*ARGUMENTS, f"--hyperparameters={scale}", *arguments]) == 2
    assert message in capsys.readouterr().err
    assert not tmp_path.joinpath("run").exists()


def record_kitchen(folder, task_kwargs, task_name="kettle"):
    arguments = [f"--task_name={task_name}", "--policy=zero", "--num_episodes=1", "--max_episode_steps=3"]
    assert record.main([*arguments, f"--task_kwargs={json.dumps(task_kwargs)}", f"--output={folder}"]) == 0


@pytest.mark.parametrize("goal_format", ["dict", "flat"])
def test_demonstrations_that_do_not_fit_are_refused(tmp_path, capsys, goal_format):
    record_kitchen(tmp_path / "episodes", {"goal_format": goal_format, "tasks_to_complete": ["microwave"]})
    arguments = ["--task_name=kettle", f"--demonstrations={tmp_path / 'episodes'}"]
    scale = json.dumps({**SMALL, "action_scale": [0.1] * 9})
    arguments += [*ARGUMENTS, "--domain_name=kitchen", f"--hyperparameters={scale}", f"--output={tmp_path / 'run'}"]
    assert train.main(arguments) == 2
    err = capsys.readouterr().err
    assert 'was made with tasks_to_complete ["microwave"], but this run has ["kettle"]' in err


# Recorded with the first, trained with the second; the last says whether they mean the same.
OTHER_ARGUMENTS = {
    "nothing": ({}, {}, True),
    "the default named": ({"velocity_scale": 2.0}, {}, True),
    "noise": ({"object_noise_ratio": 0.0, "robot_noise_ratio": 0.0}, {}, True),
    "threshold": ({"threshold": 0.1}, {"threshold": 0.3}, True),
    "format of goals": ({"goal_format": "dict"}, {"goal_format": "flat"}, True),
    "velocities": ({"velocity_scale": 1.0}, {}, False),
    "feedback": ({}, {"feedback": "target"}, False),
    "the default's extra observables": ({"extra_observables": []}, {}, True),
    "extra observables": ({"extra_observables": ["franka/gripper_width"]}, {}, False),
    "pictures": ({"obs_type": "pixels"}, {}, False),
    "goals": ({"goals": {"microwave": [-0.5]}}, {}, False),
    "order of tasks": (
        {"tasks_to_complete": ["kettle", "microwave"]},
        {"tasks_to_complete": ["microwave", "kettle"]},
        False,
    ),
}


@pytest.mark.parametrize(("recorded", "trained", "same"), OTHER_ARGUMENTS.values(), ids=OTHER_ARGUMENTS)
def test_demonstrations_whose_numbers_mean_something_else_are_refused(tmp_path, recorded, trained, same):
    from kitchen_suite.training.demonstrations import load_to_clone

    episodes = spec_of("kitchen", "all", **recorded).episodes(PolicyRef.parse("zero"), seed=0)
    Recording.create(tmp_path, episodes)
    # A recording without episodes, which is refused only after its arguments have been compared.
    remedy = "record again without obs_type" if "obs_type" in recorded else "record and train with the same task_kwargs"
    message = "holds no episodes yet" if same else f"was made with .*, but this run has .*: {remedy}"
    with pytest.raises(ValueError, match=message):
        load_to_clone(tmp_path, spec_of("kitchen", "all", **trained))


@pytest.mark.parametrize("goal_format", ["dict", "flat"])
def test_kitchen_demonstrations_have_the_order_of_a_policys_observations(tmp_path, goal_format):
    from kitchen_suite.training.demonstrations import load_to_clone

    record_kitchen(tmp_path / "episodes", {"goal_format": goal_format})
    observations, actions = load_to_clone(tmp_path / "episodes", spec_of("kitchen", "kettle"))
    assert (observations.shape, actions.shape) == ((3, 59 + 2 * 7), (3, 9))
    # The desired goal comes last.
    from kitchen_suite.tasks import GOALS

    np.testing.assert_allclose(observations[:, -7:], np.tile(GOALS["kettle"].value, (3, 1)), atol=1e-6)


def test_goals_recorded_by_task_are_flattened_in_the_order_of_flat_goals(tmp_path):
    from kitchen_suite.training.demonstrations import load_to_clone

    # Neither the order of the alphabet nor that of all tasks.
    tasks, loaded = ["slide cabinet", "microwave", "kettle", "light switch"], []
    for goal_format in ("dict", "flat"):
        record_kitchen(tmp_path / goal_format, {"goal_format": goal_format, "tasks_to_complete": tasks}, "all")
        loaded.append(load_to_clone(tmp_path / goal_format, spec_of("kitchen", "all", tasks_to_complete=tasks)))
    (one, actions), (other, same_actions) = loaded
    assert one.shape == (3, 59 + 2 * (1 + 1 + 7 + 2))
    np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(actions, same_actions)


def test_without_steps_a_run_clones_evaluates_once_and_writes_the_policy(tmp_path, capsys):
    from kitchen_suite.policies.perceptron import PerceptronPolicy

    record_kitchen(tmp_path / "episodes", {})
    scale = json.dumps({**SMALL, "action_scale": [0.1] * 9, "clone_epochs": 3})
    task = ["--domain_name=kitchen", "--task_name=kettle", "--eval_episodes=2", "--num_threads=1"]
    arguments = [*task, f"--hyperparameters={scale}", f"--demonstrations={tmp_path / 'episodes'}"]
    arguments += [f"--output={tmp_path / 'run'}", "--num_steps=0"]
    assert train.main(arguments) == 0
    out, err = capsys.readouterr()
    assert len(re.findall(r"^ +0 +0 ", out, re.M)) == 1
    assert "seed 0: all steps were made" in out
    assert err == ""
    assert [path.name for path in tmp_path.glob("run/seed_0/checkpoint_*")] == ["checkpoint_000000000000.pt"]
    policy = PerceptronPolicy.load(tmp_path / "run" / "policy.npz")
    assert policy.metadata["training"]["steps"] == 0
    # It has been cloned: the recorded actions are zero, and the standardisation is that of the demonstrations.
    assert policy.mean.any()
    assert play.main([f"--policy_file={tmp_path / 'run' / 'policy.npz'}", "--novideo", "--num_episodes=1"]) == 0
    # A finished run stays as it is, and can learn from there.
    assert train.main([*arguments, "--resume"]) == 0
    capsys.readouterr()
    assert train.main([*arguments, "--resume", "--num_steps=64"]) == 0
    assert re.findall(r"^ +0 +(\d+) ", capsys.readouterr().out, re.M) == ["64"]


def test_large_actions_are_imitated_up_to_their_saturation(make_learner):
    clone = make_learner()
    observations = np.random.default_rng(0).normal(size=(600, 25)).astype(np.float32)
    actions = np.tile(50 * clone.agent.policy.scale.numpy(), (600, 1))
    losses = clone.imitate(observations, actions)
    # The first outputs are near zero, five units away.
    assert losses[0] <= 5.0**2 + 0.1
    assert losses[-1] < 2.0


def test_later_observations_do_not_change_the_standardisation_of_a_clone(make_learner):
    clone = make_learner()
    observations = np.random.default_rng(0).normal(size=(600, 25)).astype(np.float32)
    clone.imitate(observations, np.zeros((600, 8), np.float32))
    scaler = clone.agent.observation_scaler
    before = scaler.running_mean.clone()
    clone.start(0)
    clone.learn()
    np.testing.assert_allclose(scaler.running_mean.numpy(), before.numpy(), atol=1e-6)


def test_ppo_clones_several_recordings_together(demonstrations, samples, tmp_path, monkeypatch):
    from kitchen_suite.training import ppo

    cloned = []

    def keep(agent, *arrays):
        cloned.extend(arrays)
        raise KeyboardInterrupt

    monkeypatch.setattr(ppo, "clone", keep)
    folders = f"--demonstrations={demonstrations},{demonstrations}"
    assert train.main([*ARGUMENTS, folders, f"--output={tmp_path / 'run'}"]) == 130
    for found, one in zip(cloned[:2], samples, strict=True):
        np.testing.assert_array_equal(found, np.concatenate([one, one]))


def test_ppo_takes_no_number_of_demonstrations(demonstrations, tmp_path, capsys):
    flags = [f"--demonstrations={demonstrations}", "--num_demonstrations=2", f"--output={tmp_path / 'run'}"]
    assert train.main(flags) == 2
    assert "num_demonstrations is for the algorithm 'bc'" in capsys.readouterr().err
