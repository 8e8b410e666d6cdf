"""Examines what is installed, what works, and whether episodes are those of other machines."""

import collections
import contextlib
import hashlib
import importlib.metadata
import os
import platform
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import kitchen_suite
from kitchen_suite import checks, files, grasping, installation, suite
from kitchen_suite._version import __version__
from kitchen_suite.domains.domain import Domain
from kitchen_suite.environment import Environment
from kitchen_suite.episodes.play import VectorRollout, make_controller
from kitchen_suite.episodes.spec import EnvironmentSpec
from kitchen_suite.evaluation.traces import TraceRecorder
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.physics_names import EXACT, FAST, HOLDING_KEY, PHYSICS
from kitchen_suite.policies import PolicyRef
from kitchen_suite.rendering import gl
from kitchen_suite.vector_env.base import processors
from kitchen_suite.versions import PACKAGES, processor

# Digests by domain and physics, of each combination of versions and kind of processor that is known; written by
# `docs/scripts/known_digests.py`.
KNOWN = Path(__file__).parent / "known_digests.json"

_SIMULATING = ("dm-control", "mujoco", "numpy")  # Packages whose versions the numbers of an episode depend on.

# Episodes of random actions that are digested, and their control steps.
_EPISODES, _STEPS = 5, 30

_MISSING = "not installed"
_DIFFERS = "DIFFERS from that known for this kind of processor"


def circumstances() -> dict[str, str]:
    """Returns the versions and the kind of processor that decide which digests are expected."""
    return {**{name: installation.version_of(name) or _MISSING for name in _SIMULATING}, "processor": processor()}


def digests() -> Iterator[tuple[str, str]]:
    """Yields domain and physics, such as `kitchen fast`, and the digest of some episodes of random actions there."""
    for domain in suite.DOMAINS:
        with contextlib.closing(_environments(domain, EXACT).make_environment()) as environment:
            fast = suite_env(environment).composer_task.scene.arena.fast_physics
        for physics in (EXACT, FAST) if fast else (EXACT,):
            yield f"{domain} {physics}", _digest(domain, physics)


def _environments(domain: str, physics: str) -> EnvironmentSpec:
    return EnvironmentSpec.make(domain, None, {"physics": physics}, _STEPS)


def _digest(domain: str, physics: str) -> str:
    policy = PolicyRef.parse("random")
    spec = _environments(domain, physics).episodes(policy, seed=0)
    contents = {}
    with contextlib.closing(spec.make_vector_env(_EPISODES, 1)) as vector:
        recorder = TraceRecorder(vector, make_controller(spec, policy, vector))
        waiting = collections.deque((index, index) for index in range(_EPISODES))
        for index, episode in VectorRollout(vector, recorder).play(waiting):
            contents[index] = recorder.trace(episode).digest.tobytes()
    return hashlib.sha256(b"".join(contents[index] for index in range(_EPISODES))).hexdigest()


def expected(here: Mapping[str, str]) -> dict[str, str]:
    """Returns the digests known for versions and a processor; empty if they are not known."""
    try:
        known = files.load_json(KNOWN, "the known digests")
        return next((record["digests"] for record in known if record["circumstances"] == here), {})
    except (OSError, LookupError, TypeError):  # Missing or damaged.
        return {}


def examine(report: Callable[[str], object]) -> bool:
    """Reports a fact a line; returns whether no digest differs from the one known for this kind of processor."""

    def add(name: str, fact: str) -> None:
        report(f"{name:<28} {fact}")

    for name, fact in _facts().items():
        add(name, fact)
    known = expected(circumstances())
    agrees = True
    try:
        for name, digest in digests():
            verdict = _verdict(digest, known.get(name))
            agrees &= verdict != _DIFFERS
            add(f"digest {name}", f"{digest[:12]}, {verdict}")
    except Exception as error:  # Whatever fails here is a fact to be told.
        add("digests", f"no episode can be played: {_in_one_line(error)}")
    return agrees


