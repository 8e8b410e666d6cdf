"""Plays vectorised episodes for hours, replays a sample of them, and writes results/soak.json.

python docs/experiments/soak.py                 until 10 million control steps and two hours; goes on where it stopped
python docs/experiments/soak.py --minutes=30    stops after this time at the latest

Each part plays one combination of domain, physics, control mode, variations, autoreset mode and threads, drawn by its
number: 64 environments with random actions. One of them is played again in a single environment, and two further
episodes are recorded by `kitchen-record` and replayed by `kitchen-replay`. A row of the results has the control steps,
the episodes, the numbers that were not finite, those that differed, and the memory of the process at its end. Linux
only.
"""

import contextlib
import ctypes
import gc
import io
import itertools
import tempfile
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from experiment import RESULTS, Row, make_parser, read_rows, resident_memory, write_rows
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from tqdm import tqdm

from kitchen_suite import suite
from kitchen_suite.commands import record, replay
from kitchen_suite.tasks.variations.distributions import GROUPS, SPLITS

TOTAL_STEPS = 10_000_000
TOTAL_SECONDS = 2 * 3600.0
NUM_ENVS = 64
# Control steps of a part that are played again in a single environment.
REPLAYED = 100
# Steps of a part by domain and physics; those of the exact kitchen take about five times as long as others.
STEPS = {
    ("kitchen", "exact"): 400,
    ("kitchen", "fast"): 1600,
    ("open_cabinet", "exact"): 1000,
    ("microwave_table", "exact"): 1000,
    ("microwave_table", "fast"): 1600,
}
# Parts that were played before there was a fast physics; later ones play that where a domain has it.
EXACT_PARTS = 94
# Variations: none, each group alone, all together.
VARIATIONS: tuple[tuple[str, ...], ...] = ((), *((group,) for group in GROUPS), tuple(GROUPS))
# Greatest changes of the action in a control step, in units of its bounds.
AMPLITUDES = (0.05, 0.3, 1.0)

Step = tuple[NDArray, ...]


def case(number: int) -> dict[str, Any]:
    """Returns the combination of a part: all domains and control modes in turn, the rest at random."""
    random = np.random.default_rng(number)
    modes = [(name, mode) for name, domain in suite.DOMAINS.items() for mode in domain.resolve("task").control_modes]
    domain, mode = modes[number % len(modes)]
    return {
        "domain": domain,
        "task": str(random.choice([*suite.DOMAINS[domain].tasks])),
        "control_mode": mode,
        "variations": list(VARIATIONS[random.integers(len(VARIATIONS))]),
        "variation_split": str(random.choice(SPLITS)),
        "autoreset": str(random.choice([mode.value for mode in AutoresetMode])),
        "num_threads": int(random.integers(1, 3)),
        "max_episode_steps": int(random.integers(20, 400)),
        "amplitude": float(random.choice(AMPLITUDES)),
        "physics": "fast" if number >= EXACT_PARTS and (domain, "fast") in STEPS else "exact",
    }


def arguments(case: dict[str, Any]) -> dict[str, Any]:
    """Returns the arguments of the Gymnasium environment."""
    names = ("physics", "control_mode", "variations", "variation_split", "max_episode_steps")
    return {**suite.task_arguments(case["domain"], case["task"]), **{name: case[name] for name in names}}


def actions(space: gymnasium.spaces.Box, amplitude: float, seed: int) -> Iterator[NDArray]:
    """Yields actions `(n, k)` without end: random walks within the bounds, of at most 1 where there are none."""
    random = np.random.default_rng(seed)
    low, high = np.maximum(space.low, -1.0), np.minimum(space.high, 1.0)
    action = np.zeros(space.shape)
    while True:
        action = np.clip(action + amplitude * random.uniform(low, high), low, high)
        yield action.astype(space.dtype)


def play(environments: gymnasium.vector.VectorEnv, seed: int, played: Iterator[NDArray]) -> Iterator[Step]:
    """Yields the arrays of a reset, and of steps without end, with the resets of mode `Disabled`."""
    is_disabled = environments.metadata["autoreset_mode"] == AutoresetMode.DISABLED
    observations, infos = environments.reset(seed=seed)
    yield tuple(flat(observations))
    for action in played:
        observations, rewards, terminations, truncations, infos = environments.step(action)
        diverged = infos.get("physics_error", np.zeros(len(rewards), bool))
        ended = terminations | truncations
        if is_disabled and ended.any():
            observations, _ = environments.reset(options={"reset_mask": ended})
        yield (rewards, terminations, truncations, diverged, *flat(observations))


