"""`kitchen-benchmark`: how fast the suite steps, against bare MuJoCo, in one interleaved run.

Machines are shared and noisy, so what counts are ratios: in every round each contender makes one episode with the same
actions, and its rate is divided by that of bare MuJoCo in the same round. The table gives the median over the rounds.
"""

import dataclasses
import json
import platform
import statistics
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from importlib import metadata
from types import MappingProxyType

import gymnasium
import mujoco
import numpy as np
from absl import flags
from dm_control import composer
from tqdm import tqdm

from kitchen_suite import suite
from kitchen_suite.entities import assets, build_kitchen
from kitchen_suite.gymnasium_env import FrankaKitchenEnv, FrankaOpenCabinetEnv
from kitchen_suite.tasks import KitchenTask, kitchen, open_cabinet
from kitchen_suite.tasks.drawer_control import JOINT_LOW
from kitchen_suite.tasks.kitchen_start import INITIAL_QPOS
from kitchen_suite.tasks.velocity_control import position_target

BARE = "bare mj_step"
SUITE = "suite.load, without visuals"
ADAPTER = "Gymnasium adapter, without visuals"

# Runs one episode with the given actions, (steps, n).
Contender = Callable[[np.ndarray], None]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Domain:
    """What is compared in a domain.

    Attributes:
      steps: control steps of an episode.
      draw: makes the actions of an episode.
      contenders: makes all that is compared, by name; the first is what the others are measured against.
    """

    steps: int
    draw: Callable[[np.random.Generator, int], np.ndarray]
    contenders: Callable[[], dict[str, Contender]]


def bare_kitchen() -> Contender:
    """Bare physics steps of the original's model, controls computed as the task does."""
    model = mujoco.MjModel.from_xml_path(str(assets.asset_dir() / "kitchen_assets" / "kitchen_env_model.xml"))
    data = mujoco.MjData(model)
    substeps = round(kitchen.CONTROL_TIMESTEP / kitchen.PHYSICS_TIMESTEP)

    def episode(actions: np.ndarray) -> None:
        mujoco.mj_resetData(model, data)
        data.qpos[:] = INITIAL_QPOS
        for action in actions:
            data.ctrl[:] = position_target(data.qpos[:9], action, velocity_scale=2.0, timestep=kitchen.CONTROL_TIMESTEP)
            mujoco.mj_step(model, data, substeps)

    return episode


def bare_cabinet() -> Contender:
    """Bare physics steps of the suite's own model of the cabinet, the arm's servos following the actions."""
    environment = suite.load("open_cabinet", "top_drawer", {"random": 0, "visuals": False})
    environment.reset()
    model, data = environment.physics.model.ptr, mujoco.MjData(environment.physics.model.ptr)
    start = environment.physics.data.qpos.copy()
    substeps = round(open_cabinet.CONTROL_TIMESTEP / open_cabinet.PHYSICS_TIMESTEP)

    def episode(actions: np.ndarray) -> None:
        mujoco.mj_resetData(model, data)
        data.qpos[:] = start
        for action in actions:
            data.ctrl[:7] = data.qpos[:7] + action[:7]
            mujoco.mj_step(model, data, substeps)

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


def kitchen_contenders() -> dict[str, Contender]:
    """Bare MuJoCo on the original's model, and the suite in all its forms."""
    quiet = {"random": 0, "terminate_on_tasks_completed": False, "time_limit": None}
    task = KitchenTask(build_kitchen(), terminate_on_tasks_completed=False)
    stock = composer.Environment(
        task, random_state=0, strip_singleton_obs_buffer_dim=True, recompile_mjcf_every_episode=False
    )
    return {
        BARE: bare_kitchen(),
        SUITE: dm_env_episode(suite.load("kitchen", "all", {**quiet, "visuals": False})),
        ADAPTER: gymnasium_episode(FrankaKitchenEnv(terminate_on_tasks_completed=False)),
        "suite.load, with visuals": dm_env_episode(suite.load("kitchen", "all", quiet)),
        "the same task in stock composer": dm_env_episode(stock),
    }


def cabinet_contenders() -> dict[str, Contender]:
    """Bare MuJoCo on the suite's own model, and the suite."""
    quiet = {"random": 0, "time_limit": None}
    return {
        BARE: bare_cabinet(),
        SUITE: dm_env_episode(suite.load("open_cabinet", "top_drawer", {**quiet, "visuals": False})),
        ADAPTER: gymnasium_episode(FrankaOpenCabinetEnv()),
        "suite.load, with visuals": dm_env_episode(suite.load("open_cabinet", "top_drawer", quiet)),
    }


DOMAINS: Mapping[str, Domain] = MappingProxyType(
    {
        "kitchen": Domain(
            steps=280, draw=lambda rng, steps: rng.uniform(-1.0, 1.0, (steps, 9)), contenders=kitchen_contenders
        ),
        # Offsets so small that the episode does not terminate.
        "open_cabinet": Domain(
            steps=700,
            draw=lambda rng, steps: rng.normal(0.0, 0.01, (steps, JOINT_LOW.size)),
            contenders=cabinet_contenders,
        ),
    }
)


def measure(domain: Domain, *, rounds: int, steps: int) -> dict[str, list[float]]:
    """Control steps per second of each contender in each round; a first round to warm up is not counted."""
    entries = domain.contenders()
    rates: dict[str, list[float]] = {name: [] for name in entries}
    rng = np.random.default_rng(0)
    for number in tqdm(range(rounds + 1), desc="rounds", disable=None):
        actions = domain.draw(rng, steps)
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
_DOMAIN_NAME = flags.DEFINE_enum("domain_name", "kitchen", [*DOMAINS], "what to measure", flag_values=_FLAGS)
_ROUNDS = flags.DEFINE_integer("rounds", 9, "rounds that count", lower_bound=1, flag_values=_FLAGS)
_STEPS = flags.DEFINE_integer(
    "steps", None, "control steps of an episode; by default the domain's", lower_bound=1, flag_values=_FLAGS
)
_JSON = flags.DEFINE_bool("json", False, "print JSON in place of the table", flag_values=_FLAGS)


def main(argv: Sequence[str]) -> int:
    """Measures and prints; returns the exit code, 2 for bad flags."""
    try:
        if extra := _FLAGS(argv)[1:]:
            raise flags.UnrecognizedFlagError(extra[0])
    except flags.Error as error:
        print("kitchen-benchmark:", " ".join(str(error).split()), file=sys.stderr)
        return 2
    domain = DOMAINS[_DOMAIN_NAME.value]
    rates = measure(domain, rounds=_ROUNDS.value, steps=_STEPS.value or domain.steps)
    summary, cost = summarize(rates), adapter_cost(rates)
    results = {"versions": versions(), "results": summary, "adapter_cost": cost}
    print(json.dumps(results) if _JSON.value else report(summary, cost))
    return 0


def console_main() -> int:
    """Entry point of `kitchen-benchmark`."""
    return main(sys.argv)


if __name__ == "__main__":
    sys.exit(console_main())
