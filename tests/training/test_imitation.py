"""Behaviour cloning: learning from demonstrations in chunks of actions."""

import json
import re
import shutil

import numpy as np
import pytest
from helpers.errors import refused
from helpers.human_files import write_d4rl

from kitchen_suite import suite
from kitchen_suite.commands import convert, evaluate, play, record, rollout, train
from kitchen_suite.policies import load_policy

pytestmark = pytest.mark.clients

SMALL = {"width": 32, "blocks": 1, "chunk": 4, "batch_size": 64}
INPUTS, ACTION = 5, 2


# Height and width of made-up pictures; odd, so that halves are rounded.
HEIGHT, SIDE = 15, 18


def demonstrations(count=20, length=30, *, cameras=()):
    """Returns made-up demonstrations, whose actions are smooth functions of the inputs, or are shown in pictures."""
    from kitchen_suite.training.demonstrations import Demonstrations

    inputs = np.random.default_rng(0).uniform(-1.0, 1.0, (count, length, INPUTS)).cumsum(axis=1).astype(np.float32)
    actions = np.tanh(inputs[..., :ACTION] / 3.0)
    if cameras:
        inputs = np.zeros_like(inputs)
    return Demonstrations(
        pictures={camera: drawn(actions.reshape(-1, ACTION)[:, number]) for number, camera in enumerate(cameras)},
        inputs=inputs.reshape(-1, INPUTS),
        actions=actions.reshape(-1, ACTION),
        last=np.repeat(np.arange(count) * length + length - 1, length),
    )


def drawn(values):
    """Returns pictures `(m, h, w, 3)` of rows as high as values `(m,)` in [-1, 1] say, in one colour."""
    rows = np.arange(HEIGHT) < (1.0 + values[:, np.newaxis]) * HEIGHT / 2.0
    pictures = np.zeros((len(values), HEIGHT, SIDE, 3), np.uint8)
    pictures[..., 1] = 255 * rows[:, :, np.newaxis]
    return pictures


def learner(num_steps=300, seed=0, cameras=(), **changes):
    import torch

    from kitchen_suite.training.bc import BCHyperparameters, BCLearner

    torch.set_num_threads(1)
    config = BCHyperparameters(**{**SMALL, **changes})
    return BCLearner(demonstrations(cameras=cameras), config, num_steps=num_steps, seed=seed)


def errors(policy):
    """Returns the mean absolute error of the first predicted actions."""
    shown = demonstrations()
    predicted = np.array([policy.predict(inputs)[0] for inputs in shown.inputs[::7]])
    return np.abs(predicted - shown.actions[::7]).mean()


METADATA = {"domain_name": "kitchen", "task_name": "all", "task_kwargs": {}}


def test_learning_lowers_the_error_of_the_exported_policy():
    taught = learner(num_steps=600, averaging=0.9)
    before = errors(taught.export(METADATA))
    while taught.steps < 600:
        assert np.isfinite([*taught.learn().values()]).all()
    assert errors(taught.export(METADATA)) < 0.5 * before


def test_a_learner_of_the_least_hyperparameters_learns_and_is_exported():
    taught = learner(
        num_steps=20, blocks=0, chunk=1, width=1, batch_size=1, averaging=0.0, features=1, shift=0, tint=0.0
    )
    assert np.isfinite([*taught.learn().values()]).all()
    policy = taught.export(METADATA)
    assert policy.network.blocks == ()
    assert np.isfinite(policy.predict(demonstrations().inputs[0])).all()


def test_an_exported_network_is_that_of_the_learner():
    import torch

    taught = learner()
    taught.learn()
    network = taught.export(METADATA).network
    values = np.random.default_rng(0).standard_normal((6, network.inputs), np.float32)
    with torch.no_grad():
        expected = taught.averaged.network(torch.as_tensor(values)).numpy()
    np.testing.assert_allclose(network(values), expected, rtol=1e-4, atol=1e-5)


CAMERAS = ("workspace", "franka/hand")


