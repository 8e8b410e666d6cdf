"""Measures how the vectorised environments scale with threads and environments; writes results/scaling.json.

python docs/experiments/scaling.py                                      ten minutes on any machine
python docs/experiments/scaling.py --minutes=2 --num_envs=32,256 --num_threads=1,2

Kitchen and cabinet are stepped with random actions on 1, 2, 4, ... and all processors. In every round each cell of the
table has the same time, directly before MuJoCo's own batch of the same model, environments and threads; efficiency and
other ratios are taken within a round, and the table has their medians, since machines are shared and noisy. Where there
is a GL library, one cell observes pictures. `pip install envpool` adds cells of EnvPool.

`docs/scripts/tables.py` makes the tables.
"""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import concurrent.futures
import contextlib
import dataclasses
import functools
import gc
import itertools
import json
import math
import multiprocessing
import os
import platform
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from benchmark_cases import DOMAINS, ENVPOOL, BareBatch, BenchmarkDomain, Control
from benchmark_tables import command_line, plain, versions
from experiment import RESULTS, make_parser, numbers, positive, resident_memory
from numpy.typing import NDArray
from tqdm import tqdm

from kitchen_suite.rendering import gl
from kitchen_suite.vector_env.base import processors

# Vectorised environments of each domain, by the names that `BenchmarkDomain.vector_env` takes.
MEASURED = {"kitchen": ("vectorised", "vectorised, fast physics"), "open_cabinet": ("vectorised",)}
PIXELS = "vectorised, pixels 64 x 64"

NUM_ENVS = (32, 256, 1024)
PIXEL_ENVS = 32
MAX_ENVPOOL = 128  # Number of EnvPool's environments that still fit into the memory of common machines.

ROUNDS = 5
MINUTES = 10.0

_DRAWN = 16  # Control steps whose actions are drawn; they are repeated.
_PIXEL_OPTIONS = {"obs_type": "pixels", "image_size": (64, 64), "render_quality": None}


class Environments(Protocol):
    """Environments that are reset and stepped together."""

    def reset(self) -> object:
        """Starts an episode in every environment."""

    def step(self, actions: NDArray[np.float64], /) -> object:
        """Makes a control step with actions `(n, k)`."""


class Visit(NamedTuple):
    """The time that a cell has had in one round.

    Attributes:
      rate: control steps per second, over all environments.
      reset: duration of a reset of all environments [control steps of all environments].
    """

    rate: float
    reset: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class Cell:
    """Environments of one kind, on some threads.

    Attributes:
      name: of their kind, with the domain.
      num_envs: number of environments.
      num_threads: number of threads that step them.
      build: builds the environments.
      control: sets the controls of MuJoCo's batch of the same simulations; None if that is not measured.
      actions: `(k, num_envs, n)`, actions of `k` control steps, which are repeated.
    """

    name: str
    num_envs: int
    num_threads: int
    build: Callable[[], Any]
    control: Control | None
    actions: NDArray[np.float64]

    @property
    def key(self) -> tuple[str, int, int]:
        """Name, number of environments and number of threads."""
        return self.name, self.num_envs, self.num_threads


def play(environments: Environments, actions: NDArray[np.float64], seconds: float) -> Visit:
    """Resets environments, and steps them for some time, at least one control step."""
    started = time.perf_counter()
    environments.reset()
    reset = time.perf_counter() - started
    started = time.perf_counter()
    for count in itertools.count(1):
        environments.step(actions[count % len(actions)])
        elapsed = time.perf_counter() - started
        if elapsed >= seconds:
            break
    return Visit(rate=count * actions.shape[1] / elapsed, reset=reset * count / elapsed)


def thread_counts(count: int) -> tuple[int, ...]:
    """Returns the powers of two below a number of processors, and that number."""
    return (*(2**power for power in range(math.ceil(math.log2(count)))), count)


