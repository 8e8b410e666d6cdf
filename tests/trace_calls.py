"""Counts the files that a reader meets between an entry point and its result, on two versions of the suite.

python tests/trace_calls.py REVISION

For each path, on that revision of this repository and on this tree: the files of the suite in which a function is
entered, and the distinct calls from one of these files to another. A path is run once before it is traced, so that
imports and first-time work do not count.
"""

import argparse
import contextlib
import importlib
import io
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
from compare_trees import KITCHEN, ROOT, extract, run_command

# Folders that a path only passes through: what happens in an environment or in a policy is a path of its own.
INSIDE = ("entities", "tasks", "experts", "environment", "gymnasium", "vector")


class Tracer:
    """Notes calls between files of a tree."""

    def __init__(self, tree: Path) -> None:
        self._tree = str(tree.resolve())
        self.files: set[str] = set()
        self.calls: set[tuple[str, str]] = set()

    @contextlib.contextmanager
    def tracing(self) -> Iterator[None]:
        sys.setprofile(self._note)
        try:
            yield
        finally:
            sys.setprofile(None)

    def _note(self, frame: FrameType, event: str, arg: Any) -> None:
        if event != "call" or (callee := self._own(frame)) is None:
            return
        self.files.add(callee)
        above = frame.f_back
        while above is not None and self._own(above) is None:
            above = above.f_back
        if above is not None and (caller := self._own(above)) != callee:
            self.calls.add((str(caller), callee))

    def _own(self, frame: FrameType) -> str | None:
        path = frame.f_code.co_filename
        if not path.startswith(self._tree) or "/tests/" in path or "<" in frame.f_code.co_name[:1]:
            return None
        return path.removeprefix(self._tree).lstrip("/")


def step_of_one() -> Callable[[], object]:
    import gymnasium

    environment = gymnasium.make(f"kitchen_suite.gymnasium_env:{KITCHEN}").unwrapped
    environment.reset(seed=0)
    action = np.zeros(9)
    return lambda: environment.step(action)


def step_of_many() -> Callable[[], object]:
    import gymnasium

    environments = gymnasium.make_vec(
        f"kitchen_suite.gymnasium_env:{KITCHEN}", 2, vectorization_mode="vector_entry_point", num_threads=1
    )
    environments.reset(seed=0)
    actions = np.zeros((2, 9))
    return lambda: environments.step(actions)


def recording() -> Callable[[], object]:
    number = iter(range(10))

    def record() -> None:
        with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
            where = (f"--output={folder}/runs", f"--data_path={folder}", f"--dataset=trace/kitchen-v{next(number)}")
            short = ("--num_episodes=2", "--num_envs=2", "--num_threads=1", "--max_episode_steps=2")
            run_command("kitchen-record", *where, *short, "--policy=zero")

    return record


PATHS = {
    "an action from env.step to data.ctrl and back": step_of_one,
    "an action of vectorised environments": step_of_many,
    "an episode from kitchen-record to a dataset": recording,
}


def trace(tree: Path) -> None:
    importlib.import_module("kitchen_suite")
    for name, make in PATHS.items():
        run = make()
        run()
        tracer = Tracer(tree)
        with tracer.tracing():
            run()
        outside = {path for path in tracer.files if not any(part in path for part in INSIDE)}
        calls = [call for call in tracer.calls if set(call) <= outside]
        print(f"  {name}: {len(tracer.files)} files, {len(tracer.calls)} calls between them", end="")
        print(
            f"; outside environments {len(outside)} files, {len(calls)} calls" if "record" in name else "", flush=True
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("revision", help="revision of git to compare this tree with")
    parser.add_argument("--trace", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.trace:
        trace(Path(arguments.trace))
        return
    with tempfile.TemporaryDirectory() as work:
        for name, tree in ((arguments.revision, extract(arguments.revision, Path(work))), ("this tree", ROOT)):
            print(name, flush=True)
            environ = {"MUJOCO_GL": "disable", **os.environ, "PYTHONPATH": str(tree), "COMPARED_TREE": str(tree)}
            command = [sys.executable, __file__, arguments.revision, "--trace", str(tree)]
            subprocess.run(command, env=environ, cwd=work, check=True)


if __name__ == "__main__":
    main()
