"""`kitchen-benchmark`: how fast the kitchen steps, against bare MuJoCo on the original's model, in one interleaved run.

Machines are shared and noisy, so what counts are ratios: in every round each contender makes one episode with the same
actions, and its rate is divided by that of bare MuJoCo in the same round. The table gives the median over the rounds.
"""

import json
import platform
import statistics
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from importlib import metadata

import gymnasium
import mujoco
import numpy as np
from absl import flags
from dm_control import composer
from tqdm import tqdm

from kitchen_suite import suite
from kitchen_suite.entities import assets, build_kitchen
from kitchen_suite.gymnasium_env import FrankaKitchenEnv
from kitchen_suite.tasks import KitchenTask
from kitchen_suite.tasks.kitchen import CONTROL_TIMESTEP, PHYSICS_TIMESTEP
from kitchen_suite.tasks.kitchen_start import INITIAL_QPOS
from kitchen_suite.tasks.velocity_control import position_target

BARE = "bare mj_step, reference model"
SUITE = "suite.load, without visuals"
ADAPTER = "Gymnasium adapter, without visuals"
_SUBSTEPS = round(CONTROL_TIMESTEP / PHYSICS_TIMESTEP)

# Runs one episode with the given actions, (steps, 9).
Contender = Callable[[np.ndarray], None]


def bare_reference() -> Contender:
    """40 bare physics steps for each control step of the original's model, controls computed as the task does."""
    model = mujoco.MjModel.from_xml_path(str(assets.asset_dir() / "kitchen_assets" / "kitchen_env_model.xml"))
    data = mujoco.MjData(model)

    def episode(actions: np.ndarray) -> None:
        mujoco.mj_resetData(model, data)
        data.qpos[:] = INITIAL_QPOS
        for action in actions:
            data.ctrl[:] = position_target(data.qpos[:9], action, velocity_scale=2.0, timestep=CONTROL_TIMESTEP)
            mujoco.mj_step(model, data, _SUBSTEPS)

    return episode


def dm_env_episode(environment: composer.Environment) -> Contender:
    """Steps an environment of dm_env's interface."""

    def episode(actions: np.ndarray) -> None:
        environment.reset()
        for action in actions:
            environment.step(action)

    return episode


def gymnasium_episode(environment: gymnasium.Env) -> Contender:
    """Steps an environment of Gymnasium's interface."""

    def episode(actions: np.ndarray) -> None:
        environment.reset(seed=0)
        for action in actions:
            environment.step(action)

    return episode


def contenders() -> dict[str, Contender]:
    """All that is compared, by name; the first is what the others are measured against."""
    quiet = {"random": 0, "terminate_on_tasks_completed": False, "time_limit": None}
    task = KitchenTask(build_kitchen(), terminate_on_tasks_completed=False)
    stock = composer.Environment(
        task, random_state=0, strip_singleton_obs_buffer_dim=True, recompile_mjcf_every_episode=False
    )
    return {
        BARE: bare_reference(),
        SUITE: dm_env_episode(suite.load("kitchen", "all", {**quiet, "visuals": False})),
        ADAPTER: gymnasium_episode(FrankaKitchenEnv(terminate_on_tasks_completed=False)),
        "suite.load, with visuals": dm_env_episode(suite.load("kitchen", "all", quiet)),
        "the same task in stock composer": dm_env_episode(stock),
    }


def measure(entries: Mapping[str, Contender], *, rounds: int, steps: int) -> dict[str, list[float]]:
    """Control steps per second of each contender in each round; a first round to warm up is not counted."""
    rates: dict[str, list[float]] = {name: [] for name in entries}
    rng = np.random.default_rng(0)
    for number in tqdm(range(rounds + 1), desc="rounds", disable=None):
        actions = rng.uniform(-1.0, 1.0, (steps, 9))
        for name, episode in entries.items():
            start = time.perf_counter()
            episode(actions)
            if number:
                rates[name].append(steps / (time.perf_counter() - start))
    return rates


def summarize(rates: Mapping[str, Sequence[float]]) -> dict[str, dict[str, float]]:
    """For each contender: median, least and greatest ratio to the bare reference, and median steps per second."""
    summary = {}
    for name, values in rates.items():
        ratios = [value / bare for value, bare in zip(values, rates[BARE], strict=True)]
        summary[name] = {
            "ratio": statistics.median(ratios),
            "least": min(ratios),
            "greatest": max(ratios),
            "steps_per_second": statistics.median(values),
        }
    return summary


def adapter_cost(rates: Mapping[str, Sequence[float]]) -> float:
    """What the Gymnasium adapter adds to a control step of `suite.load`, as a share; median over the rounds."""
    return statistics.median(plain / adapted - 1 for plain, adapted in zip(rates[SUITE], rates[ADAPTER], strict=True))


def versions() -> dict[str, str]:
    """Versions of what decides the speed."""
    packages = ("mujoco", "dm_control", "numpy", "gymnasium-robotics")
    return {"python": platform.python_version(), **{package: metadata.version(package) for package in packages}}


def report(summary: Mapping[str, Mapping[str, float]], cost: float) -> str:
    """The summary as a table, and what the adapter costs."""
    lines = [f"{'':34}{'ratio':>7}{'least':>8}{'greatest':>10}{'steps/s':>9}"]
    lines += [
        f"{name:34}{row['ratio']:7.2f}{row['least']:8.2f}{row['greatest']:10.2f}{row['steps_per_second']:9.0f}"
        for name, row in summary.items()
    ]
    lines.append(f"The Gymnasium adapter adds {cost:.1%} to a control step.")
    return "\n".join([*lines, ", ".join(f"{name} {version}" for name, version in versions().items())])


_FLAGS = flags.FlagValues()
_ROUNDS = flags.DEFINE_integer("rounds", 9, "rounds that count", lower_bound=1, flag_values=_FLAGS)
_STEPS = flags.DEFINE_integer("steps", 280, "control steps of an episode", lower_bound=1, flag_values=_FLAGS)
_JSON = flags.DEFINE_bool("json", False, "print JSON in place of the table", flag_values=_FLAGS)


def main(argv: Sequence[str]) -> int:
    """Measures and prints; returns the exit code, 2 for bad flags."""
    try:
        if extra := _FLAGS(argv)[1:]:
            raise flags.UnrecognizedFlagError(extra[0])
    except flags.Error as error:
        print("kitchen-benchmark:", " ".join(str(error).split()), file=sys.stderr)
        return 2
    rates = measure(contenders(), rounds=_ROUNDS.value, steps=_STEPS.value)
    summary, cost = summarize(rates), adapter_cost(rates)
    results = {"versions": versions(), "results": summary, "adapter_cost": cost}
    print(json.dumps(results) if _JSON.value else report(summary, cost))
    return 0


def console_main() -> int:
    """Entry point of `kitchen-benchmark`."""
    return main(sys.argv)


if __name__ == "__main__":
    sys.exit(console_main())