def make_cells(num_envs: Sequence[int], num_threads: Sequence[int]) -> Iterator[Cell]:
    """Yields all cells without pictures."""
    rng = np.random.default_rng(0)
    for domain_name, measured in MEASURED.items():
        domain = DOMAINS[domain_name]
        names = [name for name in domain.vector_names if name in (*measured, ENVPOOL)]
        drawn = {count: domain.draw_actions(rng, (_DRAWN, count)) for count in num_envs}
        for name, count, threads in itertools.product(names, num_envs, num_threads):
            if name == ENVPOOL and count > MAX_ENVPOOL:
                continue
            yield Cell(
                name=f"{domain_name}: {name}",
                num_envs=count,
                num_threads=threads,
                build=functools.partial(domain.vector_env, name, count, threads),
                control=None if name == ENVPOOL else domain.control,
                actions=drawn[count],
            )


def pixel_cell(num_threads: int) -> Cell:
    """Returns the cell of kitchens that observe pictures, which one thread renders."""
    domain = DOMAINS["kitchen"]
    options = {"num_threads": num_threads, **domain.options, **_PIXEL_OPTIONS}
    return Cell(
        name=f"kitchen: {PIXELS}",
        num_envs=PIXEL_ENVS,
        num_threads=num_threads,
        build=functools.partial(domain.domain.vector_env_class, PIXEL_ENVS, **options),
        control=None,
        actions=domain.draw_actions(np.random.default_rng(0), (_DRAWN, PIXEL_ENVS)),
    )


def can_render() -> bool:
    """Whether there is a GL library that renders."""
    try:
        gl.prepare(rendering=True)
    except OSError:
        return False
    return True


def memory_in_use(domain: BenchmarkDomain, name: str, num_envs: int) -> float:
    """Returns the memory that this process holds with vectorised environments that have made a few steps [MiB]."""
    environments = domain.vector_env(name, num_envs, 1)
    environments.reset()
    for actions in domain.draw_actions(np.random.default_rng(0), (5, num_envs)):
        environments.step(actions)
    return resident_memory()


def memory_per_environment(domain: BenchmarkDomain, name: str, num_envs: int) -> float:
    """Measures the memory of each environment beyond the first [MiB], in new processes with one and all of them."""
    memory = []
    for count in (1, num_envs):
        with concurrent.futures.ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as executor:
            memory.append(executor.submit(memory_in_use, domain, name, count).result())
    return (memory[1] - memory[0]) / (num_envs - 1)


def measure_memory(num_envs: Sequence[int]) -> dict[str, float]:
    """Measures the memory of each environment by name of the cells, with the greatest number of environments [MiB]."""
    measured = {}
    for domain_name, names in MEASURED.items():
        domain = DOMAINS[domain_name]
        for name in [name for name in domain.vector_names if name in (*names, ENVPOOL)]:
            count = max(min(max(num_envs), MAX_ENVPOOL) if name == ENVPOOL else max(num_envs), 2)
            measured[f"{domain_name}: {name}"] = memory_per_environment(domain, name, count)
    return measured


def row_of(cell: Cell, visits: Sequence[Visit], alone: Sequence[Visit], one_thread: Sequence[Visit]) -> dict[str, Any]:
    """Returns the row of a cell.

    Args:
      cell: the cell.
      visits: its visits, one a round.
      alone: those of its bare batch; empty if there is none.
      one_thread: those of the cell with as many environments of its kind on one thread; empty if there is none.
    """
    return {
        "vector_env": cell.name,
        "num_envs": cell.num_envs,
        "num_threads": cell.num_threads,
        "steps_per_second": statistics.median(visit.rate for visit in visits),
        "efficiency": efficiency(visits, one_thread, cell.num_threads),
        "of_bare": median_ratio(visits, alone),
        "reset": statistics.median(visit.reset for visit in visits),
    }


