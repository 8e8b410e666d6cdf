"""Certification of generated kitchens: each is built, measured, and played in by the scripted expert.

numbers = range(200, 210)
write_certificates("mine.jsonl", numbers, "train")
assert not check_certificates("mine.jsonl", numbers, "train")
"""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import concurrent.futures
import functools
import multiprocessing
import signal
from collections.abc import Callable, Iterator, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import dm_env
import msgspec
import mujoco
import numpy as np
from tqdm import tqdm

from kitchen_suite import checks, policies, suite
from kitchen_suite.entities.kitchen_designs import SPLITS, KitchenDesign
from kitchen_suite.environment import Environment
from kitchen_suite.policies.experts.generated_kitchens import reached_handles
from kitchen_suite.tasks.generated_kitchens import certificates
from kitchen_suite.tasks.generated_kitchens.certificates import Certificate
from kitchen_suite.tasks.generated_kitchens.requests import VERBS
from kitchen_suite.tasks.variations.layouts import Clearance

# Props that are in each other as in the original kitchen: the oven has the hood in its back, and a kettle on it.
_TOGETHER = ("oven_1", "hood_1", "kettle")


def certify(number: int, split: str, *, seed: int = 0) -> Certificate:
    """Returns the certificate of a kitchen; every task is played once, in an episode with a seed.

    Args:
      number: of the kitchen in its split.
      split: `train` or `test`.
      seed: of the noise and of the start of each episode. Certificates in files are of seed 0.
    """
    design = KitchenDesign.drawn(number, split)
    environment = suite.load("kitchens", "any", {"design": design, "visuals": False, "random": seed})
    task, act = environment.task, policies.find("expert")(environment, np.random.default_rng(seed))
    environment.reset()
    model, data = environment.physics.model.ptr, mujoco.MjData(environment.physics.model.ptr)
    mujoco.mj_kinematics(model, data)
    depth = Clearance(task.scene, environment.physics, data).depth(_TOGETHER)
    steps: dict[str, int | None] = {}
    for name in task.requests.tasks:
        steps[name] = played(environment, act, name, seed)
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


def played(environment: Environment, act: Callable[[dm_env.TimeStep], Any], name: str, seed: int) -> int | None:
    """Returns the control steps in which a policy completes a task in an episode with a seed; None if it does not."""
    task = environment.task
    environment.random_state.seed(seed)
    task.follow(task.checked_reset({"requested_tasks": [name]}))
    timestep, count = environment.reset(), 0
    while not timestep.last():
        timestep, count = environment.step(act(timestep)), count + 1
    return count if task.episode_metrics["success"] else None


class CertificateKind(NamedTuple):
    """A kind of certificates.

    Attributes:
      record: class of a certificate.
      certify: returns the certificate of a kitchen by its number and split.
    """

    record: type[Any]
    certify: Callable[[int, str], Any]


def write_certificates(
    path: str | PathLike[str],
    numbers: Sequence[int],
    split: str,
    *,
    num_workers: int = 1,
    kind: CertificateKind | None = None,
) -> dict[int, Any]:
    """Appends the certificates that a file lacks; returns those of all the kitchens, by number.

    Each is written as a whole line as soon as its kitchen is finished, in any order, so the same call continues after
    an interrupt, which ends all processes at once. Of a file whose last line was cut off, that line is replaced.

    Args:
      path: file of certificates, which is made if there is none. Environments with `certified=True` read
        `certificates.default_path(split)`.
      numbers: of the kitchens in their split.
      split: `train` or `test`.
      num_workers: processes that certify. More than one import the program that calls, whose own work has to be below
        `if __name__ == "__main__":`.
      kind: of the certificates, such as `object_certification.OBJECTS`; that of parts of kitchens when omitted.

    Raises:
      OSError: the file holds something else, or cannot be written.
      ValueError: an unknown split, or a certificate in the file is of another design.
    """
    path = Path(path)
    record, certify_one = kind or CertificateKind(Certificate, certify)
    found = _read(path, numbers, split, record)
    missing = [number for number in numbers if number not in found]
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("ab") as file:
        # What follows the last complete line was cut off.
        file.truncate(path.read_bytes().rfind(b"\n") + 1)
        for certificate in _certified(certify_one, missing, split, num_workers):
            file.write(msgspec.json.encode(certificate) + b"\n")
            file.flush()
            found[certificate.design] = certificate
    return {number: found[number] for number in numbers}


def check_certificates(
    path: str | PathLike[str],
    numbers: Sequence[int],
    split: str,
    *,
    num_workers: int = 1,
    kind: CertificateKind | None = None,
) -> list[int]:
    """Certifies kitchens again; returns the numbers of those whose certificate is missing or comes out otherwise.

    On the same kind of processor all are equal. Arguments and exceptions are those of `write_certificates`.
    """
    record, certify_one = kind or CertificateKind(Certificate, certify)
    found = _read(Path(path), numbers, split, record)
    known = [number for number in numbers if number in found]
    again = {certificate.design: certificate for certificate in _certified(certify_one, known, split, num_workers)}
    return [number for number in numbers if number not in found or found[number] != again[number]]


def _read(path: Path, numbers: Sequence[int], split: str, record: type[Any]) -> dict[int, Any]:
    """Returns the certificates in a file, after those of some kitchens have been compared with their designs."""
    checks.choice(split, SPLITS, "split")
    found: dict[int, Any] = certificates.read(path, record) if path.exists() else {}
    for number in numbers:
        if number in found:
            certificates.check_design(found[number], KitchenDesign.drawn(number, split), path)
    return found


def _certified(
    certify_one: Callable[[int, str], Any], numbers: Sequence[int], split: str, num_workers: int
) -> Iterator[Any]:
    """Yields the certificates of kitchens as they are finished."""
    progress = functools.partial(tqdm, total=len(numbers), unit="kitchen", disable=None, leave=False)
    if checks.integer(num_workers, "num_workers", minimum=1) == 1:
        yield from progress(certify_one(number, split) for number in numbers)
        return
    others = {*multiprocessing.active_children()}
    pool = concurrent.futures.ProcessPoolExecutor(
        num_workers, multiprocessing.get_context("spawn"), initializer=_ignore_interrupts
    )
    try:
        waiting = [pool.submit(certify_one, number, split) for number in numbers]
        for finished in progress(concurrent.futures.as_completed(waiting)):
            yield finished.result()
    except BaseException:
        # Kitchens in progress take up to a minute, and nobody waits for them.
        for worker in {*multiprocessing.active_children()} - others:
            worker.kill()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _ignore_interrupts() -> None:
    """Leaves an interrupt, which a terminal sends to all processes, to the one that started this one."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
