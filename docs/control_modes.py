"""Measures and pictures for the page on control modes.

python docs/control_modes.py tracking   how still the end effector stands, and how straight it moves, in every domain
python docs/control_modes.py speed      control steps per second of 32 vectorised kitchens, relative to joint_velocity
python docs/control_modes.py pictures   a plot of the lines, and a picture of the frames, in docs/pictures/

The first two write their results to docs/benchmarks/; `docs/build.py tables` makes tables of them.
"""

import contextlib
import functools
import json
import statistics
import sys
import time
from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
from dm_control.mujoco import wrapper
from dm_control.mujoco.engine import MovableCamera
from numpy.typing import NDArray
from PIL import Image
from scripts import tracking
from tqdm import tqdm

from kitchen_suite import suite
from kitchen_suite.environment import Environment
from kitchen_suite.gymnasium_env import KITCHEN_ID
from kitchen_suite.tasks import rotations

DOCS = Path(__file__).parent
RESULTS, PICTURES = DOCS / "benchmarks", DOCS / "pictures"
NUM_ENVS, ROUNDS, STEPS = 32, 15, 20
SPEED_MODES = ("joint_velocity", "joint_position", *tracking.HOLDING_MODES)
AXES = "xyz"
# Red, green and blue for x, y and z.
COLOURS = ((0.9, 0.1, 0.1, 1.0), (0.1, 0.7, 0.1, 1.0), (0.1, 0.2, 0.9, 1.0))


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
    """Writes results to docs/benchmarks/, and prints them."""
    (RESULTS / f"{name}.json").write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(rows, indent=1))


def write_pictures() -> None:
    """Writes the plot of the lines, and the picture of the frames."""
    draw_lines()
    render_frames()


def draw_lines() -> None:
    """Plots the end effector's way along the axes of the base, and its distance from the line."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, panels = pyplot.subplots(2, 2, figsize=(9.6, 5.4), sharex="col", constrained_layout=True)
    for column, domain in zip(panels.T, ("kitchen", "open_cabinet"), strict=True):
        timestep = load(domain, "ee_delta_pose").control_timestep()
        for axis, colour in enumerate(COLOURS):
            line = tracking.follow_line(load(domain, "ee_delta_pose"), "ee_delta_pose", axis, 1)
            seconds = timestep * np.arange(1, len(line.angles) + 1)
            column[0].plot(seconds, 1e3 * line.offsets[:, 0], color=colour, label=f"{AXES[axis]} axis")
            column[1].plot(seconds, 1e3 * np.linalg.norm(line.offsets[:, 1:], axis=1), color=colour)
        column[0].plot(seconds, 1e3 * line.commanded, "k:", label="commanded")
        column[0].set_title(f"{domain}, ee_delta_pose")
        column[1].set_xlabel("time [s]")
    panels[0, 0].set_ylabel("along the line [mm]")
    panels[1, 0].set_ylabel("across the line [mm]")
    panels[0, 0].legend()
    for panel in panels.flat:
        panel.grid(alpha=0.3)
    figure.savefig(PICTURES / "control_modes_tracking.png", dpi=100)


def render_frames() -> None:
    """Renders the robot, transparent, with the axes of the frames `base` and `hand`."""
    sheet, see_through = [], wrapper.MjvOption()
    see_through.flags[mujoco.mjtVisFlag.mjVIS_TRANSPARENT] = True
    for domain, view in (("kitchen", (1.7, 60.0, -35.0)), ("open_cabinet", (1.7, 130.0, -20.0))):
        task = suite.DOMAINS[domain].default_task
        environment = suite.load(domain, task, {"random": 0, "control_mode": "ee_delta_pose"})
        environment.reset()
        hand, base = tracking.end_effector_pose(environment), tracking.base_pose(environment)

        def draw(physics: Any, scene: Any, shown: Any = (base, hand)) -> None:
            del physics
            for position, orientation in shown:
                for axis in range(3):
                    add_arrow(scene, position, position + rotations.rotated(orientation, 0.35 * np.eye(3)[axis]), axis)

        camera = MovableCamera(environment.physics, 480, 480, max_geom=2000, scene_callback=draw)
        camera.set_pose((hand[0] + base[0]) / 2.0, *view)
        sheet.append(camera.render(scene_option=see_through))
    Image.fromarray(np.hstack(sheet)).save(PICTURES / "control_modes_frames.png", optimize=True)


def add_arrow(scene: Any, start: Any, end: Any, axis: int) -> None:
    """Adds an arrow of the axis' colour to a scene."""
    scene.ngeom += 1
    geom = scene.geoms[scene.ngeom - 1]
    colour = np.array(COLOURS[axis], np.float32)
    mujoco.mjv_initGeom(geom, mujoco.mjtGeom.mjGEOM_ARROW, np.zeros(3), np.zeros(3), np.eye(3).ravel(), colour)
    mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_ARROW, 0.012, start, end)


if __name__ == "__main__":
    commands = {"tracking": measure_tracking, "speed": measure_speed, "pictures": write_pictures}
    if len(sys.argv) != 2 or sys.argv[1] not in commands:
        sys.exit(__doc__)
    commands[sys.argv[1]]()
