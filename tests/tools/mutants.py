"""Mutation tests of the suite's pure functions: how many small faults the tests find.

pip install cosmic-ray
python tests/tools/mutants.py              tests all mutants (hours); goes on where it was stopped
python tests/tools/mutants.py --only=WORD  those of modules whose name contains the word
python tests/tools/mutants.py --sample=200 tests 200 mutants of each module, drawn at random; all where there are fewer
python tests/tools/mutants.py --again      tests the survivors that are not listed once more
python tests/tools/mutants.py --report     prints the scores so far, and the mutants that survived

A mutant is a copy of a module with one operator, number or keyword changed by cosmic-ray. It survives if the tests
named here pass with it. Each process tests in a copy of the package of its own, which it is checked to import: a
function that is broken on purpose must be found. The tests that have found mutants are played first, the last one at
the front. Results are in docs/experiments/results/mutants; those of a module whose code has changed since are dropped.
`equivalent_mutants.json` lists the survivors that no test should tell from the original, with the reason; scores leave
them out. Mutants are tested in a random order, so that those tested so far are a fair sample. Exit status: 0 if all
modules have a score of at least 97 %, of all mutants or of the sample, else 1.
"""

import argparse
import ast
import compileall
import concurrent.futures
import difflib
import gc
import hashlib
import importlib.util
import itertools
import json
import multiprocessing
import os
import queue
import random
import resource
import shutil
import sys
import tempfile
import threading
from pathlib import Path
from typing import Any, NamedTuple

from tabulate import tabulate
from tqdm import tqdm

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "docs" / "experiments" / "results" / "mutants"
EQUIVALENT = Path(__file__).with_name("equivalent_mutants.json")
LEAST = 0.97
# [s] of a processor for the tests of one mutant, and of a clock: on a machine with other work the former says more.
PROCESSOR_TIME = 150
TIMEOUT = 3600.0
MARKS = "not rendering"
# Libraries that the tests import, loaded once; every mutant is tested in a fork.
PRELOADED = ("pytest", "hypothesis", "scipy.spatial.transform", "dm_control.composer", "mujoco.batch", "gymnasium")
# Exit status of pytest where no test was found.
NO_TESTS = 5

# Tests of each module, the quickest first: they stop at the first failure.
TESTS = {
    "tasks/rotations.py": ("tests/tasks/test_rotations.py",),
    "tasks/goals.py": (
        "tests/tasks/test_goals.py",
        "tests/tasks/test_success.py",
        "tests/tasks/test_instructions.py",
    ),
    "tasks/control_modes/joints.py": ("tests/tasks/control_modes/test_mode_mathematics.py",),
    "tasks/control_modes/end_effector.py": ("tests/tasks/control_modes/test_mode_mathematics.py",),
    "tasks/kitchen/control_modes.py": ("tests/tasks/control_modes/test_mode_mathematics.py",),
    "tasks/kitchen/shaping.py": ("tests/tasks/kitchen/test_kitchen_reward_terms.py",),
    "tasks/rewards.py": ("tests/tasks/kitchen/test_kitchen_reward_terms.py",),
    "tasks/orders.py": (
        "tests/tasks/kitchen/test_task_draw.py",
        "tests/tasks/kitchen/test_tasks_in_order.py",
        "tests/tasks/kitchen/test_tasks_in_turn.py",
        "tests/tasks/kitchen/test_requested_tasks.py",
    ),
    "tasks/open_cabinet/rewards.py": (
        "tests/tasks/open_cabinet/test_open_cabinet_reward_terms.py",
        "tests/tasks/open_cabinet/test_open_cabinet_math.py",
    ),
    "tasks/microwave_table/mdp.py": (
        "tests/tasks/microwave_table/test_microwave_table_mdp.py",
        "tests/tasks/microwave_table/test_microwave_table_task.py",
    ),
    "kitchen_suite/evaluation/protocols.py": ("tests/evaluation/test_protocols.py",),
    "kitchen_suite/evaluation/scores.py": ("tests/evaluation/test_scores.py",),
    "kitchen_suite/evaluation/paired.py": ("tests/evaluation/test_paired.py",),
    "kitchen_suite/evaluation/criteria.py": ("tests/evaluation/test_criteria.py",),
    "kitchen_suite/evaluation/quality.py": ("tests/evaluation/test_quality_scores.py",),
    "tasks/episode/quality.py": ("tests/tasks/test_quality.py",),
    "tasks/episode/pushes.py": ("tests/tasks/variations/test_pushes.py",),
    "tasks/generated_kitchens/mdp.py": ("tests/tasks/generated_kitchens/test_generated_kitchen_task.py",),
}


