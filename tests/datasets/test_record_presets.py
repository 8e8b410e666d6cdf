"""Sets of demonstrations of `kitchen-record`."""

import re

import pytest

from kitchen_suite import suite
from kitchen_suite.commands import record
from kitchen_suite.episodes.recording import Recording

SHORT = ("--num_episodes=2", "--max_episode_steps=6", "--num_threads=1")


def digest_of(out):
    return re.search(r"digest of all arrays  ([0-9a-f]{64})\n", out).group(1)


@pytest.fixture
def record_set(run, tmp_path):
    def record_set(name, *flags):
        status, out, _ = run(record, f"--output={tmp_path / name}", *SHORT, *flags)
        assert status == 0
        return digest_of(out)

    return record_set


@pytest.mark.parametrize("preset", suite.DOMAINS["kitchen"].resolve("recording"))
def test_a_preset_gives_task_arguments_and_policy(tmp_path, preset):
    chosen = suite.DOMAINS["kitchen"].resolve("recording")[preset]
    (given,) = record.COMMAND.parse([f"--output={tmp_path}", f"--preset={preset}"])
    found = record.with_preset(given)
    assert (found["task_name"], found["policy"]) == (chosen["task_name"], chosen["policy"])
    assert found["task_kwargs"] == chosen.get("task_kwargs", {})
    assert found["num_episodes"] == chosen.get("num_episodes", 100)


@pytest.mark.full
def test_a_seed_and_a_command_are_the_set(record_set, tmp_path):
    """Whatever is played at once, and however often it is interrupted."""
    digest = record_set("one", "--preset=random_order", "--num_envs=1")
    assert record_set("other", "--preset=random_order", "--num_episodes=1") != digest
    assert record_set("other", "--preset=random_order") == digest
    assert record_set("third", "--preset=random_order", "--seed=1") != digest
    arrays = Recording.open(tmp_path / "one").load(0).arrays
    assert arrays["observation/requested_tasks"].sum(axis=1).tolist() == [1.0] * 7


@pytest.mark.parametrize(
    ("preset", "flag", "shown"),
    [
        ("random", "--seed=0", ["'random_order'"]),
        ("fixed_order", "--task_name=kettle", ["'fixed_order'", "task_name"]),
        ("fixed_order", "--domain_name=open_cabinet", ["preset"]),
    ],
)
def test_bad_presets_are_refused_in_one_line(refusal, tmp_path, preset, flag, shown):
    error = refusal(record, f"--output={tmp_path / 'runs'}", *SHORT, f"--preset={preset}", flag)
    assert all(part in error for part in shown), error