def test_policies_learn_from_pictures_alone():
    taught = learner(num_steps=800, cameras=CAMERAS, averaging=0.9, features=16, shift=1, tint=0.1)
    while taught.steps < 800:
        taught.learn()
    policy, shown = taught.export(METADATA), demonstrations(cameras=CAMERAS)
    assert policy.metadata["cameras"] == [*CAMERAS]
    assert policy.metadata["image_size"] == [HEIGHT, SIDE]
    predicted = np.array(
        [
            policy.predict(shown.inputs[i], [each[i] for each in shown.pictures.values()])[0]
            for i in range(0, len(shown.inputs), 7)
        ]
    )
    actions = shown.actions[::7]
    # The best that a policy could do that does not see.
    blind = np.abs(actions - np.median(actions, axis=0)).mean()
    assert np.abs(predicted - actions).mean() < 0.6 * blind


def test_an_exported_encoder_is_that_of_the_learner():
    import torch

    taught = learner(cameras=CAMERAS, features=16)
    taught.learn()
    for encoder, exported in zip(taught.averaged.encoders, taught.export(METADATA).encoders, strict=True):
        pictures = np.random.default_rng(0).integers(0, 256, (3, HEIGHT, SIDE, 3), np.uint8)
        with torch.no_grad():
            expected = encoder(torch.as_tensor(pictures) / 255).numpy()
        np.testing.assert_allclose([exported(each) for each in pictures], expected, rtol=1e-4, atol=1e-5)


def test_pictures_are_displaced_and_tinted_within_limits():
    import torch

    from kitchen_suite.training.bc import BCHyperparameters, augmented

    torch.manual_seed(0)
    pictures = torch.zeros((200, 9, 11, 3), dtype=torch.uint8)
    pictures[:, 4, 5] = 200
    moved = augmented(pictures, BCHyperparameters(shift=2, tint=0.0))
    _, rows, columns = np.nonzero(moved[..., 0].numpy())
    assert {*rows.tolist()} == {2, 3, 4, 5, 6}
    assert {*columns.tolist()} == {3, 4, 5, 6, 7}
    assert set(moved.unique().tolist()) == {0.0, np.float32(200 / 255).item()}
    tinted = augmented(pictures + 100, BCHyperparameters(shift=1, tint=0.1))
    change = tinted[:, 0, 0] - np.float32(100 / 255)
    # Of contrast 0.1 of the distance from the middle, and of brightness half of 0.1.
    assert change.abs().max() < 0.1 * abs(100 / 255 - 0.5) + 0.05
    assert change.std(dim=0).min() > 0.01
    assert (change[:, 0] - change[:, 1]).abs().max() > 0.01


def test_a_seed_determines_what_is_learned_and_a_state_continues_it():
    one, other = (_taught() for _ in range(2))
    state = other.state()
    resumed = learner(num_steps=200, seed=5)
    resumed.load_state(state)
    expected = _continued(one, state["random"]).arrays
    for name, array in _continued(resumed, state["random"]).arrays.items():
        np.testing.assert_array_equal(array, expected[name])


def _taught():
    taught = learner(num_steps=200)
    taught.learn()
    return taught


def _continued(taught, random):
    """Returns the policy after further steps from a random state of PyTorch, which has only one for all learners."""
    import torch

    torch.set_rng_state(random)
    taught.learn()
    return taught.export(METADATA)


def test_chunks_end_with_the_episode():
    shown = demonstrations(count=2, length=3)
    np.testing.assert_array_equal(
        shown.chunks(4), [[0, 1, 2, 2], [1, 2, 2, 2], [2, 2, 2, 2], [3, 4, 5, 5], [4, 5, 5, 5], [5, 5, 5, 5]]
    )


FLAGS = ["--domain_name=kitchen", "--num_steps=20", "--eval_interval=20", "--eval_episodes=1", "--num_threads=1"]
HYPERPARAMETERS = f"--hyperparameters={json.dumps(SMALL)}"


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """A recording of random actions in episodes that ask for some of three tasks; some of them count as successful."""
    folder = tmp_path_factory.mktemp("recording") / "runs"
    tasks = ["kettle", "microwave", "light switch"]
    arguments = {
        "tasks_to_complete": tasks,
        "tasks_per_episode": [1, 2],
        "threshold": {"kettle": 9.0, "microwave": 9.0},
    }
    flags = ["--task_name=all", f"--task_kwargs={json.dumps(arguments)}", "--policy=random", "--num_episodes=8"]
    assert record.main([f"--output={folder}", "--max_episode_steps=12", *flags]) == 0
    return folder, arguments