class Mutant(NamedTuple):
    """A mutant of a module: the operator of cosmic-ray, and the number of the place that it changes."""

    operator: str
    place: int

    @property
    def name(self) -> str:
        """Name of the mutant in the results."""
        return f"{self.operator.removeprefix('core/')}/{self.place}"

    def text(self, source: str) -> str:
        """Returns the text of the module with the change."""
        from cosmic_ray import plugins
        from cosmic_ray.mutating import mutate_code

        text: str = mutate_code(source, plugins.get_operator(self.operator)(), self.place)
        return text


def installed(module: str) -> Path:
    """Returns the path of a module in the installed package."""
    path = Path(module)
    return path if path.parts[0] == "kitchen_suite" else Path("kitchen_suite") / path


def mutants(module: str, source: str) -> list[Mutant]:
    """Returns all mutants of a module, in a random order that is the same at each call."""
    from cosmic_ray import plugins
    from cosmic_ray.ast import ast_nodes, get_ast

    nodes = [*ast_nodes(get_ast(source))]
    found = []
    for operator in plugins.operator_names():
        made = plugins.get_operator(operator)
        if made.arguments():
            # Variables to replace would have to be named.
            continue
        places = sum(len([*made().mutation_positions(node)]) for node in nodes)
        found += [Mutant(operator, place) for place in range(places)]
    random.Random(module).shuffle(found)
    return found


def changed_lines(before: str, after: str) -> tuple[str, str]:
    """Returns the lines of two texts that differ, stripped, one after the other."""
    old, new = before.splitlines(), after.splitlines()
    first = common_length(old, new)
    last = common_length(old[first:][::-1], new[first:][::-1])
    # Only what is between the equal ends: difflib takes a second for the whole of a long module.
    lines = [*difflib.ndiff(old[first : len(old) - last], new[first : len(new) - last])]
    removed, added = ("\n".join(line[2:].strip() for line in lines if line.startswith(sign)) for sign in ("- ", "+ "))
    return removed, added


def common_length(first: list[str], second: list[str]) -> int:
    """Returns how many lines two lists have in common from their beginning on."""
    alike = itertools.takewhile(lambda pair: pair[0] == pair[1], zip(first, second, strict=False))
    return sum(1 for _ in alike)


def digest(source: str) -> str:
    """Returns a digest of what a module does: without comments and docstrings."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node) is not None:
            del node.body[0]
    return hashlib.sha256(ast.unparse(tree).encode()).hexdigest()


class Results:
    """The results of a module, in a file."""

    def __init__(self, module: str) -> None:
        """Reads what there is of the present source."""
        self.module, self.path = module, RESULTS / f"{module.replace('/', '_').removesuffix('.py')}.json"
        # Mutants are made from this text, whatever becomes of the file while they are tested.
        self.source = (ROOT / module).read_text(encoding="utf-8")
        self.digest = digest(self.source)
        found = json.loads(self.path.read_text(encoding="utf-8")) if self.path.exists() else {}
        if found.get("source") != self.digest:
            found = {"total": None, "killed": [], "survived": {}}
        self.total: int | None = found["total"]
        self.killed: list[str] = found["killed"]
        self.survived: dict[str, list[str]] = found["survived"]

    @property
    def tested(self) -> int:
        """Number of mutants that have been tested."""
        return len(self.killed) + len(self.survived)

    def add(self, name: str, lines: tuple[str, str], *, survived: bool) -> None:
        """Adds the result of a mutant, given the lines that it changes, in place of an earlier one."""
        self.survived.pop(name, None)
        if survived:
            self.survived[name] = [*lines]
        else:
            self.killed.append(name)

    def save(self) -> None:
        """Writes the file."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        record = {"module": self.module, "source": self.digest, "total": self.total}
        record |= {"killed": self.killed, "survived": self.survived}
        partial = self.path.with_suffix(".part")
        partial.write_text(json.dumps(record, indent=0) + "\n", encoding="utf-8")
        partial.replace(self.path)


