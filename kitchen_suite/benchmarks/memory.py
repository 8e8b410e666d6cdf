"""Measures memory: what each further environment takes, and whether a long run leaves anything behind."""

import concurrent.futures
import multiprocessing
import resource
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from kitchen_suite.benchmarks.cases import THREADS
from kitchen_suite.benchmarks.domains import DOMAINS
from kitchen_suite.benchmarks.speed import throughput

_MEBIBYTE = 2**20
# How often a long run is looked at.
_SAMPLES = 20

# Environments of EnvPool that still fit into the memory of common machines.
_MOST_ENVPOOL = 128


def resident_memory() -> float:
    """Memory that this process holds in RAM [MiB]; Linux only."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / _MEBIBYTE


def memory_of(domain_name: str, builder: str, environments: int) -> float:
    """Memory [MiB] that this process holds with so many environments in use."""
    domain = DOMAINS[domain_name]
    environment = domain.builders[builder](environments, 1)
    environment.reset()
    for actions in domain.draw(np.random.default_rng(0), (5, environments)):
        environment.step(actions)
    return resident_memory()


def memory_per_environment(domain_name: str, builder: str, environments: int) -> float:
    """Memory [MiB] of each environment beyond the first; either number of them in a process of its own."""
    context = multiprocessing.get_context("spawn")
    held = []
    for count in (1, environments):
        with concurrent.futures.ProcessPoolExecutor(1, mp_context=context) as executor:
            held.append(executor.submit(memory_of, domain_name, builder, count).result())
    return (held[1] - held[0]) / (environments - 1)


def scaling(domain_name: str, sizes: Sequence[int], *, control_steps: int) -> list[dict[str, Any]]:
    """Throughput and memory by number of environments and threads; memory [MiB] of one of many, on one thread."""
    rows, domain = [], DOMAINS[domain_name]
    cases = [
        (name, size, threads)
        for name in domain.builders
        for size in sizes
        for threads in THREADS
        if not (name == "EnvPool" and size > _MOST_ENVPOOL)
    ]
    for builder, size, threads in tqdm(cases, disable=None):
        environment = domain.builders[builder](size, threads)
        row = {"builder": builder, "environments": size, "threads": threads, "memory": None}
        row["steps_per_second"] = throughput(domain, environment, control_steps=control_steps)
        environment.close()
        if size > 1 and threads == 1:
            row["memory"] = memory_per_environment(domain_name, builder, size)
        rows.append(row)
    return rows


def soak(domain_name: str, *, environments: int, control_steps: int) -> dict[str, list[float]]:
    """Memory [MiB] in the course of a long run with episodes of the usual length, by control steps made."""
    domain = DOMAINS[domain_name]
    environment = domain.builders["vectorised"](environments, THREADS[-1])
    rng = np.random.default_rng(0)
    per_sample = -(-control_steps // (_SAMPLES * environments))
    environment.reset(seed=0)
    made, memory = [0.0], [resident_memory()]
    with tqdm(total=_SAMPLES * per_sample * environments, unit="steps", disable=None) as bar:
        for _ in range(_SAMPLES):
            for _ in range(per_sample):
                environment.step(domain.draw(rng, (environments,)))
                bar.update(environments)
            made.append(made[-1] + per_sample * environments)
            memory.append(resident_memory())
    return {"control_steps": made, "memory": memory}
