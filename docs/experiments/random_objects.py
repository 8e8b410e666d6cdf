"""Plays random actions in kitchens with objects: nothing diverges, and no object gets into a wall.

python docs/experiments/random_objects.py              100 hours of simulated time
python docs/experiments/random_objects.py --hours=1

It plays episodes of uniform actions in the kitchens of the split `test` in turn, all verbs, in several processes, and
measures the greatest depth of an object in what is not the robot and not another object. Results are written to
results/random_objects.json.
"""

import functools
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from dm_control.rl.control import PhysicsError
from experiment import in_processes, make_parser, write_rows
from tqdm import tqdm

from kitchen_suite import suite

RESULTS = Path(__file__).parent / "results" / "random_objects.json"

KITCHENS = 100
STEPS = 500  # Control steps in an episode.
TIMESTEP = 0.08  # Length of a control step [s].


def play(design: int, episodes: int) -> tuple[int, int, float]:
    """Plays episodes in a kitchen; returns control steps, diverged episodes, and the greatest depth [m]."""
    arguments = {"design": design, "split": "test", "visuals": False, "random": design}
    environment = suite.load("pick_and_place", "any", arguments)
    generator = np.random.default_rng(design)
    data = environment.physics.data
    model = environment.physics.model
    bodies = [model.id2name(body, "body").split("/")[0] for body in model.geom_bodyid]
    own = np.array([name in environment.task.scene.layout.names for name in bodies])
    robot = np.array([name == "franka" for name in bodies])
    steps, diverged, depth = 0, 0, 0.0
    for _ in range(episodes):
        timestep = environment.reset()
        while not timestep.last():
            try:
                timestep = environment.step(generator.uniform(-1.0, 1.0, 9))
            except PhysicsError:
                diverged += 1
                break
            steps += 1
            pairs = data.contact.geom[: data.ncon]
            walls = own[pairs].any(axis=1) & ~own[pairs].all(axis=1) & ~robot[pairs].any(axis=1)
            if walls.any():
                depth = max(depth, float(-data.contact.dist[: data.ncon][walls].min()))
    return steps, diverged, depth


def main(command_line: Sequence[str] | None = None) -> None:
    """Runs the command."""
    parser = make_parser(__doc__)
    parser.add_argument("--hours", type=float, default=100.0, help="simulated time")
    given = parser.parse_args(command_line)
    episodes = max(1, round(given.hours * 3600 / (KITCHENS * STEPS * TIMESTEP)))
    played = in_processes(functools.partial(play, episodes=episodes), range(KITCHENS))
    steps, diverged, depths = zip(*tqdm(played, total=KITCHENS, unit="kitchen", disable=None), strict=True)
    row = {
        "hours": round(sum(steps) * TIMESTEP / 3600, 2),
        "episodes": KITCHENS * episodes,
        "diverged": sum(diverged),
        "depth_mm": round(1e3 * max(depths), 2),
    }
    write_rows(RESULTS, [row])
    print(row)


if __name__ == "__main__":
    main()
