"""Measures how fast the drawer is trained, and what takes the time; writes results/training_speed.json.

The shares of the time in which environments step and in which networks are updated can add up to more than one: an
update runs while the next batch is collected.

`python docs/experiments/training_speed.py` measures the present hyperparameters and earlier ones, with one thread and
with two that step the environments, in alternating rounds; the medians of the rounds are written. It needs the extra
`train`. `docs/scripts/tables.py` makes the tables.
"""

import contextlib
import json
import statistics
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium
from gymnasium.vector import AutoresetMode
from tqdm import tqdm

from kitchen_suite.gymnasium_env import OPEN_CABINET_ID

RESULTS = Path(__file__).parent / "results" / "training_speed.json"

# Changes to the hyperparameters.
SETTINGS: Mapping[str, Mapping[str, Any]] = {
    "present": {},
    "earlier": {"num_envs": 1024, "learning_epochs": 5, "mini_batches": 8, "hidden": [256, 128, 64]},
}
THREADS = (1, 2)

ROUNDS = 5
# Control steps of a round, over all environments.
STEPS = 65_536


class Case:
    """A learner whose parts are timed."""

    def __init__(self, name: str, threads: int) -> None:
        """Builds the learner of some settings; `threads` step its environments."""
        from kitchen_suite.training.ppo import PPOLearner
        from kitchen_suite.training.recipes import PPOHyperparameters

        self.name, self.threads = name, threads
        self.config = PPOHyperparameters.for_domain("open_cabinet", SETTINGS[name])
        self.environments: Any = gymnasium.make_vec(
            OPEN_CABINET_ID,
            self.config.num_envs,
            vectorization_mode="vector_entry_point",
            num_threads=threads,
            autoreset_mode=AutoresetMode.SAME_STEP,
        )
        self._step, self._stepping = self.environments.step, 0.0
        self.environments.step = self._timed_step
        self._learner = PPOLearner(self.environments, self.config, 0)
        self._learner.start(0)

    def _timed_step(self, actions: Any) -> Any:
        started = time.perf_counter()
        result = self._step(actions)
        self._stepping += time.perf_counter() - started
        return result

    def play(self) -> dict[str, float]:
        """Returns the durations of a round by part [s]."""
        self._stepping, updating, started = 0.0, 0.0, time.perf_counter()
        for _ in range(STEPS // self.config.batch_size):
            updating += self._learner.learn()["time/update_milliseconds"] / 1000
        total = time.perf_counter() - started
        return {"total": total, "environments": self._stepping, "update": updating}


def measure(rounds: int) -> list[dict[str, Any]]:
    """Returns a row for each case."""
    import torch

    torch.set_num_threads(1)
    with contextlib.ExitStack() as stack:
        cases = [Case(name, threads) for name in SETTINGS for threads in THREADS]
        for case in cases:
            stack.enter_context(contextlib.closing(case.environments))
        # The first round warms up.
        played = [[case.play() for case in cases] for _ in tqdm(range(rounds + 1), unit="round", disable=None)][1:]
    rows = []
    for case, results in zip(cases, zip(*played, strict=True), strict=True):
        medians = {name: statistics.median(result[name] for result in results) for name in results[0]}
        row = {"settings": case.name, "threads": case.threads, "steps_per_second": STEPS / medians["total"]}
        rows.append({**row, **{name: medians[name] / medians["total"] for name in ("environments", "update")}})
    return rows


def main(rounds: str = str(ROUNDS)) -> None:
    """Measures, and writes and prints the results."""
    rows = measure(int(rounds))
    RESULTS.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main(*sys.argv[1:])
