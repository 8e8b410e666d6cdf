"""Recordings as Minari datasets: read back, recovered, whole or absent."""

import functools
import os
import subprocess
import sys
from pathlib import Path

import gymnasium
import minari
import numpy as np
import pytest
from helpers.episodes import left_behind, limited_files, load_episode
from helpers.sweeps import brief_named
from minari.dataset.minari_dataset import MinariDataset

from kitchen_suite import checks
from kitchen_suite.commands.commands import convert, record, replay
from kitchen_suite.datasets.formats import find_source
from kitchen_suite.episodes.episode import flatten
from kitchen_suite.vector_env.base import SuiteVectorEnv

pytestmark = pytest.mark.thorough

KITCHEN = ["--num_threads=1", "--output=runs", "--num_episodes=3", "--num_envs=2", "--seed=5", "--max_episode_steps=5"]
ID = "kitchen-suite/random-v0"
DATASETS = {
    "goals by task": [],
    "flat goals": ['--task_kwargs={"goal_format": "flat"}'],
    "cabinet": ["--domain_name=open_cabinet", "--task_name=bottom_drawer"],
}


@pytest.fixture
def run(run, folder):
    """Runs the command in an empty folder; returns status, stdout and stderr."""
    return functools.partial(run, record, *KITCHEN)


def recorded(index):
    return load_episode(f"runs/episode_{index:06d}.npz")


def arrays_of(episode):
    return {
        **flatten(episode.observations, "observation"),
        **flatten(episode.infos, "info"),
        "action": episode.actions,
        "reward": episode.rewards,
        "termination": episode.terminations,
        "truncation": episode.truncations,
    }


def test_labels_of_actions_are_infos_of_the_steps_after_them(run):
    flags = ["--domain_name=open_cabinet", "--task_name=top_drawer", "--policy=takeover(latest=4)"]
    assert run(f"--dataset={ID}", *flags)[0] == 0
    for index, episode in enumerate(minari.load_dataset(ID).iterate_episodes()):
        labels = recorded(index)[1]["label/is_intervention"]
        assert labels.any()
        assert episode.infos["is_intervention"].tolist() == [False, *labels]
        assert find_source(ID).load(index).labels["label/is_intervention"].tolist() == labels.tolist()
    assert replay.main([ID]) == 0


@pytest.mark.parametrize("arguments", brief_named(DATASETS, kept=["goals by task", "cabinet"]))
def test_minari_reads_back_what_was_recorded(run, arguments, recwarn):
    status, out, err = run(f"--dataset={ID}", *arguments)
    assert (status, err) == (0, "")
    assert out.endswith(f"\ndataset {ID} in {os.getcwd()}/datasets/{ID}\n")
    assert not recwarn.list
    dataset = minari.load_dataset(ID)
    seeds = [about["seed"] for about in dataset.storage.get_episode_metadata(range(3))]
    assert (dataset.total_episodes, seeds) == (3, [5, 6, 7])
    assert dataset.total_steps == sum(len(episode.rewards) for episode in dataset)
    for index, episode in enumerate(dataset):
        _, expected = recorded(index)
        found = arrays_of(episode)
        assert found.keys() == expected.keys()
        for name, array in expected.items():
            assert found[name].dtype == array.dtype, name
            np.testing.assert_array_equal(found[name], array, name)


@pytest.mark.parametrize("arguments", brief_named(DATASETS, kept=["flat goals", "cabinet"]))
def test_the_recovered_environment_plays_an_episode_again(run, arguments):
    assert run(f"--dataset={ID}", *arguments)[0] == 0
    dataset = minari.load_dataset(ID)
    environment = dataset.recover_environment()
    assert environment.observation_space == dataset.observation_space
    assert environment.action_space == dataset.action_space
    episode = dataset[1]
    observation, _ = environment.reset(seed=6)
    assert environment.observation_space.contains(observation)
    observations, steps = [flatten(observation, "observation")], []
    for action in episode.actions:
        observation, *step, _ = environment.step(action)
        observations.append(flatten(observation, "observation"))
        steps.append(step)
    for name, rows in flatten(episode.observations, "observation").items():
        np.testing.assert_array_equal(rows, [row[name] for row in observations], name)
    assert steps == list(map(list, zip(episode.rewards, episode.terminations, episode.truncations, strict=True)))
    assert episode.terminations[-1] or episode.truncations[-1]


