"""Sets of demonstrations of `kitchen-record`."""

import re

import pytest

from kitchen_suite import suite
from kitchen_suite.cli.commands import record
from kitchen_suite.rollouts.folder import RecordingFolder
from kitchen_suite.settings import RecordSettings

SHORT = ("--num_episodes=2", "--max_episode_steps=6", "--num_threads=1")


def digest_of(out):
    return re.search(r"digest of all arrays  ([0-9a-f]{64})\n", out).group(1)


@pytest.fixture
def run(tmp_path, capsys):
    def run(name, *flags):
        status = record.main([f"--output={tmp_path / name}", *SHORT, *flags])
        return status, *capsys.readouterr()

    return run


@pytest.mark.parametrize("preset", suite.DOMAINS["kitchen"].resolve("recording"))
def test_a_preset_gives_task_arguments_and_policy(tmp_path, preset):
    chosen = suite.DOMAINS["kitchen"].resolve("recording")[preset]
    settings = RecordSettings(output=tmp_path, preset=preset, seed=3).with_preset
    assert (settings.task_name, settings.policy, settings.seed) == (chosen["task_name"], chosen["policy"], 3)
    assert settings.task_kwargs == chosen.get("task_kwargs", {})


def test_a_seed_and_a_command_are_the_set(run, tmp_path):
    """Whatever is played at once, and however often it is interrupted."""
    status, out, _ = run("one", "--preset=random_order", "--num_envs=1")
    assert status == 0
    again = run("other", "--preset=random_order", "--num_episodes=1")[1]
    assert digest_of(again) != digest_of(out)
    assert digest_of(run("other", "--preset=random_order")[1]) == digest_of(out)
    assert digest_of(run("third", "--preset=random_order", "--seed=1")[1]) != digest_of(out)
    arrays = RecordingFolder.open(tmp_path / "one").load(0).arrays
    assert arrays["observation/requested_tasks"].sum(axis=1).tolist() == [1.0] * 7


BAD = {
    ("--preset=random",): "did you mean 'random_order'?",
    ("--preset=fixed_order", "--task_name=kettle"): "preset 'fixed_order' fixes task_name",
    ("--preset=fixed_order", "--policy=zero"): "preset 'fixed_order' fixes policy",
    ("--preset=fixed_order", "--domain_name=open_cabinet"): "preset",
}


@pytest.mark.parametrize("flags", BAD)
def test_bad_presets_are_refused_in_one_line(run, flags):
    status, _, err = run("runs", *flags)
    assert status == 2
    assert BAD[flags] in err