def flat(observations: Any) -> list[NDArray]:
    """Returns the arrays of nested dicts, in the order of their keys."""
    if not isinstance(observations, dict):
        return [observations]
    return [array for _, part in sorted(observations.items()) for array in flat(part)]


def soak(number: int) -> Row:
    """Plays the part of a number; returns its row."""
    chosen = case(number)
    count = STEPS[chosen["domain"], chosen["physics"]]
    random = np.random.default_rng((number, 1))
    row, seed = int(random.integers(NUM_ENVS)), 1_000 * number
    env_id = suite.DOMAINS[chosen["domain"]].env_id
    many = gymnasium.make_vec(
        env_id,
        NUM_ENVS,
        vectorization_mode="vector_entry_point",
        num_threads=chosen["num_threads"],
        autoreset_mode=chosen["autoreset"],
        **arguments(chosen),
    )
    single = gymnasium.make_vec(
        env_id,
        1,
        vectorization_mode="sync",
        vector_kwargs={"autoreset_mode": AutoresetMode(chosen["autoreset"])},
        **arguments(chosen),
    )
    not_finite = episodes = diverged = compared = differences = 0
    with contextlib.closing(many), contextlib.closing(single):
        assert isinstance(many.action_space, gymnasium.spaces.Box)
        walks = itertools.tee(actions(many.action_space, chosen["amplitude"], seed))
        steps = play(many, seed, walks[0])
        repeated = play(single, seed + row, (action[[row]] for action in walks[1]))
        for step, arrays in enumerate(itertools.islice(steps, count + 1)):
            not_finite += sum(int((~np.isfinite(array)).sum()) for array in arrays)
            if step:
                _, terminations, truncations, errors, *_ = arrays
                episodes += int((terminations | truncations).sum())
                diverged += int(errors.sum())
            if step <= REPLAYED and not diverged:
                for one, other in zip(arrays, next(repeated), strict=True):
                    compared += other.size
                    differences += int((one[[row]] != other).sum())
    return {
        "part": number,
        **chosen,
        "control_steps": NUM_ENVS * count,
        "episodes": episodes,
        "not_finite": not_finite,
        "diverged": diverged,
        "compared": compared,
        "differences": differences,
        "replay": replayed(chosen, seed),
    }


def replayed(case: dict[str, Any], seed: int) -> str:
    """Records two episodes, and replays them; returns the exit statuses of both commands, `0 0` for equal ones."""
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        flags = {
            "domain_name": case["domain"],
            "task_name": case["task"],
            "physics": case["physics"],
            "control_mode": case["control_mode"],
            "policy": "random",
            "variations": ",".join(case["variations"]),
            "variation_split": case["variation_split"],
            "max_episode_steps": case["max_episode_steps"],
            "num_episodes": 2,
            "num_envs": 2,
            "seed": seed,
            "output": f"{folder}/recording",
        }
        recorded = record.main([f"--{name}={value}" for name, value in flags.items() if value != ""])
        return f"{recorded} {replay.main([f'{folder}/recording'])}"


def main() -> None:
    """Plays the parts that are missing."""
    parser = make_parser(__doc__)
    parser.add_argument("--minutes", type=float, default=float("inf"), help="stop after this time")
    parser.add_argument("--results", type=Path, default=RESULTS / "soak.json", help="file of the rows")
    options = parser.parse_args()
    rows = read_rows(options.results)
    process = 1 + max((row["process"] for row in rows), default=0)
    started = time.monotonic()
    warnings.simplefilter("error", RuntimeWarning)
    with tqdm(total=TOTAL_STEPS, initial=sum(row["control_steps"] for row in rows), unit="steps", disable=None) as bar:
        while sum(row["control_steps"] for row in rows) < TOTAL_STEPS or total_seconds(rows) < TOTAL_SECONDS:
            if time.monotonic() - started > 60 * options.minutes:
                return
            begun = time.monotonic()
            row = soak(len(rows))
            gc.collect()
            # Freed memory that the C library keeps for later grows with the number of environments that were built.
            ctypes.CDLL(None).malloc_trim(0)
            seconds = round(time.monotonic() - begun, 1)
            rows.append({"process": process, **row, "seconds": seconds, "memory": round(resident_memory(), 1)})
            write_rows(options.results, rows)
            bar.update(row["control_steps"])


def total_seconds(rows: list[Row]) -> float:
    """Returns the time that the parts have taken [s]."""
    return sum(row["seconds"] for row in rows)


if __name__ == "__main__":
    main()