def test_a_dataset_holds_its_specification(run):
    assert run(f"--dataset={ID}", "--task_name=kettle", "--policy=zero")[0] == 0
    about = minari.list_local_datasets()[ID]
    assert about["algorithm_name"] == "zero"
    assert about["requirements"] == [f"mujoco=={minari_versions(about)['mujoco']}"]
    recording = about["kitchen_suite_recording"]
    assert (recording["task_name"], recording["policy"], recording["seed"]) == ("kettle", "zero", 5)
    assert {"kitchen-suite", "mujoco", "dm-control", "numpy"} < minari_versions(about).keys()
    assert minari.namespace.list_local_namespaces() == ["kitchen-suite"]


def minari_versions(about):
    return about["kitchen_suite_recording"]["versions"]


def test_a_dataset_can_be_made_of_a_recording_that_is_there(run, monkeypatch):
    assert run()[0] == 0
    monkeypatch.setattr("kitchen_suite.episodes.spec.EpisodeSpec.make_vector_env", None)  # Nothing is played again.
    # Minari's ids need no namespace.
    assert run("--dataset=random-v1")[0] == 0
    assert minari.load_dataset("random-v1").total_episodes == 3
    before = os.stat("datasets/random-v1/data/main_data.hdf5").st_mtime_ns
    assert run("--dataset=random-v1")[0] == 0
    assert os.stat("datasets/random-v1/data/main_data.hdf5").st_mtime_ns == before


def test_a_dataset_of_an_interrupted_recording_is_not_taken_for_one_of_all(run):
    assert run()[0] == 0
    missing = Path("runs/episode_000001.npz")
    missing.rename("elsewhere.npz")
    assert convert.main(["runs", f"--dataset={ID}"]) == 0
    Path("elsewhere.npz").rename(missing)
    assert convert.main(["runs", f"--dataset={ID}"]) == 1
    status, _, err = run(f"--dataset={ID}")
    assert status == 1
    assert err == f"kitchen-record: dataset '{ID}' has other episodes of this recording: name another one\n"


def test_datasets_may_be_elsewhere(run):
    assert run(f"--dataset={ID}", "--data_path=elsewhere")[0] == 0
    assert os.path.isdir(f"elsewhere/{ID}/data")
    assert os.environ["MINARI_DATASETS_PATH"].endswith("datasets")


def test_a_dataset_that_holds_something_else_is_never_touched(run):
    assert run(f"--dataset={ID}")[0] == 0
    for arguments, message in {
        ("--num_episodes=4",): f"dataset '{ID}' exists and is of the first 3 episodes of this recording, not of 4",
        ("--output=others", "--seed=6"): f"dataset '{ID}' exists and holds another recording",
    }.items():
        status, out, err = run(f"--dataset={ID}", *arguments)
        assert (status, out, err.count("\n")) == (2, "", 1)
        assert message in err
    assert not os.path.exists("others")
    assert minari.load_dataset(ID).total_episodes == 3


def test_an_interrupt_while_a_dataset_is_made_leaves_none_of_it(run, monkeypatch, tmp_path):
    def interrupt(self, buffer):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(MinariDataset, "update_dataset_from_buffer", interrupt)
        status, _, err = run(f"--dataset={ID}")
    assert (status, err) == (
        130,
        "kitchen-record: interrupted after 3 of 3 episodes; the same command completes the recording\n",
    )
    assert os.listdir("datasets") == []
    # A file left by a killed process.
    (left_behind(tmp_path / "datasets" / "kitchen-record") / ID).mkdir(parents=True)
    assert run(f"--dataset={ID}")[0] == 0
    assert os.listdir("datasets") == ["kitchen-suite"]
    assert minari.load_dataset(ID).total_episodes == 3


