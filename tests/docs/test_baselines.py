"""The baselines of docs/baselines learn from a recording, and write receipts of their evaluations that hold."""

import json
import subprocess
import sys

import pytest
from docs_scripts import DOCS

from kitchen_suite import Evaluation
from kitchen_suite.commands import record, replay

pytestmark = pytest.mark.clients

BASELINES = DOCS / "baselines"
SHORT = ("--num_steps=4", "--eval_episodes=2", "--width=8", "--batch_size=8")


def run(name, *arguments, status=0):
    """Runs a baseline as a reader does; returns what it prints."""
    command = [sys.executable, str(BASELINES / f"{name}.py"), *map(str, arguments)]
    finished = subprocess.run(command, capture_output=True, text=True)
    assert finished.returncode == status, finished.stderr
    return finished.stdout + finished.stderr


@pytest.fixture(scope="module")
def demonstrations(tmp_path_factory):
    """A recording of two successful episodes of a task that is requested."""
    folder = tmp_path_factory.mktemp("demonstrations") / "kettle"
    task = ("--task_name=random_1", '--task_kwargs={"tasks_to_complete": ["kettle"]}', "--variations=start")
    flags = ("--policy=expert", "--num_episodes=2", "--num_threads=1")
    assert record.main([f"--output={folder}", *task, *flags]) == 0
    return folder


@pytest.fixture(scope="module")
def rewarded(tmp_path_factory):
    """A recording of two episodes, neither of which succeeds."""
    folder = tmp_path_factory.mktemp("set") / "mixed"
    flags = ("--preset=mixed", "--num_episodes=2", "--max_episode_steps=140", "--num_threads=1")
    assert record.main([f"--output={folder}", *flags]) == 0
    return folder


def assert_evaluated(output):
    """Asserts that a baseline has written scores, and a receipt that `kitchen-replay` finds equal."""
    scores = json.loads((output / "evaluation.json").read_text(encoding="utf-8"))
    assert scores["num_episodes"] == 2
    assert 0.0 <= scores["success"] <= 1.0
    assert replay.main([str(output / "receipt.npz")]) == 0


@pytest.mark.nightly
def test_flow_matching_learns_from_demonstrations(demonstrations, tmp_path):
    output = tmp_path / "flow"
    run("flow", demonstrations, f"--output={output}", *SHORT)
    assert_evaluated(output)


def test_flow_matching_is_evaluated_in_another_task(demonstrations, tmp_path):
    output = tmp_path / "flow"
    run("flow", demonstrations, f"--output={output}", "--task_name=kettle", "--task_kwargs={}", *SHORT)
    assert_evaluated(output)
    assert json.loads((output / "evaluation.json").read_text(encoding="utf-8"))["task_name"] == "kettle"


def test_action_chunking_with_transformers_is_evaluated_under_a_protocol_of_the_board(demonstrations, tmp_path):
    output = tmp_path / "act"
    task = ("--task_name=random_4", '--task_kwargs={"variations": ["start"]}', "--protocol=clean")
    run("act", demonstrations, f"--output={output}", *task, *SHORT)
    assert_evaluated(output)
    evaluation = Evaluation.read(output / "receipt.npz")
    assert [*evaluation.plan.changes] == ["num_episodes"]


def test_implicit_q_learning_is_evaluated_under_a_protocol_of_the_board(rewarded, tmp_path):
    output = tmp_path / "iql"
    task = ("--task_name=random_4", '--task_kwargs={"variations": ["start"]}', "--protocol=clean")
    run("iql", rewarded, f"--output={output}", *task, *SHORT)
    assert_evaluated(output)
    evaluation = Evaluation.read(output / "receipt.npz")
    assert [*evaluation.plan.changes] == ["num_episodes"]


@pytest.mark.parametrize("extraction", [pytest.param("weights", marks=pytest.mark.nightly), "flow"])
def test_implicit_q_learning_learns_from_failed_episodes(rewarded, tmp_path, extraction):
    output = tmp_path / "iql"
    run("iql", rewarded, f"--output={output}", f"--extraction={extraction}", "--candidates=5", *SHORT)
    assert_evaluated(output)


def test_a_recording_without_success_is_named(rewarded, tmp_path):
    printed = run("flow", rewarded, f"--output={tmp_path / 'flow'}", *SHORT, status=1)
    assert f"{rewarded} holds 0 successful episodes, not one or more" in printed
