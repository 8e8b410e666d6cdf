"""Variations in recordings, replays, datasets and commands."""

import contextlib
import json
import shutil
from pathlib import Path

import minari
import numpy as np
import pytest
from helpers.episodes import load_episode
from helpers.sweeps import groups_of

from kitchen_suite import suite
from kitchen_suite.commands import convert, record, replay, rollout
from kitchen_suite.episodes.episode import flatten
from kitchen_suite.gymnasium_env import FrankaKitchenEnv
from kitchen_suite.tasks.variations.distributions import GROUPS

pytestmark = [pytest.mark.full, pytest.mark.usefixtures("folder")]

ID = "kitchen-suite/varied-v0"
SHORT = ["--num_envs=4", "--num_threads=1", "--num_episodes=3", "--max_episode_steps=2"]
VARIED = ["--task_name=all", "--variations=start,layout,dynamics,sensing", "--variation_split=held_out"]
# Layouts of these episodes are refused: two of the first one.
SEED = "--seed=34"
PREFIX = "info/variation_values/"


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """A folder with a recording and a dataset of it."""
    path = tmp_path_factory.mktemp("recording")
    with contextlib.chdir(path), pytest.MonkeyPatch.context() as patch:
        patch.setenv("MINARI_DATASETS_PATH", str(path / "datasets"))
        assert record.main(["--output=runs", *SHORT, *VARIED, SEED]) == 0
        assert convert.main(["runs", f"--dataset={ID}"]) == 0
    return path


@pytest.fixture
def recorded(recording, folder, tmp_path):
    """A copy of the recording, in the present folder."""
    shutil.copytree(recording, tmp_path, dirs_exist_ok=True)


def values_in(path):
    _, arrays = load_episode(path)
    return {name.removeprefix(PREFIX): array for name, array in arrays.items() if name.startswith(PREFIX)}


@pytest.mark.usefixtures("recorded")
def test_a_recording_keeps_the_values_the_groups_and_the_split():
    spec = json.loads(Path("runs/recording.json").read_text())
    assert spec["task_kwargs"] == {
        "variations": ["start", "layout", "dynamics", "sensing"],
        "variation_split": "held_out",
    }
    env = FrankaKitchenEnv(variations=GROUPS[:4], variation_split="held_out")
    for index in range(3):
        values = values_in(f"runs/episode_{index:06d}.npz")
        _, info = env.reset(seed=34 + index)
        assert values.keys() == info["variation_values"].keys()
        for name, rows in values.items():
            # The reset and two steps.
            np.testing.assert_array_equal(rows, np.stack([info["variation_values"][name]] * 3), name)
    _, arrays = load_episode("runs/episode_000000.npz")
    assert arrays["info/layout_refusals"].tolist() == [2] * 3


@pytest.mark.usefixtures("recorded")
def test_a_recording_replays_exactly(run):
    status, out, err = run(replay, "runs")
    assert (status, err) == (0, "")
    assert out.endswith("\n3 of 3 episodes are equal\n")


@pytest.mark.usefixtures("recorded")
def test_minari_reads_back_the_values_and_recovers_the_environment():
    dataset = minari.load_dataset(ID)
    env = dataset.recover_environment()
    for index, episode in enumerate(dataset):
        expected = values_in(f"runs/episode_{index:06d}.npz")
        found = flatten(episode.infos["variation_values"], "")
        assert {name.removeprefix("/") for name in found} == expected.keys()
        for name, rows in found.items():
            np.testing.assert_array_equal(rows, expected[name.removeprefix("/")])
        _, info = env.reset(seed=34 + index)
        np.testing.assert_array_equal(info["variation_values"]["kettle/mass"], expected["kettle/mass"][0])


def rewrite(index, name, value):
    """Replaces the recorded values of a parameter."""
    path = f"runs/episode_{index:06d}.npz"
    with np.load(path) as file:
        arrays = dict(file)
    rows = len(arrays["info/episode_step"])
    arrays[PREFIX + name] = np.broadcast_to(value, (rows, *np.shape(value)))
    np.savez_compressed(path, **arrays)


@pytest.mark.usefixtures("recorded")
@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("kettle/pose", [0.029, 0.029, 0.25]),
        ("franka/gain_scale", 0.81),
        ("sensing/object_noise", 2.5),
        ("microwave/yaw", 0.17),
    ],
)
def test_other_recorded_values_are_replayed_and_found_different(name, value, run):
    rewrite(1, name, value)
    status, out, _ = run(replay, "runs")
    assert (status, out.splitlines()[-1]) == (3, "2 of 3 episodes are equal")


@pytest.mark.usefixtures("recorded")
@pytest.mark.parametrize(
    ("name", "value"), [("kettle/mass", 9.0), ("kettle/mass", np.nan), ("kettle/burner", 0.5), ("kettle/mas", 1.0)]
)
def test_values_out_of_range_are_one_line(name, value, run):
    rewrite(1, name, value)
    status, _, err = run(replay, "runs")
    assert status in (1, 2)
    assert err.startswith("kitchen-replay: ")
    assert name in err
    assert err.count("\n") == 1


