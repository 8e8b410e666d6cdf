"""Measures memory: of each further environment, and in the course of a long run."""

import concurrent.futures
import contextlib
import functools
import itertools
import multiprocessing
import resource
import signal
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from kitchen_suite.benchmarks.cases import NUM_THREADS, BenchmarkDomain
from kitchen_suite.benchmarks.speed import throughput
from kitchen_suite.rendering import gl

_SOAK_SAMPLES = 20

# Number of EnvPool's environments that still fit into the memory of common machines.
_MAX_ENVPOOL = 128


def resident_memory() -> float:
    """Returns the memory that this process holds in RAM [MiB]; Linux only."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / 2**20


def memory_in_use(domain: BenchmarkDomain, name: str, num_envs: int) -> float:
    """Returns the memory that this process holds with vectorised environments that have made a few steps [MiB]."""
    # Ctrl-C, which the command reports, ends the process silently.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    environments = domain.vector_env(name, num_envs, 1)
    environments.reset()
    for actions in domain.draw_actions(np.random.default_rng(0), (5, num_envs)):
        environments.step(actions)
    return resident_memory()


def memory_per_environment(domain: BenchmarkDomain, name: str, num_envs: int) -> float:
    """Measures the memory of each environment beyond the first [MiB], in new processes with one and all of them."""
    # Before dm_control is imported with the function that is submitted.
    prepare = functools.partial(gl.prepare, rendering=False)
    memory = []
    for count in (1, num_envs):
        with concurrent.futures.ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), prepare) as executor:
            memory.append(executor.submit(memory_in_use, domain, name, count).result())
    return (memory[1] - memory[0]) / (num_envs - 1)


def scaling(domain: BenchmarkDomain, num_envs: Sequence[int], num_steps: int) -> list[dict[str, Any]]:
    """Measures throughput by number of environments and threads, and memory per environment [MiB] on one thread.

    Each measurement of throughput makes `num_steps` control steps, over all environments.
    """
    rows = []
    for name, count, threads in tqdm([*itertools.product(domain.vector_names, num_envs, NUM_THREADS)], disable=None):
        if name == "EnvPool" and count > _MAX_ENVPOOL:
            continue
        with contextlib.closing(domain.vector_env(name, count, threads)) as environments:
            rate = throughput(domain, environments, num_steps=num_steps)
        memory = memory_per_environment(domain, name, count) if count > 1 and threads == 1 else None
        sizes = {"num_envs": count, "num_threads": threads}
        rows.append({"vector_env": name, **sizes, "memory": memory, "steps_per_second": rate})
    return rows


def soak(domain: BenchmarkDomain, num_envs: int, num_steps: int) -> dict[str, list[float]]:
    """Samples the memory [MiB] in the course of a long run of the suite's vectorised environments.

    `num_steps` is rounded up to a multiple of the number of samples and environments.
    """
    environments = domain.vector_env("vectorised", num_envs, NUM_THREADS[-1])
    rng = np.random.default_rng(0)
    steps_per_sample = -(-num_steps // (_SOAK_SAMPLES * num_envs))
    environments.reset(seed=0)
    done, memory = [0.0], [resident_memory()]
    with tqdm(total=_SOAK_SAMPLES * steps_per_sample * num_envs, unit="steps", disable=None) as bar:
        for _ in range(_SOAK_SAMPLES):
            for _ in range(steps_per_sample):
                environments.step(domain.draw_actions(rng, (num_envs,)))
                bar.update(num_envs)
            done.append(done[-1] + steps_per_sample * num_envs)
            memory.append(resident_memory())
    return {"num_steps": done, "memory": memory}
