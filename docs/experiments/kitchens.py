"""Measures of generated kitchens; each writes results/kitchens_*.json.

python docs/experiments/kitchens.py speed    vectors of 64 kitchens: 16 designs in one, and one design in each of 16
python docs/experiments/kitchens.py designs  how different 1,000 designs of each split are, and how long they take
python docs/experiments/kitchens.py expert   the expert with fresh noise, on the certified tasks of 200 test kitchens
python docs/experiments/kitchens.py modes    the expert in every control mode, on three certified tasks of 20 test
                                             kitchens; continues after the last mode that is in the file
"""

import collections
import concurrent.futures
import contextlib
import functools
import itertools
import json
import multiprocessing
import statistics
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from tqdm import tqdm, trange

from kitchen_suite import policies, suite
from kitchen_suite.domains.generated_kitchens import KITCHENS
from kitchen_suite.entities import KitchenDesign, build_generated_kitchen
from kitchen_suite.entities.kitchen_designs import SPLITS
from kitchen_suite.evaluation.certification import certify
from kitchen_suite.evaluation.scores import wilson
from kitchen_suite.tasks.generated_kitchens.certificates import certificate_of
from kitchen_suite.tasks.generated_kitchens.slots import Slots
from kitchen_suite.tasks.kitchen.control_modes import CONTROL_MODES
from kitchen_suite.vector_env.base import processors
from kitchen_suite.vector_env.generated_kitchens import GeneratedKitchenVectorEnv

RESULTS = Path(__file__).parent / "results"
FIRST_SEED = 60_000

# Of `speed`: environments, designs, rounds of each number of threads, and control steps of a round.
NUM_ENVS, DESIGNS, ROUNDS, STEPS = 64, 16, 16, 40
THREADS = (1, 2)

# Of `designs`: designs of each split, those that are compiled, and the size of cells of handle positions [m].
COUNT, COMPILED, CELL = 1_000, 200, 0.1

# Of `modes`: test kitchens, without the first five, which the expert was tuned in, and tasks that are drawn in each.
MODE_KITCHENS, MODE_TASKS = range(5, 25), 3

# Of `expert`: test kitchens, and the seed of noise and start, which is 0 in certificates.
KITCHENS_PLAYED, FRESH_SEED = 200, 1


def milliseconds(
    environments: GeneratedKitchenVectorEnv, seed: int, actions: NDArray[np.float64]
) -> tuple[float, float]:
    """Returns the time of a control step of all environments from a reset: of the clock, and of the processors [ms]."""
    environments.reset(seed=seed)
    started, used = time.perf_counter(), time.process_time()
    for action in actions:
        environments.step(action)
    times = time.perf_counter() - started, time.process_time() - used
    return times[0] / len(actions) * 1000, times[1] / len(actions) * 1000


def speed_row(threads: int) -> dict[str, Any]:
    """Returns median times of the vector of several designs and of those of one, which alternate, and their ratios."""
    settings = {**KITCHENS.tasks["any"], "num_threads": threads}
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (STEPS, NUM_ENVS, 9))
    with contextlib.ExitStack() as stack:
        several, *equal = (
            stack.enter_context(contextlib.closing(GeneratedKitchenVectorEnv(NUM_ENVS, design=design, **settings)))
            for design in (range(DESIGNS), *range(DESIGNS))
        )
        rounds = []
        for seed in trange(FIRST_SEED, FIRST_SEED + ROUNDS, desc=f"{threads} threads", disable=None):
            # All designs take turns, in the same order before and after.
            one = equal[seed % DESIGNS]
            pairs = [(milliseconds(several, seed, actions), milliseconds(one, seed, actions)) for _ in range(2)]
            rounds.append(np.mean(pairs, axis=0))
    names = ("clock", "processors")
    columns = {name: [each[:, i].tolist() for each in rounds] for i, name in enumerate(names)}
    return {
        "threads": threads,
        **{f"{name}_several_ms": round(statistics.median(one for one, _ in columns[name]), 2) for name in names},
        **{f"{name}_equal_ms": round(statistics.median(other for _, other in columns[name]), 2) for name in names},
        **{f"{name}_ratio": round(statistics.median(b / a for a, b in columns[name]), 3) for name in names},
    }


def measure_speed() -> None:
    """Writes the speed of a vector of several designs as a share of that of vectors of one, with random actions."""
    write("speed", [speed_row(threads) for threads in THREADS])


def spread(split: str) -> tuple[dict[str, Any], list[NDArray[np.float64]]]:
    """Returns how different the designs of a split are, and positions of handles `(n, 3)` of the first kitchens [m]."""
    designs = [KitchenDesign.drawn(number, split) for number in range(COUNT)]
    for design in tqdm(designs, desc=f"{split}, checks", disable=None):
        KitchenDesign.make(design.to_json(), split)  # Refuses what cannot be built, and handles out of reach.
    kinds = collections.Counter(kind for design in designs for kind in {each.design.kind for each in design.placed})
    seconds, handles = [], []
    for design in tqdm(designs[:COMPILED], desc=split, disable=None):
        started = time.process_time()
        scene = build_generated_kitchen(design, visuals=False)
        physics = mjcf.Physics.from_mjcf_model(scene.arena.mjcf_model)
        seconds.append(time.process_time() - started)
        handles.append(Slots.of(scene, physics).position[: len(scene.parts)])
    row = {
        "split": split,
        "designs": COUNT,
        "sequences": len({design.sequence for design in designs}),
        "least_common_kind": min(kinds.values()) / COUNT,
        "compiled": COMPILED,
        "seconds_median": round(statistics.median(seconds), 3),
        "seconds_greatest": round(max(seconds), 3),
        "cells": len({tuple(cell) for cell in np.floor(np.concatenate(handles) / CELL).astype(int).tolist()}),
    }
    return row, handles