@pytest.mark.usefixtures("recorded")
def test_a_recording_is_extended_with_the_same_variations_only(refusal):
    whole = [load_episode(f"runs/episode_{index:06d}.npz")[1] for index in range(3)]
    Path("runs/episode_000001.npz").unlink()
    assert record.main(["--output=runs", *SHORT, *VARIED, SEED, "--num_episodes=4"]) == 0
    assert len([*Path("runs").glob("episode_*.npz")]) == 4
    for index, expected in enumerate(whole):
        np.testing.assert_equal(load_episode(f"runs/episode_{index:06d}.npz")[1], expected)
    for other in (["--variations=start"], [], [*VARIED, "--variation_split=seen"], VARIED[:2]):
        assert "task_kwargs" in refusal(record, "--output=runs", *SHORT, SEED, "--task_name=all", *other)


def test_json_describes_distributions_on_the_command_line(run):
    wanted = {"kettle/mass": {"uniform": [0.5, 0.6]}, "microwave/door": -0.1, "kettle/burner": {"choice": [0, 1]}}
    task = ["--task_name=kettle", f"--variations={json.dumps(wanted)}"]
    assert record.main(["--output=runs", *SHORT, *task]) == 0
    for index in range(3):
        values = values_in(f"runs/episode_{index:06d}.npz")
        assert values.keys() == wanted.keys()
        assert 0.5 <= values["kettle/mass"][0] <= 0.6
        assert values["microwave/door"].tolist() == [-0.1] * 3
        assert values["kettle/burner"][0] in (0, 1)
    assert json.loads(Path("runs/recording.json").read_text())["task_kwargs"] == {"variations": wanted}
    assert run(replay, "runs")[0] == 0


@pytest.mark.parametrize(
    ("domain", "policy"),
    [*((domain, "random") for domain in suite.DOMAINS if domain != "kitchen"), ("kitchen", "zero")],
)
def test_other_domains_and_rollouts_replay_exactly(domain, policy, run):
    groups = ",".join(group for group in groups_of(domain) if group not in ("appearance", "push"))
    task = [f"--domain_name={domain}", f"--policy={policy}", f"--variations={groups}"]
    assert record.main(["--output=runs", *SHORT, *task]) == 0
    assert rollout.main(["--output=episodes", "--num_episodes=2", "--max_episode_steps=2", *task]) == 0
    assert values_in("episodes/episode_000000.npz").keys() == values_in("runs/episode_000000.npz").keys()
    for name, count in (("runs", 3), ("episodes", 2)):
        status, out, _ = run(replay, name)
        assert (status, out.splitlines()[-1]) == (0, f"{count} of {count} episodes are equal")


def test_without_variations_recordings_have_no_new_names():
    for folder, extra in (("runs", []), ("other", ['--task_kwargs={"variations": []}'])):
        assert record.main([f"--output={folder}", *SHORT, "--task_name=kettle", *extra]) == 0
        _, arrays = load_episode(f"{folder}/episode_000000.npz")
        assert not [name for name in arrays if "variation" in name or "layout" in name]
    spec = json.loads(Path("runs/recording.json").read_text())
    assert spec["task_kwargs"] == {}
    np.testing.assert_equal(
        load_episode("runs/episode_000000.npz")[1], arrays | load_episode("other/episode_000000.npz")[1]
    )


BAD = {
    "--variations=strat": ["'strat'", "'start'"],
    "--variations=start,start": ["'start'"],
    "--variations={": ["variations", "JSON"],
    '--variations={"kettle/mas": 1}': ["'kettle/mas'", "'kettle/mass'"],
    '--variations={"kettle/mass": 9}': ["kettle/mass", "0.4", "1.5", "9.0"],
    '--variations={"kettle/mass": "heavy"}': ["kettle/mass", "heavy"],
    "--variation_split=test": ["seen", "held_out"],
    '--task_kwargs={"variations": 3}': ["variations", "3"],
}


@pytest.mark.parametrize("command", [record, rollout], ids=["record", "rollout"])
@pytest.mark.parametrize("flag", BAD)
def test_a_bad_flag_is_one_line(command, flag, refusal):
    error = refusal(command, "--output=new", "--num_episodes=1", "--max_episode_steps=1", flag)
    assert all(part in error for part in BAD[flag]), error
    assert not Path("new").exists()


@pytest.mark.parametrize(
    ("flags", "shown"),
    [
        (["--variations=start", '--task_kwargs={"variations": ["dynamics"]}'], ["['start']", "['dynamics']"]),
        (["--physics=fast", '--task_kwargs={"sleep": true}'], ["physics='fast'", "sleep"]),
    ],
)
def test_arguments_that_exclude_each_other_are_one_line(flags, shown, refusal):
    error = refusal(record, "--output=new", *SHORT, *flags)
    assert all(part in error for part in shown), error


def test_the_expert_names_the_observables_that_it_needs(run, refusal):
    task = ["--task_name=microwave", "--policy=expert", "--variations=layout"]
    needed = ["franka/base_pose", "microwave/pose"]
    error = refusal(record, "--output=runs", *SHORT, *task)
    assert f"extra_observables {needed}" in error
    assert len(error) < 1000
    kwargs = f"--task_kwargs={json.dumps({'extra_observables': needed})}"
    assert record.main(["--output=runs", *SHORT, *task, kwargs, "--num_episodes=1"]) == 0
    status, out, _ = run(replay, "runs")
    assert (status, out.splitlines()[-1]) == (0, "1 of 1 episodes are equal")
