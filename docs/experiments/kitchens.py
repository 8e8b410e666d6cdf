"""Measures of generated kitchens; each writes results/kitchens_*.json.

python docs/experiments/kitchens.py speed    vectors of 64 kitchens: 16 designs in one, and one design in each of 16
"""

import contextlib
import json
import statistics
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import trange

from kitchen_suite.domains.kitchens import KITCHENS
from kitchen_suite.vector_env.kitchens import KitchensVectorEnv

RESULTS = Path(__file__).parent / "results"
FIRST_SEED = 60_000

# Of `speed`: environments, designs, rounds of each number of threads, and control steps of a round.
NUM_ENVS, DESIGNS, ROUNDS, STEPS = 64, 16, 16, 40
THREADS = (1, 2)


def milliseconds(environments: KitchensVectorEnv, seed: int, actions: NDArray[np.float64]) -> tuple[float, float]:
    """Returns the time of a control step of all environments from a reset: of the clock, and of the processors [ms]."""
    environments.reset(seed=seed)
    started, used = time.perf_counter(), time.process_time()
    for action in actions:
        environments.step(action)
    times = time.perf_counter() - started, time.process_time() - used
    return times[0] / len(actions) * 1000, times[1] / len(actions) * 1000


def speed_row(threads: int) -> dict[str, Any]:
    """Returns median times of the vector of several designs and of those of one, which alternate, and their ratios."""
    settings = {**KITCHENS.tasks["any"], "num_threads": threads}
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (STEPS, NUM_ENVS, 9))
    with contextlib.ExitStack() as stack:
        several, *equal = (
            stack.enter_context(contextlib.closing(KitchensVectorEnv(NUM_ENVS, design=design, **settings)))
            for design in (range(DESIGNS), *range(DESIGNS))
        )
        rounds = []
        for seed in trange(FIRST_SEED, FIRST_SEED + ROUNDS, desc=f"{threads} threads", disable=None):
            # All designs take turns, in the same order before and after.
            one = equal[seed % DESIGNS]
            pairs = [(milliseconds(several, seed, actions), milliseconds(one, seed, actions)) for _ in range(2)]
            rounds.append(np.mean(pairs, axis=0))
    names = ("clock", "processors")
    columns = {name: [each[:, i].tolist() for each in rounds] for i, name in enumerate(names)}
    return {
        "threads": threads,
        **{f"{name}_several_ms": round(statistics.median(one for one, _ in columns[name]), 2) for name in names},
        **{f"{name}_equal_ms": round(statistics.median(other for _, other in columns[name]), 2) for name in names},
        **{f"{name}_ratio": round(statistics.median(b / a for a, b in columns[name]), 3) for name in names},
    }


def measure_speed() -> None:
    """Writes the speed of a vector of several designs as a share of that of vectors of one, with random actions."""
    rows = [speed_row(threads) for threads in THREADS]
    text = "[\n" + ",\n".join(map(json.dumps, rows)) + "\n]\n"
    (RESULTS / "kitchens_speed.json").write_text(text, encoding="utf-8")
    print(text)


MEASURES = {"speed": measure_speed}

if __name__ == "__main__":
    if len(sys.argv) != 2 or sys.argv[1] not in MEASURES:
        raise SystemExit(__doc__)
    MEASURES[sys.argv[1]]()
