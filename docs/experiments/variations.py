"""Measures for the page on variations; each writes its results to results/variations_*.json.

python docs/experiments/variations.py experts [episodes]   successes of the experts under groups of variations
python docs/experiments/variations.py layouts              share of the layouts drawn that is refused
python docs/experiments/variations.py speed [rounds]       speed of 32 vectorised environments, relative to no variation

They use seeds that were not used for tuning. `experts` needs the extra of that name, and 40 minutes of processor time.
`docs/scripts/tables.py` makes the tables.
"""

import contextlib
import functools
import itertools
import statistics
import time

import gymnasium
import numpy as np
from experiment import RESULTS, Case, make_parser, play, play_cases, positive, write_rows
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


if __name__ == "__main__":
    parser = make_parser(__doc__)
    measures = parser.add_subparsers(dest="measure", required=True)
    measures.add_parser("experts").add_argument("episodes", nargs="?", type=positive, default=EPISODES)
    measures.add_parser("layouts")
    measures.add_parser("speed").add_argument("rounds", nargs="?", type=positive, default=ROUNDS)
    given = parser.parse_args()
    match given.measure:
        case "experts":
            measure_experts(given.episodes)
        case "layouts":
            measure_layouts()
        case "speed":
            measure_speed(given.rounds)
