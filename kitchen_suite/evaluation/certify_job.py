"""The work of `kitchen-certify`: kitchens are built, measured, and played in by the scripted expert."""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import collections
import concurrent.futures
import functools
import multiprocessing
from collections.abc import Iterator
from typing import ClassVar

import msgspec
import mujoco
import numpy as np
from tqdm import tqdm

from kitchen_suite import policies, suite
from kitchen_suite.entities.designs import KitchenDesign
from kitchen_suite.episodes.report import print_line, table
from kitchen_suite.policies.experts.generated_kitchens import reached_handles
from kitchen_suite.settings import FAILURE, CertifySettings
from kitchen_suite.tasks.generated_kitchens import certificates
from kitchen_suite.tasks.generated_kitchens.certificates import Certificate
from kitchen_suite.tasks.generated_kitchens.requests import VERBS
from kitchen_suite.tasks.variations.layouts import CLEARANCE_TOLERANCE, Clearance
from kitchen_suite.vector_env.base import processors

# Props that are in each other as in the original kitchen: the oven has the hood in its back, and a kettle on it.
_TOGETHER = ("oven_1", "hood_1", "kettle")


def certify(number: int, split: str, *, seed: int = 0) -> Certificate:
    """Returns the certificate of a design; every task is played once, in an episode with a seed."""
    design = KitchenDesign.drawn(number, split)
    environment = suite.load("kitchens", "any", {"design": design, "visuals": False, "random": seed})
    task, act = environment.task, policies.find("expert")(environment, np.random.default_rng(seed))
    environment.reset()
    model, data = environment.physics.model.ptr, mujoco.MjData(environment.physics.model.ptr)
    mujoco.mj_kinematics(model, data)
    depth = Clearance(task.scene, environment.physics, data).depth(_TOGETHER)
    steps: dict[str, int | None] = {}
    for name in task.requests.tasks:
        environment.random_state.seed(seed)
        task.follow(task.checked_reset({"requested_tasks": [name]}))
        timestep, count = environment.reset(), 0
        while not timestep.last():
            timestep, count = environment.step(act(timestep)), count + 1
        steps[name] = count if task.episode_metrics["success"] else None
    completed = (name.split(" ") for name, count in steps.items() if count)
    opened = {part for verb, part in completed if not VERBS[verb][0]}
    return Certificate(
        design=number,
        digest=certificates.design_digest(design),
        physics=task.scene.physics,
        depth_mm=round(1e3 * depth, 3),
        reached={name: reaches or name in opened for name, reaches in reached_handles(design).items()},
        steps=steps,
    )


class CertifyJob:
    """Certifies kitchens, or checks their certificates."""

    errors: ClassVar = {OSError: FAILURE, ValueError: FAILURE}

    def __init__(self, settings: CertifySettings) -> None:
        """Checks the settings, and what is there of the file."""
        self._settings, self._done = settings, 0
        path = settings.output or certificates.default_path(settings.split)
        if path is None:
            raise ValueError("there is no cache folder: name a file with --output")
        self._path, self._numbers = path, settings.numbers
        self._present = certificates.read(path) if path.exists() else {}
        for number in self._numbers:
            if number in self._present:
                certificates.check_design(self._present[number], KitchenDesign.drawn(number, settings.split), path)

    def progress(self) -> str:
        return f"after {self._done} kitchens"

    def run(self) -> bool:
        """Appends the certificates that are missing, or certifies again; returns whether all are as they should be."""
        if self._settings.check:
            return self._check()
        self._path.parent.mkdir(parents=True, exist_ok=True)
        missing = [number for number in self._numbers if number not in self._present]
        # What follows the last complete line was cut off.
        with self._path.open("ab") as file:
            file.truncate(self._path.read_bytes().rfind(b"\n") + 1)
            for certificate in self._certified(missing):
                file.write(msgspec.json.encode(certificate) + b"\n")
                file.flush()
                self._present[certificate.design] = certificate
        found = [self._present[number] for number in self._numbers]
        print_line(_report(found))
        return all(certificate.depth_mm <= 1e3 * CLEARANCE_TOLERANCE for certificate in found)

    def _check(self) -> bool:
        """Certifies kitchens again, and compares with the file."""
        known = [number for number in self._numbers if number in self._present]
        different = {each.design for each in self._certified(known) if each != self._present[each.design]}
        wrong = [number for number in self._numbers if number in different or number not in self._present]
        for number in wrong:
            problem = "another certificate now" if number in different else "no certificate in the file"
            print_line(f"kitchen {self._settings.split}/{number} has {problem}")
        print_line(f"{len(self._numbers) - len(wrong)} of {len(self._numbers)} certificates hold")
        return not wrong

    def _certified(self, numbers: list[int]) -> Iterator[Certificate]:
        """Yields the certificates of kitchens in the order of their numbers, from several processes."""
        workers = min(self._settings.num_workers or processors(), max(len(numbers), 1))
        work = functools.partial(certify, split=self._settings.split)
        with concurrent.futures.ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
            made = pool.map(work, numbers)
            for certificate in tqdm(made, total=len(numbers), unit="kitchen", disable=None, leave=False):
                self._done += 1
                yield certificate


def _report(found: list[Certificate]) -> str:
    """Returns a table of tasks and how many of them the expert completed, and a line on the kitchens."""
    rows = collections.defaultdict(list)
    for certificate in found:
        for name, steps in certificate.steps.items():
            verb, _, part = name.partition(" ")
            kind = part.rpartition("/")[0].rpartition("_")[0] or part
            rows[f"{verb} {kind}"].append(steps is not None)
    everything = [done for each in rows.values() for done in each]
    cells = [[name, str(len(each)), f"{np.mean(each):.0%}"] for name, each in sorted(rows.items())]
    cells.append(["all", str(len(everything)), f"{np.mean(everything):.1%}"])
    reached = [each for certificate in found for each in certificate.reached.values()]
    line = f"{len(found)} kitchens; handles in reach: {np.mean(reached):.1%}; "
    line += f"greatest depth: {max(certificate.depth_mm for certificate in found):.1f} mm"
    return f"{table(['task', 'pairs', 'certified'], cells)}\n\n{line}"
