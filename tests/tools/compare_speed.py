"""Compares the speed of two versions of the suite side by side.

python tests/tools/compare_speed.py REVISION --rounds=21

A process for that revision of this repository and one for this tree play the same episodes in turn, never at the same
time. For each case the table has the ratio of control steps per second, this tree over that revision: the median over
pairs of episodes, the quartiles, and the number of pairs. In a round every case has about a second for each tree, so
short episodes have more pairs. Machines are shared and noisy: only the ratios mean anything. Exit status: 0 if every
median is at least 0.98, else 1.
"""

import argparse
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import trees
from tqdm import tqdm

LEAST = 0.98
# Control steps of a round, and the environments of vectorised cases.
STEPS, MANY = 280, 32
# Time that a case has in a round, for each tree [s].
SECONDS = 1.0

Play = Callable[[], None]


def cases() -> dict[str, Play]:
    """By name, functions that play an episode."""
    import gymnasium

    from kitchen_suite import suite

    made: dict[str, Play] = {}
    kitchen = {"terminate_on_tasks_completed": False}
    for domain, task, env_id, kwargs, scale in (
        ("kitchen", "all", "KitchenSuite/FrankaKitchen-v1", kitchen, 1.0),
        ("open_cabinet", "top_drawer", "KitchenSuite/FrankaOpenCabinet-v1", {}, 0.01),
    ):
        quiet = {"random": 0, "time_limit": None, **kwargs}
        for name, visuals in (("suite.load", False), ("suite.load, with visuals", True)):
            made[f"{domain}: {name}"] = player(suite.load(domain, task, {**quiet, "visuals": visuals}), scale)
        adapter = gymnasium.make(f"kitchen_suite.gymnasium_env:{env_id}", **kwargs).unwrapped
        made[f"{domain}: Gymnasium adapter"] = player(adapter, scale)
        for num_threads in (1, 2):
            environments = gymnasium.make_vec(
                env_id, MANY, vectorization_mode="vector_entry_point", num_threads=num_threads, **kwargs
            )
            made[f"{domain}: {MANY} vectorised, {num_threads} threads"] = player(environments, scale, MANY)
    fast = gymnasium.make("KitchenSuite/FrankaKitchen-v1", physics="fast", **kitchen).unwrapped
    made["fast kitchen: Gymnasium adapter"] = player(fast, 1.0)
    return made


def player(environment: object, scale: float, count: int = 0) -> Play:
    space = getattr(environment, "action_space", None)
    shape = space.shape if space else environment.action_spec().shape
    actions = np.random.default_rng(0).uniform(-scale, scale, (STEPS // (4 if count else 1), *shape))

    def play() -> None:
        environment.reset()
        for action in actions:
            environment.step(action)

    return play


def serve() -> None:
    """Plays an episode of each case that it is told by a line on stdin; answers with how long it took [s]."""
    made = cases()
    print(*made, sep="\t", flush=True)
    for line in sys.stdin:
        start = time.perf_counter()
        made[line.strip()]()
        print(time.perf_counter() - start, flush=True)


class Server:
    """A process that plays on one tree."""

    def __init__(self, tree: Path, revision: str) -> None:
        environ = trees.environ(tree)
        command = [sys.executable, __file__, revision, "--serve"]
        self.process = subprocess.Popen(
            command, env=environ, cwd=tree, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self.cases = self._answer().split("\t")

    def seconds(self, case: str) -> float:
        """Plays an episode; returns how long it took [s]."""
        assert self.process.stdin
        print(case, file=self.process.stdin, flush=True)
        return float(self._answer())

    def _answer(self) -> str:
        assert self.process.stdout
        return self.process.stdout.readline().rstrip("\n")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("revision", help="revision of git to compare this tree with")
    parser.add_argument("--rounds", type=int, default=21)
    parser.add_argument("--only", default="", help="play only the cases whose name contains this")
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.serve:
        serve()
        return 0
    with tempfile.TemporaryDirectory() as work:
        before, after = (
            Server(tree, arguments.revision)
            for tree in (trees.extract(arguments.revision, Path(work, "tree")), trees.ROOT)
        )
        ratios: dict[str, list[float]] = {case: [] for case in after.cases if arguments.only in case}
        # The first episodes warm up, and tell how long they take.
        pairs = {
            case: max(1, round(SECONDS / max(server.seconds(case) for server in (before, after)))) for case in ratios
        }
        for _ in tqdm(range(arguments.rounds), unit="round", disable=None):
            for case, count in pairs.items():
                for _ in range(count):
                    # Which tree is first alternates.
                    order = (after, before) if len(ratios[case]) % 2 else (before, after)
                    seconds = {server: server.seconds(case) for server in order}
                    ratios[case].append(seconds[before] / seconds[after])
    medians = {case: statistics.median(values) for case, values in ratios.items()}
    for case, values in ratios.items():
        low, _, high = statistics.quantiles(values, n=4)
        print(f"{case:<48}{medians[case]:7.3f}  ({low:.3f} to {high:.3f})  {len(values):5} pairs")
    return 0 if min(medians.values()) >= LEAST else 1


if __name__ == "__main__":
    sys.exit(main())
