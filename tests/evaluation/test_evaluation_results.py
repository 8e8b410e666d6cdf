"""The committed results, the script that makes them, and the page that explains their fields."""

import importlib
import json
import re
from pathlib import Path

import pytest

from kitchen_suite.cli.commands import evaluate
from kitchen_suite.evaluation.protocols import PROTOCOLS

DOCS = Path(__file__).resolve().parent.parent.parent / "docs"
COMMITTED = sorted((DOCS / "benchmarks" / "evaluation").glob("*.json"))


@pytest.fixture
def script(tmp_path, monkeypatch):
    """The script, with a folder of its own for the results."""
    module = importlib.import_module("evaluation_results")
    monkeypatch.setattr(module, "RESULTS", tmp_path / "results")
    return module


def test_committed_results_are_of_whole_protocols():
    learned = importlib.import_module("imitation_results").ALGORITHMS
    cases = {*importlib.import_module("evaluation_results").CASES, *((name, "shift") for name in learned)}
    for path in COMMITTED:
        result = json.loads(path.read_text("utf-8"))
        protocol = PROTOCOLS[result["protocol"]]
        assert tuple(path.stem.split("_")) in cases, path
        assert path.stem.endswith(f"_{protocol.name}"), path
        assert (result["seed"], result["num_episodes"]) == (protocol.seed, protocol.num_episodes), path
        task = "all" if "all" in path.stem.split("_") else "random_4"
        names = [condition.name or condition.task_name or task for condition in protocol.conditions]
        assert list(result["conditions"]) == names, path


def run(script, monkeypatch, *arguments, fails=()):
    """Runs the script with short evaluations, of which those named fail after their folder was made."""
    done = []

    def play(command, check):
        (policy, protocol, *_) = (flag.partition("=")[2] for flag in command[3:])
        done.append((policy, protocol, "--resume" in command))
        status = evaluate.main([*command[3:], "--num_episodes=2", "--max_episode_steps=1"])
        if status or (policy, protocol) in fails:
            raise RuntimeError

    monkeypatch.setattr(script.subprocess, "run", play)
    return script.main(arguments), done


@pytest.mark.thorough
def test_the_script_makes_what_is_missing_and_continues(script, tmp_path, monkeypatch):
    folder, names = str(tmp_path / "runs"), ("random:default", "random:d4rl")
    with pytest.raises(RuntimeError):
        run(script, monkeypatch, folder, *names, fails=[("random", "default")])
    script.result_file(("random", "default")).unlink()
    assert run(script, monkeypatch, folder, *names) == (0, [("random", "default", True), ("random", "d4rl", False)])
    assert run(script, monkeypatch, folder, *names) == (0, [])
    assert sorted(path.name for path in script.RESULTS.iterdir()) == ["random_d4rl.json", "random_default.json"]


@pytest.mark.thorough
def test_the_tables_have_the_results(script, tmp_path, monkeypatch):
    tables = importlib.import_module("evaluation_tables")
    monkeypatch.setattr(tables, "RESULTS", script.RESULTS)
    run(script, monkeypatch, str(tmp_path / "runs"), "random:default", "random:d4rl")
    rows = [[cell.strip(" `") for cell in row.split("|")[1:5]] for row in tables.result_table().splitlines()[2:]]
    assert rows == [
        ["default", "random_4", "random", "2"],
        *(["d4rl", name, "random", "2"] for name in ("complete", "partial", "mixed")),
    ]
    assert "0 of 2" in tables.task_table()
    assert len(tables.shift_table().splitlines()) == 2 + len(PROTOCOLS["shift"].conditions)


@pytest.mark.parametrize("names", [("random:d4r",), ()])
def test_bad_arguments_of_the_script_are_named(script, names, capsys):
    arguments = ("runs", *names) if names else ()
    assert script.main(arguments) == 2
    assert ("'random:d4r' is none of random:default" if names else "python docs/evaluation_results.py") in (
        capsys.readouterr().err
    )


@pytest.mark.thorough
def test_the_page_explains_every_field(tmp_path, capsys):
    page = (DOCS / "evaluation.md").read_text("utf-8")
    named = set(re.findall(r"`(\w+)`", page))
    for flags in (["--protocol=d4rl", "--num_episodes=1"], ["--domain_name=open_cabinet", "--num_episodes=1"]):
        file = tmp_path / "a.json"
        assert evaluate.main([*flags, "--max_episode_steps=1", f"--json={file}"]) == 0
        result = json.loads(file.read_text("utf-8"))
        assert {name for name in result if not re.fullmatch(r"p\d", name)} <= named
        for rates in result.get("task_rates", {}).values():
            assert rates.keys() <= named
    capsys.readouterr()
