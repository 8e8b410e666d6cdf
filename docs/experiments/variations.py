"""Measures for the page on variations; each writes its results to results/variations_*.json.

python docs/experiments/variations.py experts [episodes]   successes of the experts under groups of variations
python docs/experiments/variations.py layouts              share of the layouts drawn that is refused
python docs/experiments/variations.py speed [rounds]       speed of 32 vectorised environments, relative to no variation
python docs/experiments/variations.py soak                 200,000 control steps under all groups: NaN and warnings
python docs/experiments/variations.py starts               how deep objects stand in others in 2,000 starts

They use seeds that were not used for tuning. `experts` needs the extra of that name, and 40 minutes of processor time.
`docs/scripts/tables.py` makes the tables.
"""

import contextlib
import functools
import itertools
import statistics
import time
from typing import Any

import gymnasium
import mujoco
import numpy as np
from dm_control import mjcf
from experiment import RESULTS, Case, make_parser, play, play_cases, positive, write_rows
from numpy.typing import NDArray
from tqdm import tqdm

from kitchen_suite import suite
from kitchen_suite.environment import Environment
from kitchen_suite.evaluation.protocols import SHIFT_GROUPS
from kitchen_suite.tasks.variations.distributions import SPLITS

TASKS = (("kitchen", "complete"), ("open_cabinet", "top_drawer"), ("open_cabinet", "bottom_drawer"))
GROUP_SETS = ("start", "dynamics", "sensing", "start,dynamics,sensing", "layout", ",".join(SHIFT_GROUPS))
# Extra observables that show the expert what layouts move.
POSES = (
    "franka/base_pose",
    *(f"{prop}/pose" for prop in ("microwave", "slide_cabinet", "hinge_cabinet", "hood", "oven")),
)
OBSERVED = {"kitchen": {"extra_observables": POSES}, "open_cabinet": {}}

FIRST_SEED = 40_000
EPISODES = 200

LAYOUT_DRAWS = 1_000
# Of `speed`: environments, and rounds that count.
NUM_ENVS = 32
ROUNDS = 11
# Control steps of an episode, and amplitude of random actions with which few episodes end earlier.
EPISODES_PLAYED = {"kitchen": (280, 0.2), "open_cabinet": (700, 0.02)}
SOAK_STEPS = 200_000
SOAK_ENVS = 100
STARTS = 2_000


@functools.lru_cache(maxsize=1)
def load(domain: str, task: str, groups: str, split: str) -> Environment:
    """Returns an environment; consecutive episodes of a case share it."""
    options = {"visuals": False, "variations": groups, "variation_split": split}
    return suite.load(domain, task, {**options, **(OBSERVED[domain] if "layout" in groups else {})})


def play_episode(episode: Case) -> tuple[bool, int]:
    """Plays an episode; returns whether it was a success, and the number of layouts refused before it."""
    *case, seed = episode
    environment = load(*case)
    success, _ = play(environment, "expert", seed)
    return success, int(environment.task.variations.info.get("layout_refusals", 0))


def measure_experts(count: int) -> None:
    """Plays episodes of every task under every set of groups, in as many processes as there are CPUs."""
    cases = [(*task, groups, split) for task in TASKS for groups in GROUP_SETS for split in SPLITS]
    played = play_cases(play_episode, dict.fromkeys(cases, count), FIRST_SEED)
    rows = []
    for (domain, task, groups, split), results in played.items():
        row = {"domain": domain, "task": task, "groups": groups, "split": split, "episodes": count}
        successes, refused = zip(*results, strict=True)
        rows.append({**row, "success": sum(successes), "refused_layouts": sum(refused)})
    write_rows(RESULTS / "variations_experts.json", rows)


def measure_layouts() -> None:
    """Counts the refused layouts among the first ones drawn for each episode."""
    rows = []
    for (domain, task), split in itertools.product((*TASKS[:2], ("kitchen", "all")), SPLITS):
        environment = load(domain, task, "layout", split)
        environment.random_state.seed(FIRST_SEED)
        refused = 0
        for _ in tqdm(range(LAYOUT_DRAWS), desc=f"{domain} {split}", disable=None):
            environment.reset()
            refused += int(environment.task.variations.info["layout_refusals"]) > 0
        rows.append({"domain": domain, "task": task, "split": split, "draws": LAYOUT_DRAWS, "refused": refused})
    write_rows(RESULTS / "variations_layouts.json", rows)


def measure_speed(rounds: int) -> None:
    """Plays episodes with and without all variations, in alternating rounds, and writes the ratio of their speeds."""
    rows = []
    for domain, (steps, amplitude) in EPISODES_PLAYED.items():
        with contextlib.ExitStack() as stack:
            made = []
            for options in ({}, {"variations": list(SHIFT_GROUPS)}):
                one = gymnasium.make_vec(suite.DOMAINS[domain].env_id, NUM_ENVS, num_threads=1, **options)
                made.append(stack.enter_context(contextlib.closing(one)))
            ratios = []
            # The first round warms up.
            for number in tqdm(range(rounds + 1), desc=domain, unit="round", disable=None):
                order = made if number % 2 else made[::-1]
                seconds = {id(each): run(each, number, steps, amplitude) for each in order}
                ratios += [seconds[id(made[0])] / seconds[id(made[1])]] if number else []
        row = {"domain": domain, "groups": ",".join(SHIFT_GROUPS), "median": statistics.median(ratios)}
        rows.append({**row, "quartiles": statistics.quantiles(ratios)[::2]})
    write_rows(RESULTS / "variations_speed.json", rows)