class Tester:
    """Tests mutants in a copy of the package, each in a process of its own."""

    def __init__(self, folder: Path) -> None:
        """Copies the package as it is installed: its links are the folders that they lead to."""
        self._folder = folder
        copied = folder / "kitchen_suite"
        shutil.copytree(ROOT / "kitchen_suite", copied, ignore=shutil.ignore_patterns("__pycache__"))
        compileall.compile_dir(copied, quiet=1)
        self._context = multiprocessing.get_context("forkserver")
        self._context.set_forkserver_preload([*PRELOADED])

    def passes(self, module: str, source: str, text: str) -> bool:
        """Returns whether the tests of a module pass with another text of it; one that takes too long does not."""
        path = self._folder / installed(module)
        path.write_text(text, encoding="utf-8")
        Path(importlib.util.cache_from_source(path)).unlink(missing_ok=True)
        process = self._context.Process(target=run_tests, args=(self._folder, TESTS[module]))
        process.start()
        process.join(TIMEOUT)
        if process.exitcode is None:
            process.kill()
            process.join()
        path.write_text(source, encoding="utf-8")
        if process.exitcode == NO_TESTS:
            raise RuntimeError(f"there are no tests of {module}")
        return process.exitcode == 0

    def check(self, module: str, source: str) -> None:
        """Raises a RuntimeError unless the tests pass without a mutation, and find a function that is broken."""
        if not self.passes(module, source, source):
            raise RuntimeError(f"tests of {module} fail without a mutation")
        if self.passes(module, source, source.replace("    return ", "    return None and ")):
            raise RuntimeError(f"tests of {module} pass when it is broken: they import another copy")


