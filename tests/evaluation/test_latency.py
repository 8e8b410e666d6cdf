"""How long the answers of a policy take: printed with the scores, and in no file."""

import time

import numpy as np
import pytest

import kitchen_suite
from kitchen_suite import Evaluation
from kitchen_suite.commands.evaluate import main

SECONDS = 0.01
FLAGS = {"num_episodes": 3, "max_episode_steps": 4}


def slow(timestep):
    time.sleep(SECONDS)
    return np.zeros(9)


def slow_batch(observations):
    time.sleep(SECONDS)
    return np.zeros((len(observations["observation"]), 9))


@pytest.mark.parametrize(("policy", "takes"), [(slow, "timestep"), (slow_batch, "batch")])
def test_it_is_the_time_of_an_answer_whatever_the_number_of_environments(policy, takes):
    for num_envs in (1, 3):
        evaluation = kitchen_suite.evaluate(policy, takes=takes, num_envs=num_envs, **FLAGS)
        assert evaluation.answer_seconds.shape == (12,)
        # None is shorter than it has slept; that of three rows together would be thrice as long for one at a time.
        assert evaluation.answer_seconds.min() >= 0.9 * SECONDS
        median, late = evaluation.latency
        assert SECONDS * 0.9 <= median <= late
        assert median == np.median(evaluation.answer_seconds)


def test_no_file_has_times(tmp_path):
    evaluation = kitchen_suite.evaluate("zero", output=tmp_path / "runs", **FLAGS)
    assert evaluation.latency is not None
    for name in ("a.json", "a.npz"):
        evaluation.write(tmp_path / name)
        assert Evaluation.read(tmp_path / name).latency is None
    # All episodes are those of the folder, and the policy is not asked.
    resumed = kitchen_suite.evaluate("zero", output=tmp_path / "runs", resume=True, **FLAGS)
    assert resumed.latency is None
    assert resumed.as_json() == evaluation.as_json()


def test_the_command_prints_it_below_the_scores(capsys):
    assert main(["--policy=zero", "--num_episodes=2", "--max_episode_steps=3"]) == 0
    *_, last = capsys.readouterr().out.strip().splitlines()
    assert last.startswith("an answer of the policy took ")
    assert " ms (median), and 95 % at most " in last
