"""What `kitchen-benchmark` compares, domain by domain."""

import dataclasses
from collections.abc import Callable, Mapping
from types import MappingProxyType

import gymnasium
import mujoco
import numpy as np
from dm_control import composer

from kitchen_suite import suite
from kitchen_suite.entities import assets, build_kitchen
from kitchen_suite.gymnasium_env import FrankaKitchenEnv, FrankaOpenCabinetEnv
from kitchen_suite.tasks import KitchenTask, drawer_rules, kitchen_rules
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
    substeps = round(kitchen_rules.CONTROL_TIMESTEP / kitchen_rules.PHYSICS_TIMESTEP)

    def episode(actions: np.ndarray) -> None:
        mujoco.mj_resetData(model, data)
        data.qpos[:] = INITIAL_QPOS
        for action in actions:
            data.ctrl[:] = position_target(
                data.qpos[:9], action, velocity_scale=2.0, timestep=kitchen_rules.CONTROL_TIMESTEP
            )
            mujoco.mj_step(model, data, substeps)

    return episode


def bare_cabinet() -> Contender:
    """Bare physics steps of the suite's own model of the cabinet, the arm's servos following the actions."""
    environment = suite.load("open_cabinet", "top_drawer", {"random": 0, "visuals": False})
    environment.reset()
    model, data = environment.physics.model.ptr, mujoco.MjData(environment.physics.model.ptr)
    start = environment.physics.data.qpos.copy()
    substeps = round(drawer_rules.CONTROL_TIMESTEP / drawer_rules.PHYSICS_TIMESTEP)

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