def measure_designs() -> None:
    """Writes sequences, kinds, times and spread of handles of both splits, and how far test kitchens are from others.

    The distance of two kitchens is the mean distance of each handle of one from the nearest of the other.
    """
    (train, known), (test, new) = (spread(split) for split in SPLITS)
    trees = [cKDTree(handles) for handles in known]
    nearest = [min(float(tree.query(handles)[0].mean()) for tree in trees) for handles in new]
    test["nearest_train_median_m"] = round(statistics.median(nearest), 3)
    test["nearest_train_least_m"] = round(min(nearest), 3)
    write("designs", [train, test])


def measure_expert() -> None:
    """Writes how often the expert completes certified tasks of test kitchens again, with another seed, by kind."""
    certificates = [certificate_of(KitchenDesign.drawn(number, "test")) for number in range(KITCHENS_PLAYED)]
    work = functools.partial(certify, split="test", seed=FRESH_SEED)
    with concurrent.futures.ProcessPoolExecutor(processors(), multiprocessing.get_context("spawn")) as pool:
        numbers = [certificate.design for certificate in certificates]
        again = [*tqdm(pool.map(work, numbers), total=len(numbers), disable=None)]
    rows: dict[str, list[bool]] = {}
    for certificate, fresh in zip(certificates, again, strict=True):
        for task in certificate.certified:
            rows.setdefault(task.partition(" ")[0], []).append(fresh.steps[task] is not None)
    pairs = [steps is not None for each in certificates for steps in each.steps.values()]
    done = [success for each in rows.values() for success in each]
    low, high = wilson(sum(done), len(done))
    result = {
        "kitchens": KITCHENS_PLAYED,
        "pairs": len(pairs),
        "certified": round(float(np.mean(pairs)), 4),
        "success": round(float(np.mean(done)), 4),
        "interval": [round(low, 4), round(high, 4)],
        **{
            task: {"pairs": len(each), "success": round(float(np.mean(each)), 4)} for task, each in sorted(rows.items())
        },
    }
    write("expert", [result])


def play_in_mode(number: int, mode: str) -> list[tuple[str, bool]]:
    """Returns the verbs of tasks that are drawn among the certified ones of a test kitchen, and the successes."""
    design = KitchenDesign.drawn(number, "test")
    arguments = {"design": design, "visuals": False, "random": FRESH_SEED, "control_mode": mode}
    environment = suite.load("kitchens", "any", arguments)
    act = policies.find("expert")(environment, np.random.default_rng(FRESH_SEED))
    drawn = np.random.default_rng(number).permutation(certificate_of(design).certified)[:MODE_TASKS]
    played = []
    for name in drawn.tolist():
        environment.random_state.seed(FRESH_SEED)
        environment.task.follow(environment.task.checked_reset({"requested_tasks": [name]}))
        timestep = environment.reset()
        while not timestep.last():
            timestep = environment.step(act(timestep))
        played.append((name.partition(" ")[0], bool(environment.task.episode_metrics["success"])))
    return played


def measure_modes() -> None:
    """Writes how often the expert succeeds in each control mode, on the same tasks, of all and by verb.

    Modes that have a row in the file are left alone.
    """
    path = RESULTS / "kitchens_modes.json"
    results = json.loads(path.read_text(encoding="utf-8")) if path.exists() else []
    measured = {row["mode"] for row in results}
    for mode in (mode for mode in CONTROL_MODES if mode not in measured):
        with concurrent.futures.ProcessPoolExecutor(processors(), multiprocessing.get_context("spawn")) as pool:
            played = pool.map(functools.partial(play_in_mode, mode=mode), MODE_KITCHENS)
            done: dict[str, list[bool]] = {}
            for verb, success in itertools.chain.from_iterable(tqdm(played, desc=mode, total=len(MODE_KITCHENS))):
                done.setdefault(verb, []).append(success)
        every = [success for each in done.values() for success in each]
        verbs = {verb: [sum(each), len(each)] for verb, each in sorted(done.items())}
        results.append({"mode": mode, "episodes": len(every), "successes": sum(every), **verbs})
        write("modes", results)


def write(name: str, rows: list[dict[str, Any]]) -> None:
    """Writes rows to `results/kitchens_<name>.json`, and prints them."""
    text = "[\n" + ",\n".join(map(json.dumps, rows)) + "\n]\n"
    (RESULTS / f"kitchens_{name}.json").write_text(text, encoding="utf-8")
    print(text)


MEASURES = {"speed": measure_speed, "designs": measure_designs, "expert": measure_expert, "modes": measure_modes}

if __name__ == "__main__":
    if len(sys.argv) != 2 or sys.argv[1] not in MEASURES:
        raise SystemExit(__doc__)
    MEASURES[sys.argv[1]]()
