"""Mutation tests of the suite's pure functions: how many small faults the tests find.

pip install cosmic-ray
python tests/tools/mutants.py FOLDER                 makes and tests all mutants (hours); goes on where it was stopped
python tests/tools/mutants.py FOLDER --only=WORD     those of modules whose name contains the word
python tests/tools/mutants.py FOLDER --report        prints the scores so far, and the mutants that survived

A mutant is a copy of a module with one operator, number or keyword changed by cosmic-ray. It survives if the tests
named here pass with it. `equivalent_mutants.json` lists the survivors that no test can tell from the original, with the
reason; scores leave them out. Each module is tested in a copy of the package of its own, two at a time; the present
tree stays as it is. Exit status: 0 if all modules have a score of at least 90 %, else 1.
"""

import argparse
import concurrent.futures
import json
import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from tabulate import tabulate
from tqdm import tqdm

ROOT = Path(__file__).resolve().parents[2]
EQUIVALENT = Path(__file__).with_name("equivalent_mutants.json")
LEAST = 0.9
TIMEOUT = 300.0  # [s] of the tests of one mutant.
_APART = ("slow", "thorough", "clients", "ray", "lerobot", "web", "browser", "rendering")
MARKS = " and ".join(f"not {mark}" for mark in _APART)

# Tests of each module, the quickest first: they stop at the first failure.
TESTS = {
    "tasks/rotations.py": ("tests/tasks/test_rotations.py",),
    "tasks/goals.py": ("tests/tasks/test_goals.py", "tests/tasks/test_success.py"),
    "tasks/control_modes/joints.py": (
        "tests/tasks/open_cabinet/test_open_cabinet_math.py",
        "tests/tasks/control_modes/test_control_modes.py",
    ),
    "tasks/control_modes/end_effector.py": ("tests/tasks/control_modes/test_control_modes.py",),
    "tasks/kitchen/action.py": ("tests/tasks/control_modes/test_control_modes.py", "tests/fidelity"),
    "tasks/kitchen/reward.py": ("tests/tasks/kitchen/test_kitchen_rewards.py",),
    "tasks/open_cabinet/reward.py": (
        "tests/tasks/open_cabinet/test_open_cabinet_math.py",
        "tests/tasks/open_cabinet/test_open_cabinet_grasp_reward.py",
    ),
    "tasks/microwave_table/mdp.py": ("tests/tasks/microwave_table/test_microwave_table_task.py",),
    "kitchen_suite/evaluation/protocols.py": ("tests/evaluation/test_scores.py", "tests/evaluation/test_protocols.py"),
    "kitchen_suite/evaluation/results.py": ("tests/evaluation/test_scores.py", "tests/evaluation/test_evaluate.py"),
}


class Mutant(NamedTuple):
    """A mutant whose tests have run.

    Attributes:
      survived: whether all tests passed.
      before: the changed lines of the module, stripped, one after the other.
      after: the lines that replace them.
    """

    survived: bool
    before: str
    after: str


def installed(module: str) -> Path:
    """Returns the path of a module in the installed package."""
    path = Path(module)
    return path if path.parts[0] == "kitchen_suite" else Path("kitchen_suite") / path


def copy_package(folder: Path) -> None:
    """Copies the package as it is installed: the folders of the repository's top are subpackages."""
    for name in ("kitchen_suite", "entities", "tasks"):
        shutil.copytree(ROOT / name, folder / installed(name), ignore=shutil.ignore_patterns("__pycache__"))


