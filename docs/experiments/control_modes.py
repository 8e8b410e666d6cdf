"""Measures the control modes; writes results/control_modes_*.json.

python docs/experiments/control_modes.py tracking   how still the end effector stands, and how straight it moves
python docs/experiments/control_modes.py speed      speed of 32 vectorised kitchens, relative to joint_velocity
"""

import contextlib
import functools
import importlib
import json
import statistics
import sys
import time
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from kitchen_suite import suite
from kitchen_suite.environment import Environment
from kitchen_suite.gymnasium_env import KITCHEN_ID

sys.path.append(str(Path(__file__).parent.parent / "scripts"))
tracking = importlib.import_module("tracking")

RESULTS = Path(__file__).parent / "results"
NUM_ENVS, ROUNDS, STEPS = 32, 15, 20
SPEED_MODES = ("joint_velocity", "joint_position", *tracking.HOLDING_MODES)


def load(domain: str, mode: str) -> Environment:
    """Loads a domain with a control mode; its episodes do not end."""
    settings = {"terminate_on_tasks_completed": False} if domain == "kitchen" else {}
    return tracking.load(domain, mode, **settings)


def measure_tracking() -> None:
    """Writes drift and worst line of every mode of the end effector in every domain."""
    rows = []
    cases = [(domain, mode) for domain in suite.DOMAINS for mode in tracking.HOLDING_MODES]
    for domain, mode in tqdm(cases, unit="mode", disable=None):
        drift, turn = tracking.drift(load(domain, mode), mode, suite.DOMAINS[domain].episode_steps)
        row = {"domain": domain, "control_mode": mode, "drift": drift, "turn": turn}
        if mode in tracking.LINE_MODES:
            ways = [(axis, sign) for axis in range(3) for sign in (1, -1)]
            lines = [tracking.follow_line(load(domain, mode), mode, *way) for way in ways]
            row |= {name: max(getattr(line, name) for line in lines) for name in ("lateral", "rotation", "shortfall")}
        rows.append(row)
    write("control_modes_tracking", rows)


def measure_speed() -> None:
    """Writes the speed of the vectorised kitchen in every mode, relative to `joint_velocity`, in alternating rounds."""
    with contextlib.ExitStack() as stack:
        environments = {}
        for mode in SPEED_MODES:
            made = gymnasium.make_vec(KITCHEN_ID, NUM_ENVS, control_mode=mode, num_threads=1)
            environments[mode] = stack.enter_context(contextlib.closing(made))
        ratios: dict[str, list[float]] = {mode: [] for mode in SPEED_MODES}
        # The first round warms up.
        for number in tqdm(range(ROUNDS + 1), unit="round", disable=None):
            order = SPEED_MODES if number % 2 else SPEED_MODES[::-1]
            seconds = {mode: play(environments[mode], mode, number) for mode in order}
            for mode in SPEED_MODES if number else ():
                ratios[mode].append(seconds["joint_velocity"] / seconds[mode])
    write(
        "control_modes_speed",
        [
            {"control_mode": mode, "median": statistics.median(values), "quartiles": statistics.quantiles(values)[::2]}
            for mode, values in ratios.items()
        ],
    )


def play(environments: gymnasium.vector.VectorEnv, mode: str, seed: int) -> float:
    """Holds the arm nearly still, as the cost of the physics depends on the motion; returns the time [s]."""
    environments.reset(seed=seed)
    noise = np.random.default_rng(seed).uniform(-0.02, 0.02, (STEPS, *environments.action_space.shape))
    actions = still_action(mode) + noise
    started = time.perf_counter()
    for action in actions:
        environments.step(action)
    return time.perf_counter() - started


@functools.cache
def still_action(mode: str) -> NDArray[np.float64]:
    """Returns an action of the kitchen that holds the arm at the start."""
    environment = load("kitchen", mode)
    if mode == "joint_velocity":
        return np.zeros(environment.action_spec().shape)
    if mode == "joint_position":
        return np.array(environment.physics.bind(environment.task.robot.joints).qpos)
    return tracking.holding_action(environment, mode)


def write(name: str, rows: list[dict[str, Any]]) -> None:
    """Writes results to docs/experiments/results/, and prints them."""
    (RESULTS / f"{name}.json").write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(rows, indent=1))


if __name__ == "__main__":
    commands = {"tracking": measure_tracking, "speed": measure_speed}
    if len(sys.argv) != 2 or sys.argv[1] not in commands:
        sys.exit(__doc__)
    commands[sys.argv[1]]()
