"""Recordings as Minari datasets: read back, and recovered."""

import os
import sys
from pathlib import Path

import gymnasium
import minari
import numpy as np
import pytest
from helpers.episodes import load_episode
from helpers.sweeps import brief_named
from minari.dataset.minari_dataset import MinariDataset

from kitchen_suite import installation
from kitchen_suite.commands import convert, record
from kitchen_suite.datasets.minari import write
from kitchen_suite.episodes.episode import flatten
from kitchen_suite.episodes.recording import Recording
from kitchen_suite.vector_env.base import SuiteVectorEnv

pytestmark = pytest.mark.full

KITCHEN = ["--num_threads=1", "--output=runs", "--num_episodes=3", "--num_envs=2", "--seed=5", "--max_episode_steps=5"]
ID = "kitchen-suite/random-v0"
DATASETS = {
    "goals by task": [],
    "flat goals": ['--task_kwargs={"goal_format": "flat"}'],
    "cabinet": ["--domain_name=open_cabinet", "--task_name=bottom_drawer"],
}


@pytest.fixture
def make(run, folder):
    """Records episodes and makes a dataset of them, in an empty folder; returns what the conversion does."""

    def make(*arguments, dataset=ID):
        run(record, *KITCHEN, *arguments)
        return run(convert, "runs", f"--dataset={dataset}")

    return make


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


def test_labels_of_actions_are_infos_of_the_steps_after_them(make):
    flags = ["--domain_name=open_cabinet", "--task_name=top_drawer", "--policy=takeover(latest=4)"]
    assert make(*flags)[0] == 0
    for index, episode in enumerate(minari.load_dataset(ID).iterate_episodes()):
        labels = recorded(index)[1]["label/is_intervention"]
        assert labels.any()
        assert episode.infos["is_intervention"].tolist() == [False, *labels]


@pytest.mark.parametrize("arguments", brief_named(DATASETS, kept=["goals by task", "cabinet"]))
def test_minari_reads_back_what_was_recorded(make, arguments, recwarn):
    status, out, err = make(*arguments)
    assert (status, err) == (0, "")
    assert out == f"dataset {ID} of runs in {os.getcwd()}/datasets/{ID}\n"
    assert not recwarn.list
    dataset = minari.load_dataset(ID)
    seeds = [about["seed"] for about in dataset.storage.get_episode_metadata(range(3))]
    assert (dataset.total_episodes, seeds) == (3, [5, 6, 7])
    assert dataset.total_steps == sum(len(episode.rewards) for episode in dataset)
    for index, episode in enumerate(dataset):
        _, expected = recorded(index)
        found = arrays_of(episode)
        assert found.keys() == expected.keys() - {"physics_state"}
        for name, array in found.items():
            assert expected[name].dtype == array.dtype, name
            np.testing.assert_array_equal(expected[name], array, name)


@pytest.mark.parametrize("arguments", brief_named(DATASETS, kept=["flat goals", "cabinet"]))
def test_the_recovered_environment_plays_an_episode_again(make, arguments):
    assert make(*arguments)[0] == 0
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


def test_a_dataset_holds_its_specification(make):
    assert make("--task_name=kettle", "--policy=zero")[0] == 0
    about = minari.list_local_datasets()[ID]
    assert about["algorithm_name"] == "zero"
    assert about["requirements"] == [f"mujoco=={minari_versions(about)['mujoco']}"]
    recording = about["kitchen_suite_recording"]
    assert (recording["task_name"], recording["policy"], recording["seed"]) == ("kettle", "zero", 5)
    assert {"kitchen-suite", "mujoco", "dm-control", "numpy"} < minari_versions(about).keys()
    assert minari.namespace.list_local_namespaces() == ["kitchen-suite"]


def minari_versions(about):
    return about["kitchen_suite_recording"]["versions"]


def test_names_need_no_namespace_and_no_episode_is_played_again(run, folder, monkeypatch):
    assert run(record, *KITCHEN)[0] == 0
    monkeypatch.setattr("kitchen_suite.gymnasium_env.base.SuiteEnv.reset", None)
    assert run(convert, "runs", "--dataset=random-v1")[::2] == (0, "")
    assert minari.load_dataset("random-v1").total_episodes == 3


def test_datasets_may_be_elsewhere(run, folder):
    assert run(record, *KITCHEN)[0] == 0
    assert run(convert, "runs", f"--dataset={ID}", "--data_path=elsewhere")[::2] == (0, "")
    assert os.path.isdir(f"elsewhere/{ID}/data")
    assert os.environ["MINARI_DATASETS_PATH"].endswith("datasets")
    with pytest.raises(ValueError, match="is not in Minari's folder of datasets"):
        write(Path("elsewhere/me/other-v0"), Recording.open(Path("runs")).spec, [])


def test_episodes_that_diverged_are_not_in_the_dataset(make, monkeypatch):
    step = SuiteVectorEnv.step_some

    def diverge(self, actions, mask):
        observations, rewards, terminations, truncations, infos = step(self, actions, mask)
        diverged = np.array([seed == 6 for seed in self.np_random_seed])
        return observations, rewards, terminations | diverged, truncations, infos | {"physics_error": diverged}

    monkeypatch.setattr(SuiteVectorEnv, "step_some", diverge)
    assert make()[::2] == (0, "")
    assert [about["seed"] for about in minari.load_dataset(ID).storage.get_episode_metadata(range(2))] == [5, 7]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        pytest.param(["--task_name=microwave"], "open the microwave door", marks=pytest.mark.nightly),
        (["--domain_name=open_cabinet"], "open the top drawer of the cabinet"),
    ],
)
def test_the_instruction_is_read_back(make, monkeypatch, arguments, sentence):
    monkeypatch.setattr("kitchen_suite.datasets.minari._CHUNK", 2)
    assert make(*arguments)[0] == 0
    metadata = minari.load_dataset(ID).storage.get_episode_metadata(range(3))
    assert [about["instruction"] for about in metadata] == [sentence] * 3
    assert [recorded(index)[0]["instruction"] for index in range(3)] == [sentence] * 3


def test_few_episodes_are_in_memory_at_once(make, monkeypatch):
    monkeypatch.setattr("kitchen_suite.datasets.minari._CHUNK", 2)
    sizes = []
    update = MinariDataset.update_dataset_from_buffer

    def count(self, buffer):
        sizes.append(len(buffer))
        update(self, buffer)

    monkeypatch.setattr(MinariDataset, "update_dataset_from_buffer", count)
    assert make()[0] == 0
    assert sizes == [2, 1]
    assert [episode.id for episode in minari.load_dataset(ID)] == [0, 1, 2]


def test_without_minari_the_message_names_what_to_install(make, monkeypatch):
    monkeypatch.setitem(sys.modules, "minari", None)
    status, out, err = make()
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert installation.install_command("record") in err


def test_the_environment_is_recovered_where_the_suite_is_not_imported_yet(make, monkeypatch):
    assert make()[0] == 0
    monkeypatch.setattr(gymnasium.envs.registration, "registry", {})
    environment = minari.load_dataset(ID).recover_environment()
    assert environment.spec.max_episode_steps == 5
    assert environment.unwrapped.info_format == "arrays"


def test_the_quality_of_episodes_is_kept(make):
    status, _, error = make("--domain_name=microwave_table", "--quality")
    assert status == 0, error
    for episode in minari.load_dataset(ID):
        energy = episode.infos["energy"]
        assert energy.shape == (6,)
        assert energy[0] == 0.0
        assert (np.diff(energy) > 0.0).all()
