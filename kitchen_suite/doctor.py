"""The work of `kitchen-doctor`: what is installed, what works, and whether episodes are those of other machines."""

import collections
import contextlib
import hashlib
import importlib.metadata
import os
import platform
import re
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

from kitchen_suite import checks, files, suite
from kitchen_suite.evaluation.receipts import Witness
from kitchen_suite.names import PHYSICS
from kitchen_suite.rendering import gl
from kitchen_suite.rollouts.report import print_line
from kitchen_suite.rollouts.rollout import PolicyController, VectorRollout
from kitchen_suite.rollouts.spec import EnvironmentSpec
from kitchen_suite.settings import DoctorSettings
from kitchen_suite.vector_env.base import processors
from kitchen_suite.versions import installed_versions, processor

# Digests by domain and physics, of each combination of versions and kind of processor that is known; written by
# `docs/experiments/processors.py digests`.
KNOWN = Path(__file__).parent / "known_digests.json"

# Packages whose versions the numbers of an episode depend on.
_SIMULATING = ("dm-control", "mujoco", "numpy")

# Episodes of random actions that are digested, and their control steps.
_EPISODES, _STEPS = 5, 30

_WIDTH = 28


def circumstances() -> dict[str, str]:
    """Returns the versions and the kind of processor that decide which digests are expected."""
    versions = installed_versions()
    return {**{name: versions[name] for name in _SIMULATING}, "processor": processor()}


def digests() -> Iterator[tuple[str, str]]:
    """Yields domain and physics, such as `kitchen fast`, and the digest of some episodes of random actions there."""
    for domain in suite.DOMAINS:
        for physics in PHYSICS:
            try:
                yield f"{domain} {physics}", _digest(domain, physics)
            except ValueError:  # The domain has no such physics.
                continue


def _digest(domain: str, physics: str) -> str:
    environments = EnvironmentSpec.make(
        domain_name=domain, task_name=None, task_kwargs={"physics": physics}, max_episode_steps=_STEPS
    )
    spec = environments.episodes(policy="random", seed=0, seeding="gymnasium")
    contents = {}
    with contextlib.closing(spec.make_vector_env(_EPISODES, 1)) as vector:
        witness = Witness(vector, PolicyController(vector, spec.find_policy()))
        waiting = collections.deque((index, index) for index in range(_EPISODES))
        for index, episode in VectorRollout(vector, witness).play(waiting):
            contents[index] = witness.trace(episode).digest.tobytes()
    return hashlib.sha256(b"".join(contents[index] for index in range(_EPISODES))).hexdigest()


def expected(here: Mapping[str, str]) -> dict[str, str]:
    """Returns the digests known for versions and a processor; empty if they are not known."""
    known = files.load_json(KNOWN, "the known digests")
    return next((record["digests"] for record in known if record["circumstances"] == here), {})


class DoctorJob:
    """Prints a fact a line."""

    failures = (OSError,)
    usage_errors = ()

    def __init__(self, settings: DoctorSettings) -> None:
        """Needs nothing."""

    def progress(self) -> str:
        return "before the end"

    def run(self) -> bool:
        """Prints the facts; returns whether no digest differs from the one known for this kind of processor."""
        for name, fact in _facts().items():
            _print_fact(name, fact)
        known, agrees = expected(circumstances()), True
        for name, digest in digests():
            if not known:
                verdict = "not known for these versions and this kind of processor"
            elif digest == known.get(name):
                verdict = "as known for this kind of processor"
            else:
                verdict, agrees = (
                    f"DIFFERS from {known.get(name, 'none')[:12]}, known for this kind of processor",
                    False,
                )
            _print_fact(f"digest {name}", f"{digest[:12]}, {verdict}")
        return agrees


def _print_fact(name: str, fact: str) -> None:
    print_line(f"{name:<{_WIDTH}} {fact}")


def _facts() -> dict[str, str]:
    import kitchen_suite

    versions = installed_versions()
    return {
        "kitchen-suite": f"{versions.pop('kitchen-suite')} in {Path(kitchen_suite.__file__).parent}",
        "python": f"{platform.python_version()} in {sys.prefix}",
        "system": platform.platform(),
        "processor": f"{processor()}; {processors()} usable",
        **versions,
        "kitchen": ("FrankaKitchen-v1 of Gymnasium-Robotics 1.4, equal to the bit; others: docs/guide/kitchens.md"),
        "MUJOCO_GL": os.environ.get("MUJOCO_GL", "not set"),
        "GL": _gl(),
        **{f"extra {name}": fact for name, fact in _extras().items()},
    }


def _gl() -> str:
    """Returns which library renders, or why none does."""
    try:
        return f"{gl.find_library()} renders"
    except OSError as error:
        return f"nothing can be rendered: {checks.shortened(str(error).splitlines()[0])}"


def _extras() -> dict[str, str]:
    """Returns whether the packages of each extra are installed."""
    needed: dict[str, list[str]] = {}
    for requirement in importlib.metadata.requires("kitchen-suite") or []:
        package, extra = re.match(r"[\w.-]+", requirement), re.search(r"extra == ['\"]([\w-]+)", requirement)
        if package and extra and package[0] != "kitchen-suite":
            needed.setdefault(extra[1], []).append(package[0])
    return {extra: _installed(packages) for extra, packages in needed.items()}


def _installed(packages: list[str]) -> str:
    missing = []
    for package in packages:
        try:
            importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            missing.append(package)
    return f"without {', '.join(missing)}" if missing else "installed"
