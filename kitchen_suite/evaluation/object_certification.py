"""Certification of the tasks with objects in generated kitchens, which the scripted expert plays.

write_certificates("mine.jsonl", range(200, 210), "train", kind=OBJECTS)
"""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
from collections.abc import Iterable
from typing import Any

import numpy as np

from kitchen_suite import policies, suite
from kitchen_suite.entities.kitchen_designs import SPLITS, KitchenDesign
from kitchen_suite.evaluation.certification import CertificateKind, played
from kitchen_suite.tasks.generated_kitchens.certificates import design_digest
from kitchen_suite.tasks.pick_and_place.certificates import ObjectCertificate, layout_digest
from kitchen_suite.tasks.pick_and_place.requests import VERBS

# Of each verb, numbers of tasks that are to be certified, and that are tried at most.
_WANTED, _MOST_TRIED = 2, 4


def certify_objects(number: int, split: str) -> ObjectCertificate:
    """Returns the certificate of the tasks with objects in a kitchen.

    Of each verb the expert tries tasks in a drawn order until it has completed two of them, four at most; each is
    played in two episodes, with the seeds 0 and 1.
    """
    design = KitchenDesign.drawn(number, split)
    environment = suite.load("pick_and_place", "any", {"design": design, "visuals": False, "random": 0})
    task: Any = environment.task
    act = policies.find("expert")(environment, np.random.default_rng(0))
    steps: dict[str, int | None] = {}
    for verb in VERBS:
        names = [name for name in task.requests.tasks if name.startswith(f"{verb} ")]
        order = np.random.default_rng([SPLITS.index(split), number]).permutation(len(names))
        for name in [names[k] for k in order.tolist()[:_MOST_TRIED]]:
            steps[name] = _slower(played(environment, act, name, seed) for seed in (0, 1))
            if sum(steps.get(each) is not None for each in names) == _WANTED:
                break
    return ObjectCertificate(
        design=number,
        digest=design_digest(design),
        layout=layout_digest(task.scene.layout),
        physics=task.scene.physics,
        steps=steps,
    )


def _slower(steps: Iterable[int | None]) -> int | None:
    """Returns the greatest of some numbers; None, and no later one is asked for, where one is None."""
    greatest = 0
    for each in steps:
        if each is None:
            return None
        greatest = max(greatest, each)
    return greatest


OBJECTS = CertificateKind(ObjectCertificate, certify_objects)
"""The certificates of tasks with objects."""
