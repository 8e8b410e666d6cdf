"""Measures the expert of the domain `pick_and_place` in generated kitchens.

python docs/experiments/objects.py expert              requests that are certified, in 100 kitchens of the split test
python docs/experiments/objects.py expert --any         any requests
python docs/experiments/objects.py random --hours=100   random actions: how deep objects get into furniture and floor

Results are written to results/objects_*.json. It needs the extra `experts`.
"""

import collections
import functools
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np
from dm_control.rl.control import PhysicsError
from experiment import RESULTS, in_processes, make_parser, read_rows, write_rows
from tqdm import tqdm

from kitchen_suite import policies, suite
from kitchen_suite.entities.kitchen_designs import SPLITS
from kitchen_suite.entities.scenes import FLOOR
from kitchen_suite.tasks.pick_and_place.mdp import PickAndPlaceState
from kitchen_suite.tasks.pick_and_place.task import PickAndPlaceTask

KITCHENS = 100  # Of each split.

# Seed of the noise and the start of each episode, which certificates do not use, and episodes in each kitchen.
SEED, EPISODES = 1000, 2

EXPERT, RANDOM = RESULTS / "objects_expert.json", RESULTS / "objects_random.json"

# Least distance by which the hand, or an object, has moved [m].
MOVED = 0.02

STEPS, TIMESTEP = 500, 0.08  # Control steps in an episode, and their length [s].

RESTING = 0.02  # Speed below which an object rests [m/s].

DEEP = 0.005  # Depth in furniture beyond which a control step is counted [m].


# Causes of failures, by their names in results.
CAUSES = ("no_way", "not_moved", "on_floor", "elsewhere")


def cause(task: PickAndPlaceTask, start: PickAndPlaceState, reach: float) -> str:
    """Returns why an episode that asks for one object failed; `reach` is how far the hand came from its start [m]."""
    (asked,) = np.flatnonzero(start.requested)
    if reach < MOVED:
        return "no_way"
    if task.state.dropped[asked]:
        return "on_floor"
    moved = np.linalg.norm(task.state.centres[asked] - start.centres[asked])
    return "not_moved" if moved < MOVED else "elsewhere"


def play_expert(kitchen: tuple[str, int], certified: bool) -> list[dict[str, Any]]:
    """Plays the expert in a kitchen; returns the verb and the outcome of each episode."""
    split, design = kitchen
    arguments = {"design": design, "split": split, "certified": certified, "visuals": False, "random": SEED + design}
    try:
        environment = suite.load("pick_and_place", "any", arguments)
    except ValueError:  # A kitchen without a certified task.
        return []
    act = policies.find("expert")(environment, np.random.default_rng(SEED + design))
    played = []
    for _ in range(EPISODES):
        timestep = environment.reset()
        task, start = environment.task, environment.task.state
        (name,) = task.requested_tasks
        reach = 0.0
        while not timestep.last():
            timestep = environment.step(act(timestep))
            reach = max(reach, float(np.linalg.norm(task.state.hand[:3] - start.hand[:3])))
        metrics = task.episode_metrics
        failed = "" if metrics["success"] else cause(task, start, reach)
        dropped = bool(metrics["objects_dropped"])
        played.append({"design": design, "verb": name.split(" ")[0], "cause": failed, "dropped": dropped})
    return played


def expert(split: str, certified: bool) -> None:
    """Measures the expert in the kitchens of a split; results of the other requests stay."""
    kitchens = [(split, design) for design in range(KITCHENS)]
    work = functools.partial(play_expert, certified=certified)
    by_verb: dict[str, list[Mapping[str, Any]]] = collections.defaultdict(list)
    for played in tqdm(in_processes(work, kitchens), total=KITCHENS, unit="kitchen", disable=None):
        for episode in played:
            by_verb[episode["verb"]].append(episode)
    others = [row for row in read_rows(EXPERT) if (row["split"], row["certified"]) != (split, certified)]
    rows = [
        {
            **{"certified": certified, "split": split, "verb": verb, "episodes": len(episodes)},
            "completed": sum(not episode["cause"] for episode in episodes),
            **{name: sum(episode["cause"] == name for episode in episodes) for name in CAUSES},
            "dropped": sum(episode["dropped"] for episode in episodes),
        }
        for verb, episodes in sorted(by_verb.items())
    ]
    write_rows(EXPERT, [*others, *rows])