@pytest.fixture
def imitate(recording, run, tmp_path):
    def imitate(*flags, task_kwargs=None):
        folder, arguments = recording
        kwargs = json.dumps(arguments if task_kwargs is None else task_kwargs)
        own = [f"--output={tmp_path / 'run'}", f"--demonstrations={folder}", f"--task_kwargs={kwargs}", HYPERPARAMETERS]
        return run(train, *own, *FLAGS, "--task_name=all", *flags)

    return imitate


def test_demonstrations_of_other_tasks_are_refused_and_of_some_tasks_warned_of(imitate, recording, tmp_path):
    _, arguments = recording
    status, _, err = imitate("--algorithm=bc", "--task_name=top_burner", task_kwargs={})
    assert status == 2
    assert all(part in err for part in ("kitchen all", "kitchen top_burner"))
    assert not (tmp_path / "run").exists()
    more = {**arguments, "tasks_to_complete": [*arguments["tasks_to_complete"], "top burner"]}
    with pytest.warns(UserWarning, match="'top burner'"):
        assert imitate("--algorithm=bc", task_kwargs=more)[0] == 0


def test_a_run_trains_a_policy_that_observes_what_is_asked(imitate, tmp_path):
    flags = "--algorithm=bc", "--num_steps=120", "--eval_interval=120"
    assert imitate(*flags)[0] == 0
    policy = load_policy(tmp_path / "run" / "policy.npz")
    assert policy.given.tasks == ["kettle", "microwave", "light switch"]
    assert policy.metadata["algorithm"] == "bc"
    assert json.loads((tmp_path / "run" / "training.json").read_text())["algorithm"] == "bc"
    status, out, _ = imitate(*flags, "--resume")
    assert (status, "all steps were made" in out) == (0, True)


def test_a_run_is_not_resumed_with_other_demonstrations(imitate, tmp_path):
    # The scales of inputs and actions are those of the demonstrations, and the networks were fitted with them.
    flags, run = ("--algorithm=bc", "--num_demonstrations=1"), tmp_path / "run"
    hyperparameters = '--hyperparameters={"width": 8, "blocks": 1, "batch_size": 8}'
    assert imitate(*flags, hyperparameters)[0] == 0
    status, _, err = imitate(flags[0], hyperparameters, "--num_steps=40", "--resume")
    assert status == 2
    assert re.fullmatch(r"kitchen-train: [^\n]+on other data[^\n]+demonstrations[^\n]+\n", err)
    description = json.loads((run / "training.json").read_text())
    del description["data_sha256"]
    # Runs of an earlier version have no digest.
    (run / "training.json").write_text(json.dumps(description))
    assert imitate(flags[0], hyperparameters, "--num_steps=40", "--resume")[0] == 0


def test_a_run_without_draws_trains_a_policy_that_does_not_observe_what_is_asked(imitate, tmp_path):
    assert imitate("--algorithm=bc", "--num_demonstrations=2", task_kwargs={})[0] == 0
    policy = load_policy(tmp_path / "run" / "policy.npz")
    assert (policy.given.tasks, policy.given.state_size) == ([], 59)


BAD = {
    ("--algorithm=flow",): ["algorithm"],
    ("--algorithm=bc", "--demonstrations="): ["demonstrations"],
    ("--algorithm=bc", "--num_demonstrations=9"): ["9"],
    ("--algorithm=bc", '--training_kwargs={"sleep": true}'): ["training_kwargs", "'ppo'"],
    ("--algorithm=bc", "--initial_policy=policy.npz"): ["initial_policy", "'ppo'"],
    ("--algorithm=bc", "--control_mode=joint_position"): ["control_mode"],
    ("--algorithm=bc", '--hyperparameters={"widht": 3}'): ["'width'"],
    ("--algorithm=bc", '--hyperparameters={"flow_steps": 3}'): ["hyperparameter"],
    ("--algorithm=bc", '--hyperparameters={"executed": 9}'): ["executed", "8", "9"],
    ("--algorithm=bc", '--hyperparameters={"batch_size": 10000000000000}'): ["batch_size", "1048576"],
    ("--algorithm=bc", "--num_steps=0"): ["num_steps", "0"],
    ("--algorithm=bc", "--domain_name=open_cabinet", "--task_name=top_drawer"): ["kitchen"],
}