class FindersFirst:
    """Plugin of pytest that plays the tests first that have found mutants: those of neighbouring lines are alike."""

    def __init__(self, path: Path) -> None:
        """Reads the names of these tests from a file, if there is one."""
        self._path = path
        self._names: list[str] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else []

    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        """Moves these tests to the front."""
        places = {name: place for place, name in enumerate(self._names)}
        items.sort(key=lambda item: places.get(item.nodeid, len(places)))

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Writes a test that failed to the front of the file."""
        if report.failed:
            names = [report.nodeid, *(name for name in self._names if name != report.nodeid)]
            self._path.write_text(json.dumps(names), encoding="utf-8")


def run_tests(folder: Path, tests: tuple[str, ...]) -> None:
    """Ends this process with the exit status of pytest, for tests that import the package from a folder."""
    import pytest

    resource.setrlimit(resource.RLIMIT_CPU, (PROCESSOR_TIME, PROCESSOR_TIME))
    silent = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silent, 1)
    os.dup2(silent, 2)
    sys.dont_write_bytecode = True
    sys.path.insert(0, str(folder))
    # pytest collects garbage twice, in which looking through what was loaded before takes as long as many tests.
    gc.freeze()
    arguments = ["-x", "-q", "-n", "0", "-p", "no:cacheprovider", "-o", "addopts=", "--run=full", "-m", MARKS]
    paths = [str(ROOT / test) for test in tests]
    finders = FindersFirst(folder / "finders.json")
    status = pytest.main([*arguments, "-c", str(ROOT / "setup.cfg"), "--rootdir", str(ROOT), *paths], plugins=[finders])
    os._exit(int(status))


def run(modules: list[str], *, sample: int | None, again: bool, processes: int) -> None:
    """Tests the mutants that have not been tested, or those that survived."""
    results = {module: Results(module) for module in modules}
    waiting: queue.SimpleQueue[tuple[str, Mutant]] = queue.SimpleQueue()
    for module in modules:
        for mutant in to_test(module, results[module], sample=sample, again=again):
            waiting.put((module, mutant))
    lock, bar = threading.Lock(), tqdm(total=waiting.qsize(), unit="mutant", disable=None)

    def work(folder: Path) -> None:
        tester, checked = Tester(folder), set()
        while True:
            try:
                module, mutant = waiting.get_nowait()
            except queue.Empty:
                return
            source = results[module].source
            if module not in checked:
                tester.check(module, source)
                checked.add(module)
            text = mutant.text(source)
            survived = tester.passes(module, source, text)
            with lock:
                results[module].add(mutant.name, changed_lines(source, text), survived=survived)
                results[module].save()
                bar.update()

    with tempfile.TemporaryDirectory() as folder, concurrent.futures.ThreadPoolExecutor(processes) as pool, bar:
        jobs = [pool.submit(work, Path(folder, str(number))) for number in range(processes)]
        for job in jobs:
            job.result()


def to_test(module: str, found: Results, *, sample: int | None, again: bool) -> list[Mutant]:
    """Returns the mutants of a module that are missing in its sample, or its survivors; stores their number."""
    made = mutants(module, found.source)
    found.total = len(made)
    if again:
        equivalent = equivalents(module)
        survivors = {name for name, lines in found.survived.items() if tuple(lines) not in equivalent}
        return [each for each in made if each.name in survivors]
    tested = {*found.killed, *found.survived}
    missing = [each for each in made if each.name not in tested]
    return missing if sample is None else missing[: max(sample - found.tested, 0)]


def equivalents(module: str) -> set[tuple[str, str]]:
    """Returns the lines, before and after, of mutants of a module that no test should tell from the original."""
    known: dict[str, list[dict[str, str]]] = json.loads(EQUIVALENT.read_text(encoding="utf-8"))
    return {(each["before"], each["after"]) for each in known.get(module, [])}


def stripped(text: str) -> str:
    """Returns a text without the spaces at the beginning of its lines, as mutants' lines are kept."""
    return "\n".join(line.strip() for line in text.splitlines())


def report(modules: list[str], sample: int | None) -> bool:
    """Prints the score of each module and its survivors; returns whether all have been tested and score enough."""
    rows, enough = [], True
    for module in modules:
        found = Results(module)
        equivalent = equivalents(module)
        for before in sorted({before for before, _ in equivalent if before not in stripped(found.source)}):
            print(f"{EQUIVALENT.name} has a line that {module} does not: {before}")
        survivors = [lines for lines in found.survived.values() if tuple(lines) not in equivalent]
        left_out = len(found.survived) - len(survivors)
        score = len(found.killed) / max(found.tested - left_out, 1)
        complete = found.tested == found.total or (sample is not None and found.tested >= sample)
        enough = enough and complete and score >= LEAST
        rows.append((module, found.total, found.tested, left_out, len(survivors), f"{100 * score:.1f} %"))
        for before, after in survivors:
            print(f"{module}\n  - {before}\n  + {after}")
    print(tabulate(rows, ("module", "mutants", "tested", "equivalent", "survived", "score")))
    return enough


def main() -> int:
    """Runs the command; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", help="word in the names of the modules to test")
    parser.add_argument("--sample", type=int, help="number of mutants of each module; all when omitted")
    parser.add_argument("--again", action="store_true", help="test the survivors that are not listed once more")
    parser.add_argument("--report", action="store_true", help="print what was found, and test nothing")
    parser.add_argument("--processes", type=int, default=2, help="number of tests at the same time")
    arguments = parser.parse_args()
    if arguments.sample is not None and arguments.sample < 1:
        parser.error(f"--sample must be at least 1, got {arguments.sample}")
    # Inherited by the processes; one thread each.
    os.environ.update({"MUJOCO_GL": "disable", "OPENBLAS_NUM_THREADS": "1"})
    modules = [module for module in TESTS if arguments.only in module]
    if not arguments.report:
        run(modules, sample=arguments.sample, again=arguments.again, processes=arguments.processes)
    return 0 if report(modules, arguments.sample) else 1


if __name__ == "__main__":
    sys.exit(main())