def examine_objects(domain_name: str, report: Callable[[str], object]) -> bool:
    """Lifts, holds and lets go each free object of a domain that has a grasp site, in each physics; a line for each.

    Returns whether all are held. Raises a ValueError if the domain has no object with a grasp site.
    """
    domain = suite.find_domain(domain_name)
    found, holds = False, True
    for physics in PHYSICS:
        try:
            environment = _environment_of_hand(domain, physics)
        except ValueError as error:
            if physics == domain.physics:
                raise
            report(f"{physics:<8} {_in_one_line(error)}")
            continue
        with contextlib.closing(environment):
            scene = environment.task.scene
            report(f"{physics:<8} {scene.info.get(HOLDING_KEY, 'no free objects')}")
            for name in grasping.grasp_sites(scene):
                environment.reset()
                held = grasping.Grasp(environment, name).play(environment)
                report(f"{physics:<8} {name}: {held}")
                found, holds = True, holds and not held.fault
            for name in sorted({*scene.free_objects} - grasping.grasp_sites(scene).keys()):
                report(f"{physics:<8} {name}: not examined, since it has no site whose name begins with 'grasp'")
    if not found:
        raise ValueError(
            f"{domain.name} has no free object with a grasp site: add a site named 'grasp' where the hand's end "
            "effector is when the fingers close; see docs/guide/your_task.md"
        )
    return holds


def _environment_of_hand(domain: Domain, physics: str) -> Environment:
    """Returns an environment of a domain's default task whose actions are poses of the hand."""
    arguments = {**domain.tasks[domain.default_task], "physics": physics, "control_mode": grasping.CONTROL_MODE}
    return domain.load(**arguments, random=0, time_limit=None, visuals=False)


def _verdict(digest: str, known: str | None) -> str:
    if known is None:
        return "not known for these versions and this kind of processor"
    return "as known for this kind of processor" if digest == known else _DIFFERS


def _facts() -> dict[str, str]:
    return {
        "kitchen-suite": f"{__version__} in {Path(kitchen_suite.__file__).parent}",
        "python": f"{platform.python_version()} in {sys.prefix}",
        "system": platform.platform(),
        "processor": f"{processor()}; {processors()} usable",
        **{name: installation.version_of(name) or _MISSING for name in PACKAGES},
        "reproduces": "FrankaKitchen-v1 of Gymnasium-Robotics 1.4, to the bit; others: docs/guide/migrating.md",
        "MUJOCO_GL": os.environ.get("MUJOCO_GL", "not set"),
        "GL": _gl(),
        "triton beside GL": _clash(),
        **{f"extra {name}": fact for name, fact in _extras().items()},
    }


def _gl() -> str:
    try:
        return f"{gl.find_library()} renders"
    except OSError as error:
        return f"nothing can be rendered: {_in_one_line(error)}"


def _clash() -> str:
    """Returns what becomes of a program that opens a GL library before PyTorch's triton."""
    if not gl.triton_libraries():
        return "triton is not installed"
    try:
        number = gl.signal_beside_triton(gl.find_library())
    except OSError:
        return "nothing can be rendered"
    if not number:
        return "no clash"
    return (
        f"clash: signal {number} ends a program that opens GL before triton; the suite loads triton before its first "
        "image, programs that render without it have to import triton first"
    )


def _in_one_line(error: Exception) -> str:
    return checks.shortened(" ".join((type(error).__name__, *str(error).split())))


def _extras() -> dict[str, str]:
    requirements: list[str] = []
    with contextlib.suppress(importlib.metadata.PackageNotFoundError):
        requirements = importlib.metadata.requires("kitchen-suite") or []
    needed: dict[str, list[str]] = {}
    for requirement in requirements:
        package, extra = re.match(r"[\w.-]+", requirement), re.search(r"extra == ['\"]([\w-]+)", requirement)
        if package and extra and package[0] != "kitchen-suite":
            needed.setdefault(extra[1], []).append(package[0])
    missing = {
        extra: [each for each in packages if not installation.version_of(each)] for extra, packages in needed.items()
    }
    return {extra: _without(extra, each) if each else "installed" for extra, each in missing.items()}


def _without(extra: str, packages: list[str]) -> str:
    python = installation.EXTRA_PYTHONS.get(extra, (0, 0))
    reason = f"; it needs Python {python[0]}.{python[1]}" if sys.version_info < python else ""
    return f"without {', '.join(packages)}{reason}"