@pytest.mark.parametrize("flags", BAD)
def test_bad_arguments_are_refused_in_one_line(imitate, tmp_path, flags):
    kwargs = {} if "--domain_name=open_cabinet" in flags else None
    status, _, err = imitate(*flags, task_kwargs=kwargs)
    assert status == 2
    assert re.fullmatch(r"kitchen-train: [^\n]+\n", err)
    assert all(part in err for part in BAD[flags]), err
    assert not (tmp_path / "run").exists()


def test_a_diverged_run_ends_with_one_line():
    from kitchen_suite.training.run import DivergedError

    taught = learner(num_steps=100, weight_decay=1e38)
    with pytest.raises(DivergedError, match=r"after 100 steps .*lower the learning rate"):
        taught.learn()


def test_imitation_needs_demonstrations(tmp_path, capsys):
    assert train.main([f"--output={tmp_path / 'run'}", "--algorithm=bc"]) == 2
    assert "algorithm 'bc' needs demonstrations" in capsys.readouterr().err


def test_episodes_that_failed_are_left_out(recording):
    from kitchen_suite.episodes.recording import Recording
    from kitchen_suite.training.demonstrations import load_recording

    folder, _ = recording
    opened = Recording.open(folder)
    successful = [index for index in opened.indices if opened.load_summary(index).metrics["success"]]
    assert 0 < len(successful) < len(opened.indices)
    shown = load_recording(folder, opened.spec, ["kettle"])
    assert len(shown.actions) == sum(len(opened.load(index).arrays["action"]) for index in successful)
    assert {*shown.inputs[:, -1].tolist()} <= {0.0, 1.0}


def test_only_interventions_are_learned_from(tmp_path):
    from kitchen_suite.episodes.recording import Recording
    from kitchen_suite.training.demonstrations import load_recording, load_to_clone

    folder = tmp_path / "runs"
    flags = ["--task_name=kettle", "--num_episodes=4", "--num_threads=1", "--policy=takeover(latest=9)"]
    assert record.main([f"--output={folder}", "--variations=start", *flags]) == 0
    opened = Recording.open(folder)
    episodes = [opened.load(index).arrays for index in opened.indices]
    assert all(opened.load_summary(index).metrics["success"] for index in opened.indices)
    taught = [arrays["label/is_intervention"] for arrays in episodes]
    assert any(labels.argmax() > 0 for labels in taught)
    expected = np.concatenate([arrays["action"][labels] for arrays, labels in zip(episodes, taught, strict=True)])
    shown = load_recording(folder, opened.spec, ["kettle"])
    np.testing.assert_array_equal(shown.actions, expected)
    lengths = [int(labels.sum()) for labels in taught]
    np.testing.assert_array_equal(shown.last, np.repeat(np.cumsum(lengths) - 1, lengths))
    np.testing.assert_array_equal(load_to_clone(folder, opened.spec)[1], expected)
    for index in opened.indices:
        episode = opened.load(index)
        episode.arrays["label/is_intervention"][:] = False
        opened.remove(index)
        opened.append(episode)
    for load in (lambda: load_recording(folder, opened.spec, ["kettle"]), lambda: load_to_clone(folder, opened.spec)):
        with refused(ValueError, "never intervened"):
            load()


def test_chunks_end_where_an_intervention_does():
    from kitchen_suite.training.demonstrations import _last_of_stretches

    taught = [np.array(labels, bool) for labels in ([0, 1, 1, 0, 1], [1, 1, 0], [0, 0], [1])]
    np.testing.assert_array_equal(_last_of_stretches(taught), [1, 1, 2, 4, 4, 5])


def test_a_policy_names_its_extra_observables_and_the_default_layout(tmp_path, capsys):
    folder, run = tmp_path / "runs", tmp_path / "run"
    names = ["franka/base_pose", "microwave/pose", "microwave/handle_positions"]
    shared = ["--task_name=kettle", f"--task_kwargs={json.dumps({'extra_observables': names})}"]
    assert (
        record.main([f"--output={folder}", "--variations=layout", "--policy=expert", "--num_episodes=3", *shared]) == 0
    )
    quick = ["--num_steps=100", "--eval_interval=100", "--eval_episodes=1", "--algorithm=bc"]
    hyperparameters = f"--hyperparameters={json.dumps(SMALL)}"
    arguments = [f"--demonstrations={folder}", f"--output={run}", "--variations=layout"]
    assert train.main(["--domain_name=kitchen", *shared, *arguments, *quick, hyperparameters]) == 0
    policy = load_policy(run / "policy.npz")
    assert policy.given.extra_observables == {
        "franka/base_pose": 7,
        "microwave/pose": 7,
        "microwave/handle_positions": 3,
    }
    with suite.load("kitchen", "kettle", {"visuals": False, "extra_observables": names}) as environment:
        observed = environment.reset().observation
    assert policy.given.layout.keys() == {"franka/base_pose", "microwave/pose"}
    for name, values in policy.given.layout.items():
        np.testing.assert_array_equal(values, observed[name])


