"""Measures what a reader of the suite walks through, on this tree and on a revision.

python tests/tools/walks.py                 measures this tree
python tests/tools/walks.py REVISION        measures that revision of this repository as well
python tests/tools/walks.py --list=step     lists the files and functions that a walk enters, in order of first entry

A walk is a call whose project files are counted: those below the root of the tree in which Python code runs. Calls are
counted that enter another file than the project file that they come from. The walks `step`, `vector_step`, `reward`,
`masked_reset` and `receipt` are one call after two others. The walks `recording` and `flag` are kitchen-record and
kitchen-rollout, with what they import, in a process in which a vectorised environment has made a step.
"""

import argparse
import ast
import contextlib
import dataclasses
import functools
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import trees
from tabulate import tabulate

ENV_ID = "KitchenSuite/FrankaKitchen-v1"
RECORDING = (
    "--domain_name=kitchen",
    "--task_name=kettle",
    "--policy=random",
    "--num_episodes=2",
    "--max_episode_steps=20",
)
# Folders of the package.
SOURCES = ("entities", "tasks", "kitchen_suite")
# An environment of a user's own.
EXAMPLE = "my_task.py"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Walk:
    """Project code that a call has run.

    Attributes:
      entered: pairs of file, relative to the root, and qualified name of the function, in order of first entry.
      crossings: calls that came from another project file.
    """

    entered: tuple[tuple[str, str], ...]
    crossings: int

    @property
    def files(self) -> tuple[str, ...]:
        """Files in order of first entry."""
        return tuple(dict.fromkeys(file for file, _ in self.entered))


class Tracer:
    """Notes the functions of a tree that are entered, and calls between its files."""

    def __init__(self, tree: Path) -> None:
        self._root = f"{tree.resolve()}/"
        self._entered: dict[tuple[str, str], None] = {}
        self._crossings = 0

    @contextlib.contextmanager
    def tracing(self) -> Iterator[None]:
        sys.setprofile(self._note)
        try:
            yield
        finally:
            sys.setprofile(None)

    @property
    def walk(self) -> Walk:
        return Walk(entered=tuple(self._entered), crossings=self._crossings)

    def _note(self, frame: FrameType, event: str, arg: Any) -> None:
        if event != "call" or (callee := self._file(frame)) is None:
            return
        self._entered[callee, frame.f_code.co_qualname] = None
        above = frame.f_back
        while above is not None and self._file(above) is None:
            above = above.f_back
        self._crossings += above is not None and self._file(above) != callee

    def _file(self, frame: FrameType) -> str | None:
        """Path of a frame's file below the root; None outside the project, and in its tests."""
        path = _without_links(frame.f_code.co_filename)
        relative = path.removeprefix(self._root)
        return None if relative == path or relative.startswith("tests/") else relative


@functools.cache
def _without_links(path: str) -> str:
    return os.path.realpath(path)


def step() -> Callable[[], object]:
    """Makes a single kitchen; returns its step."""
    import gymnasium

    environment = gymnasium.make(ENV_ID)
    environment.reset(seed=0)
    return lambda: environment.step(np.zeros(9))


def vector_step() -> Callable[[], object]:
    """Makes four kitchens in a vector; returns their step."""
    import gymnasium

    environments = gymnasium.make_vec(ENV_ID, 4, vectorization_mode="vector_entry_point", num_threads=1)
    environments.reset(seed=0)
    return lambda: environments.step(np.zeros((4, 9)))


def reward() -> Callable[[], object]:
    """Makes a single kitchen with a dense reward; returns its step."""
    import gymnasium

    environment = gymnasium.make(ENV_ID, reward="dense")
    environment.reset(seed=0)
    return lambda: environment.step(np.zeros(9))


def masked_reset() -> Callable[[], object]:
    """Makes four kitchens in a vector; returns the reset of one of them, in which its layout varies."""
    import gymnasium

    environments = gymnasium.make_vec(
        ENV_ID, 4, vectorization_mode="vector_entry_point", num_threads=1, variations="layout"
    )
    environments.reset(seed=0)
    return lambda: environments.reset(options={"reset_mask": np.arange(4) == 1})


def receipt() -> Callable[[], object]:
    """Evaluates two short episodes with a receipt, in the working directory; returns the check of the receipt."""
    import kitchen_suite

    path = Path("receipt.npz")
    kitchen_suite.evaluate("random", task_name="kettle", num_episodes=2, max_episode_steps=5, receipt=path)
    return lambda: kitchen_suite.replay(path).verdict


# Calls in one process that are traced the third time.
CALLS = {
    "step": step,
    "vector_step": vector_step,
    "reward": reward,
    "masked_reset": masked_reset,
    "receipt": receipt,
}
# Commands that are traced with what they import.
COMMANDS = {
    "recording": ("kitchen-record", *RECORDING),
    "flag": ("kitchen-rollout", "--control_mode=ee_delta_pose", "--num_episodes=1", "--max_episode_steps=2"),
}
WALKS = (*CALLS, *COMMANDS)
# Walks that `measure` counts; the others follow the answers of docs/development/design.md.
MEASURED = ("step", "vector_step", "recording")


