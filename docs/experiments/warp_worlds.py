"""MuJoCo Warp in the kitchen's fast physics: its throughput, and how far it agrees with MuJoCo's C library.

`python docs/experiments/scaling.py --warp` measures it, after `pip install mujoco-warp==3.17.0`. The model is the one
that `kitchen-export --task_name=complete --physics=fast` writes.
"""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import contextlib
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import mujoco
import numpy as np
from experiment import timesteps
from numpy.typing import NDArray
from tqdm import tqdm

from kitchen_suite import policies, suite
from kitchen_suite.adapters.mjcf import BINARY_FILE, export
from kitchen_suite.environment import Environment
from kitchen_suite.episodes.spec import EnvironmentSpec
from kitchen_suite.physics_names import FAST

TASK = "complete"
SEED = 0

WORLDS = (256, 1024, 4096, 8192)
STATES = 100  # States of the expert's episode from which a control step is compared.
SECONDS = 10.0  # Time that each number of worlds is stepped [s].

# Room for contacts and constraints in a world, relative to the most that the expert's episode has.
_ROOM = 2

Array = NDArray[np.float64]


class Start(NamedTuple):
    """States of the physics; the arrays have a leading axis `(n,)`.

    Attributes:
      qpos: generalised positions.
      qvel: generalised velocities.
      warmstart: accelerations from which the solver starts.
    """

    qpos: Array
    qvel: Array
    warmstart: Array

    def at(self, indices: Sequence[int] | NDArray[np.int64]) -> "Start":
        """Returns the states of some indices."""
        return Start(*(array[indices] for array in self))


class Demonstration(NamedTuple):
    """The expert's episode.

    Attributes:
      states: `(T + 1,)`, before each control step and after the last.
      controls: `(T, nu)`, of each control step.
      environment: in which it was played.
      contacts: greatest number of contacts.
      constraints: greatest number of constraints.
    """

    states: Start
    controls: Array
    environment: Environment
    contacts: int
    constraints: int

    @property
    def substeps(self) -> int:
        """Physics steps in a control step."""
        return self.environment.task.physics_steps_per_control_step


class Worlds(Protocol):
    """Simulations that are stepped together."""

    def set(self, states: Start) -> None:
        """Sets the state of each world; everything is awake."""

    def step(self, controls: Array) -> None:
        """Makes a control step with controls `(n, nu)`."""

    def qpos(self) -> Array:
        """Returns the generalised positions `(n, nq)`."""


class WarpWorlds:
    """Worlds of MuJoCo Warp.

    Attributes:
      compile_seconds: duration of the first control step, which compiles Warp's kernels, and of the graph's capture.
    """

    def __init__(self, model: mujoco.MjModel, demonstration: Demonstration, count: int, device: str) -> None:
        """Makes `count` worlds on a device of Warp, `cuda` or `cpu`, with the first state of an expert's episode."""
        import mujoco_warp
        import warp

        self._api = mujoco_warp
        self._warp = warp
        self._device = warp.get_device(device)
        self._substeps = demonstration.substeps
        data = mujoco.MjData(model)
        data.qpos[:] = demonstration.states.qpos[0]
        room = {"nconmax": _ROOM * demonstration.contacts, "njmax": _ROOM * demonstration.constraints}
        with warp.ScopedDevice(self._device):
            self._model = mujoco_warp.put_model(model)
            self._data = mujoco_warp.put_data(model, data, nworld=count, **room)
        self._run: Callable[[], object] = self._make_substeps
        started = time.perf_counter()
        self.step(np.repeat(demonstration.controls[:1], count, axis=0))
        if self._device.is_cuda:
            with warp.ScopedDevice(self._device), warp.ScopedCapture() as capture:
                self._make_substeps()
            self._run = lambda: warp.capture_launch(capture.graph)
        self.synchronize()
        self.compile_seconds = time.perf_counter() - started

    def _make_substeps(self) -> None:
        for _ in range(self._substeps):
            self._api.step(self._model, self._data)

    def set(self, states: Start) -> None:
        with self._warp.ScopedDevice(self._device):
            self._api.reset_data(self._model, self._data)
            self._data.qpos.assign(states.qpos.astype(np.float32))
            self._data.qvel.assign(states.qvel.astype(np.float32))
            self._data.qacc_warmstart.assign(states.warmstart.astype(np.float32))

    def load(self, controls: Array) -> Any:
        """Returns controls `(n, nu)` on the device."""
        return self._warp.array(controls.astype(np.float32), dtype=float, device=self._device)

    def step(self, controls: Array) -> None:
        self.step_loaded(self.load(controls))

    def step_loaded(self, controls: Any) -> None:
        """Makes a control step with controls that `load` returned; on a GPU it is only begun."""
        with self._warp.ScopedDevice(self._device):
            self._warp.copy(self._data.ctrl, controls)
            self._run()

    def synchronize(self) -> None:
        """Waits for the steps that have been begun."""
        self._warp.synchronize_device(self._device)

    def qpos(self) -> Array:
        positions: Array = self._data.qpos.numpy().astype(np.float64)
        return positions