def environment(folder: Path) -> dict[str, str]:
    """Returns environment variables with which the copy in a folder is imported."""
    return {**os.environ, "PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}


def run_module(module: str, folder: Path) -> None:
    """Makes the mutants of a module, unless they exist, and tests those that have not been tested.

    Raises:
      RuntimeError: the tests fail without a mutation, or do not import the copy.
    """
    package, session, config = folder / "package", folder / "session.sqlite", folder / "config.toml"
    if not session.exists():
        shutil.rmtree(package, ignore_errors=True)
        package.mkdir(parents=True)
        copy_package(package)
    tests = [str(ROOT / test) for test in TESTS[module]]
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-n", "0", "-p", "no:cacheprovider", "-o", "addopts="]
    command += ["-m", MARKS, "-c", str(ROOT / "setup.cfg"), "--rootdir", str(ROOT), *tests]
    config.write_text(
        "[cosmic-ray]\n"
        f"module-path = {json.dumps(str(package / installed(module)))}\n"
        f"timeout = {TIMEOUT}\n"
        "excluded-modules = []\n"
        f"test-command = {json.dumps(shlex.join(command))}\n"
        '[cosmic-ray.distributor]\nname = "local"\n',
        encoding="utf-8",
    )
    variables = environment(package)
    if not session.exists():
        name = ".".join(installed(module).with_suffix("").parts)
        code = f"import {name}; print({name}.__file__)"
        found = subprocess.check_output([sys.executable, "-c", code], text=True, cwd=folder, env=variables)
        if Path(found.strip()) != package / installed(module):
            raise RuntimeError(f"tests of {module} would import {found.strip()}, not the copy")
        if subprocess.run(command, cwd=folder, env=variables, capture_output=True, check=False).returncode:
            raise RuntimeError(f"tests of {module} fail without a mutation")
        subprocess.run(["cosmic-ray", "init", str(config), str(session)], cwd=folder, env=variables, check=True)
    # A run that was stopped may have left a mutation in the copy.
    shutil.copy(ROOT / module, package / installed(module))
    subprocess.run(["cosmic-ray", "exec", str(config), str(session)], cwd=folder, env=variables, check=True)


def mutants(folder: Path) -> Iterator[Mutant | None]:
    """Yields the mutants of a session; None for each whose tests have not run."""
    from cosmic_ray.work_db import WorkDB, use_db
    from cosmic_ray.work_item import TestOutcome

    with use_db(str(folder / "session.sqlite"), WorkDB.Mode.open) as database:
        results = dict(database.results)
        for item in database.work_items:
            result = results.get(item.job_id)
            if result is None:
                yield None
                continue
            lines = (result.diff or "").splitlines()
            before = [line[1:].strip() for line in lines if line.startswith("-") and not line.startswith("---")]
            after = [line[1:].strip() for line in lines if line.startswith("+") and not line.startswith("+++")]
            yield Mutant(result.test_outcome == TestOutcome.SURVIVED, "\n".join(before), "\n".join(after))


def report(folder: Path) -> bool:
    """Prints the score of each module and its survivors; returns whether all have been tested and score enough."""
    known: dict[str, list[dict[str, Any]]] = json.loads(EQUIVALENT.read_text(encoding="utf-8"))
    rows, enough = [], True
    for module in TESTS:
        place = folder / module.replace("/", "_")
        if not (place / "session.sqlite").exists():
            enough = False
            continue
        found = list(mutants(place))
        tested = [mutant for mutant in found if mutant is not None]
        equivalent = {(each["before"], each["after"]) for each in known.get(module, [])}
        survivors = [each for each in tested if each.survived and (each.before, each.after) not in equivalent]
        left_out = sum(each.survived for each in tested) - len(survivors)
        count = len(tested) - left_out
        score = 1.0 - len(survivors) / count if count else 0.0
        enough = enough and len(tested) == len(found) and score >= LEAST
        rows.append((module, len(found), len(tested), left_out, len(survivors), f"{100 * score:.1f} %"))
        for each in survivors:
            print(f"{module}\n  - {each.before}\n  + {each.after}")
    print(tabulate(rows, ("module", "mutants", "tested", "equivalent", "survived", "score")))
    return enough


def main() -> int:
    """Runs the command; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="folder of the sessions, outside this repository")
    parser.add_argument("--only", default="", help="word in the names of the modules to test")
    parser.add_argument("--report", action="store_true", help="print what was found, and test nothing")
    arguments = parser.parse_args()
    folder = arguments.folder.resolve()
    if not arguments.report:
        modules = [module for module in TESTS if arguments.only in module]
        with concurrent.futures.ThreadPoolExecutor(2) as pool:
            jobs = [pool.submit(run_module, module, folder / module.replace("/", "_")) for module in modules]
            for job in tqdm(concurrent.futures.as_completed(jobs), total=len(jobs), unit="module"):
                job.result()
    return 0 if report(folder) else 1


if __name__ == "__main__":
    sys.exit(main())