def test_episodes_that_are_not_finite_are_refused(recording, tmp_path):
    from kitchen_suite.episodes.recording import Recording
    from kitchen_suite.training.demonstrations import load_recording

    shutil.copytree(recording[0], tmp_path / "runs")
    opened = Recording.open(tmp_path / "runs")
    index = next(index for index in opened.indices if opened.load_summary(index).metrics["success"])
    episode = opened.load(index)
    episode.arrays["action"][0] = np.nan
    opened.remove(index)
    opened.append(episode)
    with pytest.raises(OSError, match=rf"episode_{index:06d}.* not finite"):
        load_recording(tmp_path / "runs", opened.spec, ["kettle"])


def test_several_recordings_are_learned_from_together(recording):
    from kitchen_suite.episodes.recording import Recording
    from kitchen_suite.training.demonstrations import load_demonstrations, load_recording

    folder, _ = recording
    spec, tasks = Recording.open(folder).spec, ["kettle"]
    one, two = (load_recording(folder, spec, tasks, count) for count in (1, 2))
    together = load_demonstrations([folder, folder], spec, tasks, [1, 2])
    np.testing.assert_array_equal(together.inputs, np.concatenate([one.inputs, two.inputs]))
    np.testing.assert_array_equal(together.actions, np.concatenate([one.actions, two.actions]))
    chunks = together.actions[together.chunks(3)]
    np.testing.assert_array_equal(chunks[len(one.actions) :], two.actions[two.chunks(3)])
    np.testing.assert_array_equal(chunks[: len(one.actions)], one.actions[one.chunks(3)])
    assert len(load_demonstrations([folder, folder], spec, tasks, [1]).actions) == 2 * len(one.actions)
    everything = load_demonstrations([folder, folder], spec, tasks, [])
    assert len(everything.actions) == 2 * len(load_recording(folder, spec, tasks).actions)


def test_numbers_of_demonstrations_are_as_many_as_folders(imitate, recording):
    folder, _ = recording
    status, _, err = imitate("--algorithm=bc", f"--demonstrations={folder},{folder}", "--num_demonstrations=1,2,3")
    assert status == 2
    assert "num_demonstrations has 3 numbers for 2 folders of demonstrations" in err