def record() -> Demonstration:
    """Plays the expert in fast physics."""
    environment = suite.load("kitchen", TASK, {"visuals": False, "physics": FAST, "random": SEED})
    act = policies.find("expert")(environment, np.random.default_rng(SEED))
    states, controls = [], []
    contacts, constraints = 0, 0
    for timestep in timesteps(environment, act):
        data = environment.physics.data.ptr
        states.append((data.qpos.copy(), data.qvel.copy(), data.qacc_warmstart.copy()))
        contacts = max(contacts, data.ncon)
        constraints = max(constraints, data.nefc)
        if not timestep.first():
            controls.append(data.ctrl.copy())
    return Demonstration(
        states=Start(*map(np.array, zip(*states, strict=True))),
        controls=np.array(controls),
        environment=environment,
        contacts=contacts,
        constraints=constraints,
    )


def exported_model() -> mujoco.MjModel:
    """Returns the model of the exported scene."""
    with tempfile.TemporaryDirectory() as folder:
        export(Path(folder), EnvironmentSpec.make("kitchen", TASK, {"physics": FAST}), seed=SEED)
        return mujoco.MjModel.from_binary_path(str(Path(folder, BINARY_FILE)))


def step_in_c(model: mujoco.MjModel, demonstration: Demonstration, i: int) -> Array:
    """Returns the positions `(nq,)` after control step `i` of the episode, made by MuJoCo's C library."""
    data = mujoco.MjData(model)
    states = demonstration.states
    data.qpos[:] = states.qpos[i]
    data.qvel[:] = states.qvel[i]
    data.qacc_warmstart[:] = states.warmstart[i]
    data.ctrl[:] = demonstration.controls[i]
    mujoco.mj_step(model, data, demonstration.substeps)
    return np.array(data.qpos)


def agreement(
    model: mujoco.MjModel, demonstration: Demonstration, worlds: Worlds, count: int, number: int
) -> dict[str, dict[str, float]]:
    """Measures how far `count` worlds differ from C after one control step, from `number` states of the episode."""
    chosen = np.linspace(0, len(demonstration.controls) - 1, number).round().astype(int)
    differences = []
    for first in tqdm(range(0, number, count), desc="agreement", disable=None):
        # The last states are repeated where worlds are left.
        indices = np.resize(chosen[first : first + count], count)
        worlds.set(demonstration.states.at(indices))
        worlds.step(demonstration.controls[indices])
        expected = [step_in_c(model, demonstration, i) for i in indices.tolist()]
        differences += [*np.abs(worlds.qpos() - expected)][: number - first]
    joints = demonstration.environment.task.mdp.sensors.indices.robot_qpos
    each = np.array(differences)
    robot = each[:, joints].max(axis=-1)
    objects = np.delete(each, np.r_[joints], axis=-1).max(axis=-1)
    return {
        "robot's joints [rad, m]": {"median": float(np.median(robot)), "greatest": float(robot.max())},
        "objects [rad, m, quaternion]": {"median": float(np.median(objects)), "greatest": float(objects.max())},
    }


def open_loop(demonstration: Demonstration, worlds: Worlds, count: int) -> dict[str, Any]:
    """Plays the expert's controls in `count` worlds; returns which tasks they complete, and where the kettle ends."""
    mdp = demonstration.environment.task.mdp
    columns = mdp.sensors.indices.goal_qpos
    worlds.set(demonstration.states.at([0] * count))
    completed = np.zeros((count, len(mdp.goals.tasks)), bool)
    for controls in tqdm(demonstration.controls, desc="open loop", disable=None):
        worlds.step(np.repeat(controls[np.newaxis], count, axis=0))
        completed |= mdp.success.within(worlds.qpos()[:, columns])
    physics, kettle = demonstration.environment.physics, demonstration.environment.task.scene.props["kettle"]
    start = int(np.ravel(physics.bind(kettle.joints[0]).qposadr)[0])
    place = slice(start, start + 3)
    distances = np.linalg.norm(worlds.qpos()[:, place] - demonstration.states.qpos[-1, place], axis=-1)
    return {
        "worlds": count,
        "control_steps": len(demonstration.controls),
        "completed": dict(zip(mdp.goals.tasks, completed.sum(axis=0).tolist(), strict=True)),
        "kettle_distance": float(distances.max()),
    }


def throughput(demonstration: Demonstration, worlds: WarpWorlds, count: int, seconds: float) -> float:
    """Measures control steps per second over `count` worlds, which begin all along the expert's episode."""
    length = len(demonstration.controls)
    starts = np.arange(count) % length
    loaded = [worlds.load(demonstration.controls[(starts + step) % length]) for step in range(length)]
    worlds.set(demonstration.states.at(starts))
    worlds.synchronize()
    made = 0
    started = time.perf_counter()
    while (elapsed := time.perf_counter() - started) < seconds:
        for controls in loaded[made % length :][:10]:
            worlds.step_loaded(controls)
            made += 1
        worlds.synchronize()
    return made * count / elapsed


def measure(device: str, numbers: Sequence[int], *, states: int = STATES, seconds: float = SECONDS) -> dict[str, Any]:
    """Measures agreement and tasks with the least number of worlds, and the throughput with each."""
    import warp

    demonstration = record()
    model = exported_model()
    rows = []
    parts: dict[str, Any] = {}
    with contextlib.closing(demonstration.environment):
        for count in sorted(numbers):
            worlds = WarpWorlds(model, demonstration, count, device)
            if not parts:
                parts["agreement"] = agreement(model, demonstration, worlds, count, states)
                parts["open_loop"] = open_loop(demonstration, worlds, count)
            rate = throughput(demonstration, worlds, count, seconds)
            rows.append({"worlds": count, "steps_per_second": rate, "compile_seconds": worlds.compile_seconds})
    return {"results": rows, **parts, "device": str(warp.get_device(device).name)}
