"""Every script of docs/examples runs as it stands with its default arguments, and prints what its page says."""

import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest
from docs_scripts import load_script

EXAMPLES = Path(__file__).resolve().parent.parent / "docs" / "examples"

# A line that each script prints, as a regular expression; its test has the marks of what it needs.
PRINTED = {
    "load_a_task": r"  25 steps, return 9\.\d+, last: False",
    "relabel_goals": r"reached goal \[-0\.6\d*\] rad: rewards in steps \[\d+, .*45\]",
    "vector_speed": r"the last one, played alone, is equal: True",
    "pixels": r"franka_hand: uint8 \(128, 128, 3\), mean \d+\.\d",
    "variations": r"held_out: 28 parameters vary",
    "record_and_replay": r"replay: equal",
    "my_arm": r"\(8,\) \{'microwave': \d+\}",
    "panda": r"\(15,\) \{'kettle': \d+\}",
    "ur5e": r"\(14,\) \{'kettle': \d+\}",
    "own_task": r"step 30: 0\.0\d+ m away, reward 0\.\d+",
    "imitate": r"success: (0\.[5-9]|1\.0)",
    "imitate_pictures": r"p1 +100\.0 %.*",
    "scripted_policy": r"seed 1: \d+ steps, success True",
}
# Examples that register a domain.
OWN_TASKS = ("my_task", "my_kitchen_task", "mug", "my_lever", "my_control_mode", "my_domain")
# Serves until it is ended; tests/policies/test_remote.py runs it.
SERVER = "policy_server"
MARKS = {
    "pixels": [pytest.mark.rendering],
    "record_and_replay": [pytest.mark.full],
    "my_arm": [pytest.mark.full],
    "panda": [pytest.mark.clients],
    "ur5e": [pytest.mark.clients],
    "imitate": [pytest.mark.clients],
    "imitate_pictures": [pytest.mark.clients, pytest.mark.rendering, pytest.mark.nightly],
}


@pytest.mark.parametrize(
    ("name", "line"), [pytest.param(name, line, id=name, marks=MARKS.get(name, ())) for name, line in PRINTED.items()]
)
def test_an_example_runs(name, line, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [f"{name}.py"])
    monkeypatch.syspath_prepend(EXAMPLES)
    # The script may set it; monkeypatch then restores it.
    monkeypatch.setenv("MINARI_DATASETS_PATH", os.environ.get("MINARI_DATASETS_PATH", ""))
    runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="__main__")
    assert re.search(f"^{line}$", capsys.readouterr().out, re.MULTILINE)


@pytest.mark.full
@pytest.mark.parametrize("name", OWN_TASKS)
def test_a_task_of_ones_own_is_equal_single_and_vectorised(name):
    path = EXAMPLES / f"{name}.py"
    # In a process of its own, since it registers a domain.
    printed = subprocess.run([sys.executable, path], capture_output=True, text=True, check=True).stdout
    one, first = (re.search(rf"^{kind}: \[?(-?[\d.]+)", printed, re.MULTILINE) for kind in ("single", "vectorised"))
    assert one
    assert first
    assert abs(float(one[1]) - float(first[1])) <= 1e-8


def test_every_example_is_run_and_is_in_the_index():
    scripts = {path.stem for path in EXAMPLES.glob("*.py")}
    index = (EXAMPLES.parent / "guide" / "quick_reference.md").read_text(encoding="utf-8")
    assert scripts == {*PRINTED, *OWN_TASKS, SERVER} == set(re.findall(r"\]\(\.\./examples/(\w+)\.py\)", index))


@pytest.mark.clients
@pytest.mark.rendering
def test_the_notebook_prints_what_it_is_stored_with(tmp_path):
    import nbformat

    notebook = load_script("scripts/notebook")
    stored = nbformat.read(notebook.NOTEBOOK, as_version=4)
    made = notebook.run(notebook.NOTEBOOK, tmp_path)
    assert notebook.printed(made) == notebook.printed(stored)
    pictures = [
        [output for output in cell.get("outputs", []) if "image/png" in output.get("data", {})] for cell in made.cells
    ]
    assert sum(map(len, pictures)) == 2
    assert os.path.getsize(notebook.NOTEBOOK) < 200_000