def test_policies_are_trained_on_positions_alone_where_velocities_were_not_recorded(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_d4rl("a.hdf5")
    assert convert.main(["a.hdf5", "--output=human"]) == 0
    hyperparameters = f"--hyperparameters={json.dumps(SMALL)}"
    arguments = ["--demonstrations=human", "--task_name=random_4", "--domain_name=kitchen", "--output=run"]
    quick = ["--num_steps=100", "--eval_interval=100", "--eval_episodes=1"]
    assert train.main([*arguments, "--algorithm=bc", hyperparameters, *quick]) == 0
    policy = load_policy(tmp_path / "run" / "policy.npz")
    # Nine joints of the robot, 21 positions of objects, seven tasks.
    assert policy.metadata["state_elements"] == [*range(9), *range(18, 39)]
    assert policy.layers[0] == 30 + 7
    inputs = np.arange(59.0 + 7)
    np.testing.assert_array_equal(policy.select(inputs), [*range(9), *range(18, 39), *range(59, 66)])
    capsys.readouterr()
    evaluated = ["--policy=trained(file='run/policy.npz')", "--num_episodes=2", "--max_episode_steps=3"]
    for task in ("random_4", "complete"):
        assert evaluate.main([*evaluated, f"--task_name={task}"]) == 0
    # Velocities are no input: others change nothing.
    one, other = (np.where(np.isin(np.arange(66), [*range(9, 18), *range(39, 59)]), value, 0.1) for value in (0.0, 9.0))
    first, second = (policy.predict(policy.select(each)) for each in (one, other))
    np.testing.assert_array_equal(first, second)


def test_reinforcement_learning_refuses_converted_demonstrations(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_d4rl("a.hdf5")
    assert convert.main(["a.hdf5", "--output=human"]) == 0
    kwargs = '{"tasks_per_episode": [1, 7], "terminate_on_tasks_completed": false}'
    capsys.readouterr()
    arguments = ["--domain_name=kitchen", "--task_name=all", f"--task_kwargs={kwargs}", "--demonstrations=human"]
    assert train.main([*arguments, "--output=run"]) == 2
    assert "human was made by kitchen-convert" in capsys.readouterr().err


PIXELS = {"obs_type": "pixels_agent_pos", "cameras": ["workspace"], "image_size": [24, 32], "render_quality": "fast"}


@pytest.mark.rendering
def test_a_run_learns_from_recorded_pictures(tmp_path, capsys):
    from kitchen_suite.episodes.spec import EnvironmentSpec
    from kitchen_suite.training.demonstrations import load_demonstrations

    folder, output = tmp_path / "pictures", tmp_path / "run"
    task = ["--domain_name=kitchen", "--task_name=light_switch", f"--task_kwargs={json.dumps(PIXELS)}"]
    assert record.main([f"--output={folder}", *task, "--policy=expert", "--num_episodes=2", "--num_envs=2"]) == 0

    def load(**changes):
        kwargs = {name: value for name, value in {**PIXELS, **changes}.items() if value}
        spec = EnvironmentSpec.make(domain_name="kitchen", task_name="light_switch", task_kwargs=kwargs)
        return load_demonstrations([folder], spec, (), ())

    for name, value in {"cameras": ["overview"], "image_size": [32, 24]}.items():
        with refused(ValueError, f"was made with {name}", json.dumps(value)):
            load(**{name: value})
    # The camera is the default one.
    shown = load(cameras=None)
    assert shown.state_elements == tuple(range(18))
    assert shown.pictures["workspace"].shape == (len(shown.actions), 24, 32, 3)
    with np.load(folder / "episode_000000.npz") as episode:
        np.testing.assert_array_equal(shown.pictures["workspace"][:2], episode["observation/pixels"][:2])
        np.testing.assert_array_equal(shown.inputs[:2], episode["observation/agent_pos"][:2].astype(np.float32))
    flags = ["--algorithm=bc", f"--demonstrations={folder}", "--num_steps=5", "--eval_interval=5", "--eval_episodes=1"]
    small = '--hyperparameters={"width": 8, "batch_size": 8, "features": 4}'
    assert train.main([*task, f"--output={output}", *flags, small]) == 0
    policy = output / "policy.npz"
    assert load_policy(policy).given.cameras == ["workspace"]
    assert play.main([f"--policy_file={policy}", "--novideo", "--num_episodes=1", "--max_episode_steps=3"]) == 0
    named = f"--policy=trained(file={str(policy)!r})"
    assert rollout.main([named, "--task_name=light_switch", "--num_episodes=1", "--max_episode_steps=3"]) == 2
    assert "the policy needs pictures of workspace, 32x24" in capsys.readouterr().err


@pytest.mark.parametrize(("algorithm", "obs_type"), [("ppo", "pixels_agent_pos"), ("bc", "pixels")])
def test_observations_that_no_policy_takes_are_refused(algorithm, obs_type, tmp_path, capsys):
    kwargs = json.dumps({"obs_type": obs_type, "image_size": [8, 8]})
    flags = [f"--task_kwargs={kwargs}", f"--algorithm={algorithm}", f"--demonstrations={tmp_path}"]
    assert train.main([f"--output={tmp_path / 'run'}", "--domain_name=kitchen", "--task_name=kettle", *flags]) == 2
    assert f"obs_type {obs_type!r} cannot be trained on with {algorithm!r}" in capsys.readouterr().err


@pytest.mark.parametrize("algorithm", ["ppo", "bc"])
def test_no_observation_type_is_the_default_one(algorithm):
    from kitchen_suite.episodes.spec import EnvironmentSpec
    from kitchen_suite.training.demonstrations import check_observed

    check_observed(EnvironmentSpec.make("kitchen", "kettle", {"obs_type": None}), algorithm)
