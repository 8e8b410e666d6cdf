"""Measures the control modes; writes results/control_modes_*.json.

python docs/experiments/control_modes.py tracking   how still the end effector stands, and how straight it moves
python docs/experiments/control_modes.py borders    how fast hand and joints get where the hand is sent out of its reach
python docs/experiments/control_modes.py speed      speed of 32 vectorised kitchens, relative to joint_velocity
"""

import contextlib
import functools
import statistics
import time
from typing import Any
from unittest import mock

import gymnasium
import numpy as np
import tracking
from experiment import RESULTS, in_processes, run_named, write_rows
from numpy.typing import NDArray
from tqdm import tqdm

from kitchen_suite import suite
from kitchen_suite.gymnasium_env import KITCHEN_ID
from kitchen_suite.tasks.control_modes import speed_limits

# Of `speed`: environments, rounds that count, and control steps of a round.
NUM_ENVS = 32
ROUNDS = 15
STEPS = 20
SPEED_MODES = ("joint_velocity", "joint_position", *tracking.HOLDING_MODES)

# Of `borders`: resets from which the hand is sent into each direction, for how long [s], the domains with limits, and
# what counts as fast.
RESETS = 6
DRIVE_SECONDS = 6.0
LIMITED_DOMAINS = ("open_cabinet", "microwave_table")
FAST_HAND = 1.5
FAST_JOINT = 3.0  # [rad/s]


def measure_tracking() -> None:
    """Writes drift and worst line of every mode of the end effector in every domain."""
    rows = []
    cases = [(domain, mode) for domain in suite.DOMAINS for mode in tracking.HOLDING_MODES]
    for domain, mode in tqdm(cases, unit="mode", disable=None):
        drift, turn = tracking.drift(tracking.load(domain, mode), mode, suite.DOMAINS[domain].episode_steps)
        row = {"domain": domain, "control_mode": mode, "drift": drift, "turn": turn}
        if mode in tracking.LINE_MODES:
            ways = [(axis, sign) for axis in range(3) for sign in (1, -1)]
            lines = [tracking.follow_line(tracking.load(domain, mode), mode, *way) for way in ways]
            row |= {name: max(getattr(line, name) for line in lines) for name in ("lateral", "rotation", "shortfall")}
        rows.append(row)
    write_rows(RESULTS / "control_modes_tracking.json", rows)


def measure_borders() -> None:
    """Writes how fast hand and joints get in each mode of small steps, in 26 directions from several resets."""
    cases = [
        (domain, mode, limited)
        for domain in suite.DOMAINS
        for mode in ("ee_delta_position", "ee_delta_pose")
        for limited in ((True, False) if domain in LIMITED_DOMAINS else (False,))
    ]
    rows = [*tqdm(in_processes(borders, cases), total=len(cases), unit="mode", disable=None)]
    write_rows(RESULTS / "control_modes_borders.json", rows)


def borders(case: tuple[str, str, bool]) -> dict[str, Any]:
    """Returns how fast hand and joints get in a domain and a mode, with or without limits of speed."""
    domain, mode, limited = case
    environment = tracking.load(domain, mode)
    directions = [np.subtract(index, 1.0) for index in np.ndindex(3, 3, 3) if index != (1, 1, 1)]
    with contextlib.ExitStack() as stack:
        if not limited:
            stack.enter_context(mock.patch.object(speed_limits, "limited", lambda *args: args[3]))
        drives = [tracking.drive(environment, direction, DRIVE_SECONDS) for direction in directions * RESETS]
    ratios = np.concatenate([each.ratios for each in drives])
    joint_speeds = np.concatenate([each.joint_speeds for each in drives])
    is_free = ~np.concatenate([each.touches for each in drives])
    is_fast = (ratios > FAST_HAND) | (joint_speeds > FAST_JOINT)
    return {
        "domain": domain,
        "control_mode": mode,
        "limited": limited,
        "ratio": ratios.max(),
        "free_ratio": ratios[is_free].max(),
        "joint_speed": joint_speeds.max(),
        "free_joint_speed": joint_speeds[is_free].max(),
        "steps": is_fast.size,
        "fast": int(is_fast.sum()),
    }


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
            seconds = {mode: seconds_of(environments[mode], mode, number) for mode in order}
            for mode in SPEED_MODES if number else ():
                ratios[mode].append(seconds["joint_velocity"] / seconds[mode])
    write_rows(
        RESULTS / "control_modes_speed.json",
        [
            {"control_mode": mode, "median": statistics.median(values), "quartiles": statistics.quantiles(values)[::2]}
            for mode, values in ratios.items()
        ],
    )


def seconds_of(environments: gymnasium.vector.VectorEnv, mode: str, seed: int) -> float:
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
    environment = tracking.load("kitchen", mode)
    if mode == "joint_velocity":
        return np.zeros(environment.action_spec().shape)
    if mode == "joint_position":
        return np.array(environment.physics.bind(environment.task.robot.joints).qpos)
    return tracking.holding_action(environment, mode)


if __name__ == "__main__":
    run_named(__doc__, {"tracking": measure_tracking, "borders": measure_borders, "speed": measure_speed})