@pytest.mark.parametrize("size", [2**10, 2**17], ids=["empty", "in the first episodes"])
def test_a_full_disk_ends_a_dataset_in_one_line_and_leaves_nothing(run, size):
    """HDF5 would end the process by a signal, so another one makes the dataset."""
    assert run()[0] == 0
    code = "from kitchen_suite.commands.commands import record; raise SystemExit(record())"
    with limited_files(size):
        command = [sys.executable, "-B", "-c", code, *KITCHEN, f"--dataset={ID}"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=100)
    assert (done.returncode, done.stderr.count("\n")) == (1, 1), done.stderr
    assert os.listdir("datasets") == []


def test_episodes_that_diverged_are_not_in_the_dataset(run, monkeypatch):
    step = SuiteVectorEnv.step_some

    def diverge(self, actions, mask):
        observations, rewards, terminations, truncations, infos = step(self, actions, mask)
        diverged = np.array([seed == 6 for seed in self.np_random_seed])
        return observations, rewards, terminations | diverged, truncations, infos | {"physics_error": diverged}

    monkeypatch.setattr(SuiteVectorEnv, "step_some", diverge)
    for _ in range(2):
        status, out, err = run(f"--dataset={ID}")
        assert (status, err) == (1, "kitchen-record: the physics diverged in 1 episodes, left out: seeds [6]\n")
        assert f"\ndataset {ID} in " in out
    assert [about["seed"] for about in minari.load_dataset(ID).storage.get_episode_metadata(range(2))] == [5, 7]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        pytest.param(["--task_name=microwave"], "open the microwave door", marks=pytest.mark.slow),
        (["--domain_name=open_cabinet"], "open the top drawer of the cabinet"),
    ],
)
def test_the_instruction_is_read_back(run, monkeypatch, arguments, sentence):
    monkeypatch.setattr("kitchen_suite.datasets.minari._CHUNK", 2)
    assert run(f"--dataset={ID}", *arguments)[0] == 0
    metadata = minari.load_dataset(ID).storage.get_episode_metadata(range(3))
    assert [about["instruction"] for about in metadata] == [sentence] * 3
    assert [recorded(index)[0]["instruction"] for index in range(3)] == [sentence] * 3
    assert [find_source(ID).load(index).instruction for index in range(3)] == [sentence] * 3
    assert [find_source("runs").load(index).instruction for index in range(3)] == [sentence] * 3


def test_few_episodes_are_in_memory_at_once(run, monkeypatch):
    monkeypatch.setattr("kitchen_suite.datasets.minari._CHUNK", 2)
    sizes = []
    update = MinariDataset.update_dataset_from_buffer

    def count(self, buffer):
        sizes.append(len(buffer))
        update(self, buffer)

    monkeypatch.setattr(MinariDataset, "update_dataset_from_buffer", count)
    assert run(f"--dataset={ID}")[0] == 0
    assert sizes == [2, 1]
    assert [episode.id for episode in minari.load_dataset(ID)] == [0, 1, 2]


def test_seeds_that_hdf5_cannot_hold_are_refused(run):
    status, _, err = run(f"--dataset={ID}", f"--seed={2**63 - 2}")
    assert (status, err) == (2, f"kitchen-record: seeds in a dataset may not exceed {2**63 - 1}, got {2**63}\n")
    assert run(f"--dataset={ID}", f"--seed={2**63 - 3}")[0] == 0
    assert [about["seed"] for about in minari.load_dataset(ID).storage.get_episode_metadata([2])] == [2**63 - 1]


def test_without_minari_the_message_names_what_to_install(run, monkeypatch):
    monkeypatch.setitem(sys.modules, "minari", None)
    status, out, err = run(f"--dataset={ID}")
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert checks.install_command("record") in err
    # Episodes alone need it not.
    assert run()[0] == 0


def test_the_environment_is_recovered_where_the_suite_is_not_imported_yet(run, monkeypatch):
    assert run(f"--dataset={ID}")[0] == 0
    monkeypatch.setattr(gymnasium.envs.registration, "registry", {})
    environment = minari.load_dataset(ID).recover_environment()
    assert environment.spec.max_episode_steps == 5
    assert environment.unwrapped.info_format == "arrays"