def median_ratio(visits: Sequence[Visit], others: Sequence[Visit]) -> float | None:
    """Returns the median ratio of rates of the same rounds; None without others."""
    if not others:
        return None
    return statistics.median(visit.rate / other.rate for visit, other in zip(visits, others, strict=True))


def efficiency(visits: Sequence[Visit], one_thread: Sequence[Visit], num_threads: int) -> float | None:
    """Returns the rate of a thread relative to that of one thread alone; None where that was not measured."""
    ratio = median_ratio(visits, one_thread)
    return None if ratio is None else ratio / num_threads


def measure(
    *, num_envs: Sequence[int], num_threads: Sequence[int], rounds: int, minutes: float
) -> list[dict[str, Any]]:
    """Measures all cells within some time; returns their rows."""
    deadline = time.monotonic() + 60.0 * minutes
    memory = measure_memory(num_envs)
    cells = [*make_cells(num_envs, num_threads)]
    if can_render():
        cells.append(pixel_cell(max(num_threads)))
    plays = sum(1 if cell.control is None else 2 for cell in cells)
    of_cells: dict[tuple[str, int, int], list[Visit]] = {cell.key: [] for cell in cells}
    of_bare: dict[tuple[str, int, int], list[Visit]] = {cell.key: [] for cell in cells}
    building = 0.0
    for number in tqdm(range(rounds), unit="round", disable=None):
        # Building, which takes as long as in the round before, is part of the time of a round.
        seconds = max((deadline - time.monotonic()) / (rounds - number) - building, 0.0) / plays
        building = 0.0
        for cell in cells:
            started = time.monotonic()
            # Environments refer to one another in circles; a thousand of them take a gigabyte.
            gc.collect()
            with contextlib.closing(cell.build()) as environments:
                environments.reset()
                building += time.monotonic() - started
                of_cells[cell.key].append(play(environments, cell.actions, seconds))
                if cell.control is not None:
                    with contextlib.closing(BareBatch(environments, cell.num_threads, cell.control)) as bare:
                        of_bare[cell.key].append(play(bare, cell.actions, seconds))
    rows = []
    for cell in cells:
        single = (cell.name, cell.num_envs, 1)
        row = row_of(cell, of_cells[cell.key], of_bare[cell.key], of_cells.get(single, []))
        bare_efficiency = efficiency(of_bare[cell.key], of_bare.get(single, []), cell.num_threads)
        rows.append({**row, "bare_efficiency": bare_efficiency, "memory": memory.get(cell.name)})
    return rows


def machine() -> dict[str, Any]:
    """Returns the model of the processors, how many of them this process may use, and the load by other programs."""
    information = Path("/proc/cpuinfo")
    lines = information.read_text(encoding="utf-8").splitlines() if information.exists() else []
    models = [line.partition(": ")[2] for line in lines if line.startswith("model name")]
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    return {"processor": next(iter(models), platform.machine()), "processors": processors(), "load_before": load}


def main(arguments: Sequence[str] | None = None) -> None:
    """Runs the command."""
    parser = make_parser(__doc__)
    parser.add_argument("--num_envs", type=numbers, default=NUM_ENVS, help="environments stepped together")
    parser.add_argument("--num_threads", type=numbers, help="threads; by default 1, 2, 4, ... and all processors")
    parser.add_argument("--rounds", type=positive, default=ROUNDS, help="rounds over all cells")
    parser.add_argument("--minutes", type=float, default=MINUTES, help="duration of the whole measurement")
    parser.add_argument("--output", type=Path, default=RESULTS, help="folder of the results")
    options = parser.parse_args(arguments)
    described = {"command": command_line(parser, options), "machine": machine(), "versions": versions()}
    threads = options.num_threads or thread_counts(processors())
    rows = measure(num_envs=options.num_envs, num_threads=threads, rounds=options.rounds, minutes=options.minutes)
    results = {**described, "measure": "scaling", "results": rows}
    (options.output / "scaling.json").write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    print(plain(results))


if __name__ == "__main__":
    main()