def trace(tree: Path, name: str) -> Walk:
    """Traces a walk in this process, which has not imported the suite yet."""
    trees.use(tree)
    tracer = Tracer(tree)
    if name in COMMANDS:
        vector_step()()
        with tempfile.TemporaryDirectory() as folder, tracer.tracing():
            trees.run_command(tree, *COMMANDS[name], f"--output={folder}/runs")
        return tracer.walk
    run = CALLS[name]()
    run()
    run()
    with tracer.tracing():
        run()
    return tracer.walk


def members(tree: Path) -> dict[str, int]:
    """Counts the project's classes in the MRO of the kitchen's task, and their members other than dunders."""
    trees.use(tree)
    from kitchen_suite.tasks import KitchenTask

    own = [each for each in KitchenTask.__mro__ if each.__module__.startswith("kitchen_suite")]
    names = {name for each in own for name in vars(each) if not (name.startswith("__") and name.endswith("__"))}
    return {"classes of KitchenTask": len(own), "members of KitchenTask": len(names)}


def source(tree: Path) -> dict[str, int]:
    """Counts the files of the package's source, and their lines."""
    files = [path for folder in SOURCES for path in (tree / folder).rglob("*.py")]
    lines = sum(len(path.read_text(encoding="utf-8").splitlines()) for path in files)
    return {"files of source": len(files), "lines of source": lines}


def example(path: Path) -> dict[str, int]:
    """Counts the modules of the suite that an example imports from, and its lines of code.

    Lines of code are those with a token of a statement: neither empty ones nor comments nor docstrings.
    """
    module = ast.parse(path.read_text(encoding="utf-8"))
    imports = [node for node in ast.walk(module) if isinstance(node, ast.ImportFrom | ast.Import)]
    names = {name for node in imports for name in _modules(node) if name.partition(".")[0] == "kitchen_suite"}
    docstrings = {id(node) for node in ast.walk(module) if isinstance(node, ast.Expr) and _is_text(node.value)}
    lines = {line for node in _outside(module, docstrings) for line in (node.lineno, node.end_lineno)}
    return {"modules that the example imports": len(names), "lines of code of the example": len(lines)}


def _modules(node: ast.ImportFrom | ast.Import) -> list[str]:
    return [str(node.module)] if isinstance(node, ast.ImportFrom) else [name.name for name in node.names]


def _is_text(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def _outside(node: ast.AST, left_out: set[int]) -> Iterator[Any]:
    """Yields the nodes of a syntax tree that have lines, except for those left out."""
    for child in ast.iter_child_nodes(node):
        if id(child) not in left_out:
            if hasattr(child, "lineno"):
                yield child
            yield from _outside(child, left_out)


def walk(tree: Path, name: str) -> Walk:
    """Traces a walk on a tree, in a process of its own."""
    found = _in_process(tree, name)
    return Walk(entered=tuple((file, function) for file, function in found["entered"]), crossings=found["crossings"])


def measure(tree: Path) -> dict[str, int]:
    """Returns all measures of a tree by name."""
    walks = {name: walk(tree, name) for name in MEASURED}
    return {
        **{f"files of the walk {name}": len(each.files) for name, each in walks.items()},
        **{f"calls between files of the walk {name}": each.crossings for name, each in walks.items()},
        **_in_process(tree, "members"),
        **source(tree),
        **example(next((tree / "docs").rglob(EXAMPLE))),
    }


def _in_process(tree: Path, what: str) -> Any:
    """Returns a walk, or `members`, measured on a tree in a process of its own, from JSON."""
    command = [sys.executable, __file__, f"--tree={tree}", f"--measure={what}"]
    with tempfile.TemporaryDirectory() as folder:
        run = subprocess.run(
            command, env=trees.environ(tree), cwd=folder, check=True, stdout=subprocess.PIPE, text=True
        )
    return json.loads(run.stdout.splitlines()[-1])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("revision", nargs="?", help="revision of git to measure as well")
    parser.add_argument("--list", choices=WALKS, help="list the files and functions of a walk on this tree instead")
    parser.add_argument("--tree", help=argparse.SUPPRESS)
    parser.add_argument("--measure", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.measure:
        tree = Path(arguments.tree)
        is_walk = arguments.measure in WALKS
        print(json.dumps(dataclasses.asdict(trace(tree, arguments.measure)) if is_walk else members(tree)))
    elif arguments.list:
        print(tabulate(walk(trees.ROOT, arguments.list).entered, headers=("file", "function"), tablefmt="plain"))
    else:
        columns = {"this tree": measure(trees.ROOT)}
        if arguments.revision:
            with tempfile.TemporaryDirectory() as folder:
                columns[arguments.revision] = measure(trees.extract(arguments.revision, Path(folder, "tree")))
        rows = [(name, *(column[name] for column in columns.values())) for name in columns["this tree"]]
        print(tabulate(rows, headers=("measure", *columns)))


if __name__ == "__main__":
    main()
