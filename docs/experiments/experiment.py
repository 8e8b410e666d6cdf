"""Shared parts of the experiments: episodes, rows that are measured once, processes, and command lines."""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import argparse
import contextlib
import itertools
import json
import multiprocessing
import os
import resource
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

import dm_env
import numpy as np
from dm_control.rl.control import PhysicsError
from tqdm import tqdm

from kitchen_suite import policies
from kitchen_suite.environment import Environment
from kitchen_suite.policies import Policy

_DOCS = Path(__file__).resolve().parent.parent
RESULTS = _DOCS / "experiments" / "results"
PICTURES = _DOCS / "pictures"

# Episodes that a process plays before it is given others; those of a case share an environment.
_CHUNK = 20

Row = dict[str, Any]
Case = tuple[Any, ...]
Played = TypeVar("Played")


def timesteps(environment: dm_env.Environment, act: Policy) -> Iterator[dm_env.TimeStep]:
    """Plays an episode; yields the time step of its reset, and of each control step before the next one is made."""
    timestep = environment.reset()
    yield timestep
    while not timestep.last():
        timestep = environment.step(act(timestep))
        yield timestep


def play(environment: Environment, policy: str, seed: int) -> tuple[bool, int]:
    """Plays the episode of a seed; returns whether it was a success, and its control steps.

    An episode in which the physics diverges is a failure.
    """
    environment.random_state.seed(seed)
    environment.task.reset_statistics()
    act = policies.find(policy)(environment, np.random.default_rng(seed))
    steps = 0
    with contextlib.suppress(PhysicsError):
        for timestep in timesteps(environment, act):
            steps += not timestep.first()
        return bool(environment.task.episode_metrics["success"]), steps
    return False, steps


def in_processes(work: Callable[[Any], Played], items: Iterable[Any], chunksize: int = 1) -> Iterator[Played]:
    """Yields the results of a function for all items in their order, from as many processes as there are CPUs."""
    with multiprocessing.get_context("spawn").Pool() as pool:
        yield from pool.imap(work, items, chunksize)


def play_cases(play: Callable[[Case], Played], counts: Mapping[Case, int], first_seed: int) -> dict[Case, list[Played]]:
    """Plays a number of episodes of each case, in several processes; returns their results by case.

    `play` takes a case with a seed as its last element; the seeds of each case begin at `first_seed`.
    """
    episodes = [(*case, first_seed + i) for case, count in counts.items() for i in range(count)]
    played = in_processes(play, episodes, _CHUNK)
    results = iter([*tqdm(played, total=len(episodes), unit="episode", smoothing=0.0, disable=None)])
    return {case: [*itertools.islice(results, count)] for case, count in counts.items()}


def read_rows(path: Path) -> list[Row]:
    """Returns the rows of a file; none if there is no file."""
    rows: list[Row] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else []
    return rows


def write_rows(path: Path, rows: Iterable[Mapping[str, Any]]) -> None:
    """Writes a file of rows, one a line; an existing one is replaced as a whole."""
    partial = path.with_suffix(".part")
    partial.write_text("[\n" + ",\n".join(map(json.dumps, rows)) + "\n]\n", encoding="utf-8")
    os.replace(partial, path)


def measure_missing(
    path: Path,
    cases: Iterable[Row],
    measure: Callable[[Row], Row],
    apply: Callable[[Callable[[Row], Row], list[Row]], Iterable[Row]] = map,
) -> None:
    """Measures the cases that have no row in a file yet, and writes each row, a case with its results, when it is done.

    `apply` is `map`, or `in_processes` for several cases at a time.
    """
    rows = read_rows(path)
    missing = [case for case in cases if not any(case.items() <= row.items() for row in rows)]
    measured = tqdm(apply(measure, missing), total=len(missing), desc=path.stem, unit="case", disable=None)
    for case, results in zip(missing, measured, strict=True):
        rows.append({**case, **results})
        write_rows(path, rows)


def run_command(command: str, *flags: object) -> None:
    """Runs a command of the suite, such as `record`; raises an error if it fails."""
    subprocess.run([sys.executable, "-m", "kitchen_suite", command, *map(str, flags)], check=True)


def make_parser(documentation: str | None) -> argparse.ArgumentParser:
    """Returns a parser of a script's command line, whose help is the script's documentation."""
    return argparse.ArgumentParser(
        description=documentation, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False
    )


def positive(text: str) -> int:
    """Returns the positive number that an argument is."""
    if not (text.isdecimal() and int(text) > 0):
        raise argparse.ArgumentTypeError(f"{text!r} is not a positive number")
    return int(text)


def numbers(text: str) -> tuple[int, ...]:
    """Returns the positive numbers of a list such as `1,8,32`."""
    return tuple(positive(number) for number in text.split(","))


def run_named(documentation: str | None, functions: Mapping[str, Callable[[], None]]) -> None:
    """Runs the function that the command line names."""
    parser = make_parser(documentation)
    parser.add_argument("name", choices=functions)
    functions[parser.parse_args().name]()


def resident_memory() -> float:
    """Returns the memory that this process holds in RAM [MiB]; Linux only."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / 2**20
