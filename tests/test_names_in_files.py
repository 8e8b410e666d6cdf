"""Files name no code: a module that a file names is not imported unless a person or a program names it as well."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from helpers.episodes import load_episode

from kitchen_suite import imports
from kitchen_suite.commands import record
from kitchen_suite.episodes.recording import Recording
from kitchen_suite.episodes.spec import EpisodeSpec
from kitchen_suite.policies.files import shipped_as

ROOT = Path(__file__).resolve().parent.parent

# Importing it leaves a file; it has a domain and a robot, both the suite's.
PLANTED = """
open("imported", "w").close()
from kitchen_suite.entities import KITCHEN_FRANKA as ROBOT
from kitchen_suite.suite import DOMAINS
DOMAIN = DOMAINS["kitchen"]
"""


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "runs"
    arguments = ["--num_threads=1", "--max_episode_steps=3", f"--output={folder}", "--num_episodes=1"]
    assert record.main(arguments) == 0
    return folder


@pytest.fixture
def place(runs, tmp_path):
    """A folder with a planted module, and copies of a recording and of a policy."""
    (tmp_path / "planted.py").write_text(PLANTED, encoding="utf-8")
    shutil.copytree(runs, tmp_path / "runs")
    shutil.copy(shipped_as("kettle"), tmp_path / "policy.npz")
    return tmp_path


def forge_recording(place, **changes):
    """Changes the specification in the folder, and its copy in the episode."""
    path = place / "runs" / "recording.json"
    record = json.loads(path.read_text("utf-8"))
    record = {**record, **changes, "task_kwargs": {**record["task_kwargs"], **changes.get("task_kwargs", {})}}
    path.write_text(json.dumps(record), encoding="utf-8")
    episode = place / "runs" / "episode_000000.npz"
    metadata, arrays = load_episode(episode)
    np.savez_compressed(episode, **arrays, metadata=json.dumps({**metadata, "recording": record}))


def forge_policy(place, **changes):
    metadata, arrays = load_episode(place / "policy.npz")
    metadata = {**metadata, **changes, "task_kwargs": {**metadata["task_kwargs"], **changes.get("task_kwargs", {})}}
    np.savez_compressed(place / "policy.npz", **arrays, metadata=json.dumps(metadata))


def run(place, *arguments):
    """Runs a command as a process in a folder; returns its status and stderr."""
    # A console script, which does not look for modules in the working directory.
    program = "import sys; from kitchen_suite.commands import main; sys.exit(main(sys.argv[1:]))"
    command = [sys.executable, "-P", "-c", program, *arguments]
    paths = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    done = subprocess.run(command, cwd=place, env={**os.environ, "PYTHONPATH": paths}, capture_output=True, text=True)
    return done.returncode, done.stderr


NAMES = {
    "domain": {"domain_name": "planted:DOMAIN"},
    "robot": {"task_kwargs": {"robot": "planted:ROBOT", "control_mode": "ee_delta_pose"}},
}
READERS = {
    "replay": ["replay", "runs"],
    "convert": ["convert", "runs", "--format=ogbench", "--dataset=me/x", "--data_path=data"],
    "record": ["record", "--output=runs", "--max_episode_steps=3", "--num_episodes=2"],
    "evaluate": ["evaluate", "--protocol=beso", "--dataset=runs", "--num_episodes=1", "--max_episode_steps=3"],
    "play": ["play", "--policy_file=policy.npz", "--novideo", "--num_episodes=1", "--max_episode_steps=3"],
}


@pytest.mark.full
@pytest.mark.parametrize("kind", NAMES)
@pytest.mark.parametrize("reader", READERS)
def test_no_command_imports_what_a_file_names(place, reader, kind):
    forge_recording(place, **NAMES[kind])
    forge_policy(place, **NAMES[kind])
    status, err = run(place, *READERS[reader])
    assert status in (1, 2)
    assert err.count("\n") == 1
    assert "planted" in err
    assert not (place / "imported").exists()


@pytest.mark.full
@pytest.mark.parametrize("kind", NAMES)
def test_a_specification_from_a_file_names_no_code(place, kind, monkeypatch):
    monkeypatch.chdir(place)
    monkeypatch.syspath_prepend(place)
    forge_recording(place, **NAMES[kind])
    with pytest.raises(OSError, match="name it yourself, as custom"):
        Recording.open(place / "runs")
    assert not (place / "imported").exists()


@pytest.mark.full
def test_what_is_named_as_custom_is_imported(place):
    """As the error advises."""
    forge_recording(place, **NAMES["robot"])
    forge_policy(place, **NAMES["domain"])
    # Another control mode than the recorded one has other actions, but it is played.
    assert run(place, "replay", "runs", "--custom=planted:ROBOT")[0] == 1
    assert (place / "imported").exists()
    assert run(place, *READERS["play"], "--custom=planted:DOMAIN") == (0, "")


@pytest.mark.full
def test_a_file_may_name_what_the_program_has_named(place, monkeypatch):
    monkeypatch.chdir(place)
    monkeypatch.syspath_prepend(place)
    forge_recording(place, **NAMES["domain"])
    with pytest.raises(ValueError, match="cannot be imported"):
        imports.named("planted:NOTHING", "domain")
    with pytest.raises(OSError, match="as custom"):
        Recording.open(place / "runs")
    imports.named("planted:DOMAIN", "domain")
    assert Recording.open(place / "runs").spec.domain_name == "planted:DOMAIN"


@pytest.mark.parametrize("name", ["info_format", "max_episode_steps", "random", "visuals", "num_envs", "instructions"])
def test_a_file_sets_no_argument_that_is_reserved(runs, name):
    record = json.loads((runs / "recording.json").read_text("utf-8"))
    EpisodeSpec.from_json(record)
    with pytest.raises(ValueError, match=name):
        EpisodeSpec.from_json({**record, "task_kwargs": {name: 1}})