class RandomPlay(NamedTuple):
    """The outcome of some episodes of random actions.

    Attributes:
      steps: control steps.
      diverged: diverged episodes.
      furniture: greatest depth of an object in furniture at the end of a control step [m].
      floor: the same in the floor.
      resting: the same in furniture or floor, of objects that rest and that nothing else touches.
      deep: control steps at the end of which an object is deeper in furniture than `DEEP`.
      lost: objects that lay below the floor at the end of an episode.
    """

    steps: int = 0
    diverged: int = 0
    furniture: float = 0.0
    floor: float = 0.0
    resting: float = 0.0
    deep: int = 0
    lost: int = 0


def play_random(design: int, episodes: int, physics: str) -> RandomPlay:
    """Plays random actions in a kitchen."""
    arguments = {"design": design, "split": "test", "physics": physics, "visuals": False, "random": design}
    environment = suite.load("pick_and_place", "any", arguments)
    generator = np.random.default_rng(design)
    task = environment.task
    model, data = environment.physics.model, environment.physics.data
    names = [model.id2name(body, "body").split("/")[0] for body in model.geom_bodyid]
    places = {name: place for place, name in enumerate(task.scene.layout.names)}
    # Of each geom, its object's place in the layout; -1 for those of no object.
    owners = np.array([places.get(name, -1) for name in names])
    robot = np.array([name == "franka" for name in names])
    planes = model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
    played = RandomPlay()
    for _ in range(episodes):
        timestep = environment.reset()
        while not timestep.last():
            try:
                timestep = environment.step(generator.uniform(-1.0, 1.0, 9))
            except PhysicsError:
                played = played._replace(diverged=played.diverged + 1)
                break
            pairs, depths = data.contact.geom[: data.ncon], -data.contact.dist[: data.ncon]
            own = owners[pairs].max(axis=1)
            # Of an object with what is neither the robot nor another object.
            is_fixed = (own >= 0) & (owners[pairs].min(axis=1) < 0) & ~robot[pairs].any(axis=1)
            is_floor = is_fixed & planes[pairs].any(axis=1)
            moved = {*owners[pairs[~is_fixed]].ravel().tolist()}
            resting = [bool(speed < RESTING and number not in moved) for number, speed in enumerate(task.state.speeds)]
            is_resting = is_fixed & np.array([*resting, False])[own]
            furniture = float(depths[is_fixed & ~is_floor].max(initial=0.0))
            played = played._replace(
                steps=played.steps + 1,
                furniture=max(played.furniture, furniture),
                deep=played.deep + int(furniture > DEEP),
                floor=max(played.floor, depths[is_floor].max(initial=0.0)),
                resting=max(played.resting, depths[is_resting].max(initial=0.0)),
            )
        below = (task.state.centres[:, 2] < FLOOR) & task.state.items.present
        played = played._replace(lost=played.lost + int(below.sum()))
    return played


def random(hours: float, physics: str) -> None:
    """Measures what random actions do; the results of the other physics stay."""
    episodes = max(1, round(hours * 3600 / (KITCHENS * STEPS * TIMESTEP)))
    work = functools.partial(play_random, episodes=episodes, physics=physics)
    results = [*tqdm(in_processes(work, range(KITCHENS)), total=KITCHENS, unit="kitchen", disable=None)]
    row = {
        "physics": physics,
        "hours": round(sum(each.steps for each in results) * TIMESTEP / 3600, 2),
        "episodes": KITCHENS * episodes,
        "diverged": sum(each.diverged for each in results),
        "lost": sum(each.lost for each in results),
        "furniture_mm": round(1e3 * max(each.furniture for each in results), 2),
        "floor_mm": round(1e3 * max(each.floor for each in results), 2),
        "resting_mm": round(1e3 * max(each.resting for each in results), 2),
        "deep_steps": sum(each.deep for each in results),
    }
    others = [row for row in read_rows(RANDOM) if row["physics"] != physics]
    write_rows(RANDOM, [*others, row])


def main(command_line: Sequence[str] | None = None) -> None:
    """Runs the command."""
    parser = make_parser(__doc__)
    parser.add_argument("what", choices=("expert", "random"))
    parser.add_argument("--split", choices=SPLITS, default="test", help="of the expert's kitchens")
    parser.add_argument("--any", action="store_true", help="any requests of the expert, certified or not")
    parser.add_argument("--hours", type=float, default=100.0, help="simulated time of random actions")
    parser.add_argument("--physics", choices=("fast", "exact"), default="fast", help="of random actions")
    given = parser.parse_args(command_line)
    if given.what == "expert":
        expert(given.split, not given.any)
    else:
        random(given.hours, given.physics)


if __name__ == "__main__":
    main()