def run(environments: gymnasium.vector.VectorEnv, seed: int, steps: int, amplitude: float) -> float:
    """Plays one episode in each environment, resets included; returns the time [s]."""
    generator = np.random.default_rng(seed)
    actions = generator.uniform(-amplitude, amplitude, (steps, *environments.action_space.shape)).astype(np.float32)
    started = time.perf_counter()
    environments.reset(seed=seed)
    for action in actions:
        environments.step(action)
    return time.perf_counter() - started


def measure_soak() -> None:
    """Steps random actions under all groups, and counts numbers that are not finite, warnings and refused layouts."""
    rows = []
    for (domain, task), split in itertools.product((("kitchen", "all"), ("open_cabinet", "top_drawer")), SPLITS):
        options = {**suite.task_arguments(domain, task), "variations": list(SHIFT_GROUPS), "variation_split": split}
        environments = gymnasium.make_vec(suite.DOMAINS[domain].env_id, SOAK_ENVS, max_episode_steps=100, **options)
        generator = np.random.default_rng(FIRST_SEED)
        environments.reset(seed=FIRST_SEED)
        bad = diverged = episodes = 0
        for _ in tqdm(range(SOAK_STEPS // SOAK_ENVS // 2), desc=f"{domain} {split}", disable=None):
            actions = generator.uniform(-1, 1, environments.action_space.shape).astype(np.float32)
            observations, rewards, terminations, truncations, infos = environments.step(actions)
            bad += sum(not np.isfinite(part).all() for part in [*flat(observations), rewards])
            diverged += int(infos.get("physics_error", np.zeros(1)).sum())
            episodes += int((terminations | truncations).sum())
        row = {"domain": domain, "split": split, "steps": SOAK_STEPS // 2, "episodes": episodes}
        rows.append({**row, "not_finite": bad, "diverged": diverged})
    write_rows(RESULTS / "variations_soak.json", rows)


def flat(observations: Any) -> list[NDArray]:
    """Returns the arrays of nested dicts."""
    if not isinstance(observations, dict):
        return [observations]
    return [array for part in observations.values() for array in flat(part)]


def measure_starts() -> None:
    """Measures how much deeper objects stand in each other at the start than in the default layout [m]."""
    rows = []
    for split in SPLITS:
        environment = suite.load(
            "kitchen", "all", {"visuals": False, "variations": SHIFT_GROUPS, "variation_split": split}
        )
        environment.random_state.seed(FIRST_SEED)
        environment.reset()
        task = environment.task
        task.follow(task.checked_reset({"variation": []}))
        environment.reset()
        pairs = pairs_of(environment)
        built = depths(environment, pairs)
        excess = []
        for _ in tqdm(range(STARTS // len(SPLITS)), desc=split, disable=None):
            environment.reset()
            excess.append(float((depths(environment, pairs) - built).max()))
        rows.append(
            {"split": split, "starts": len(excess), "deepest": max(excess), "median": statistics.median(excess)}
        )
    write_rows(RESULTS / "variations_starts.json", rows)


def pairs_of(environment: Environment) -> NDArray[np.int64]:
    """Returns the pairs `(n, 2)` of colliding geoms of different entities; no planes."""
    physics, scene = environment.physics, environment.task.scene
    owners = np.zeros(physics.model.nbody, int)
    frames = [mjcf.get_attachment_frame(entity.mjcf_model) for entity in (scene.robot, *scene.props.values())]
    numbers = {int(physics.bind(frame).element_id): number for number, frame in enumerate(frames, 1)}
    for body, parent in enumerate(physics.model.body_parentid):
        owners[body] = numbers.get(body, owners[parent])
    model = physics.model.ptr
    collides = (model.geom_contype | model.geom_conaffinity) != 0
    geoms = np.flatnonzero(collides & (model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE))
    first, second = (geoms[side] for side in np.triu_indices(geoms.size, 1))
    apart = owners[model.geom_bodyid[first]] != owners[model.geom_bodyid[second]]
    return np.stack([first[apart], second[apart]], axis=1)


def depths(environment: Environment, pairs: NDArray[np.int64]) -> NDArray[np.float64]:
    """Returns the depth of the geoms of each pair in each other, 0 where they are apart [m]."""
    model, data = environment.physics.model.ptr, environment.physics.data.ptr
    distances = [mujoco.mj_geomDistance(model, data, first, second, 0.001, None) for first, second in pairs.tolist()]
    return np.maximum(-np.array(distances), 0.0)


if __name__ == "__main__":
    parser = make_parser(__doc__)
    measures = parser.add_subparsers(dest="measure", required=True)
    measures.add_parser("experts").add_argument("episodes", nargs="?", type=positive, default=EPISODES)
    measures.add_parser("layouts")
    measures.add_parser("speed").add_argument("rounds", nargs="?", type=positive, default=ROUNDS)
    measures.add_parser("soak")
    measures.add_parser("starts")
    given = parser.parse_args()
    match given.measure:
        case "experts":
            measure_experts(given.episodes)
        case "layouts":
            measure_layouts()
        case "speed":
            measure_speed(given.rounds)
        case "soak":
            measure_soak()
        case "starts":
            measure_starts()
