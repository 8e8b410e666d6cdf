"""Versions of the packages, and the kind of processor, that the course of an episode depends on."""

import hashlib
import importlib.metadata
import math
import platform
import re

import numpy as np

from kitchen_suite._version import __version__

PACKAGES = ("dm-control", "gymnasium", "gymnasium-robotics", "mujoco", "numpy")

# Forms of the texts that files have of versions and machines: a version of a package, and `machine`.
VERSION = re.compile(r"\d[\w.+!-]{0,63}", re.ASCII)
MACHINE = re.compile(r"[\w.-]{0,32}, rounding [0-9a-f]{8}(, linear algebra [0-9a-f]{8})?", re.ASCII)


def installed_versions() -> dict[str, str]:
    """Returns the versions of the suite and of `PACKAGES`, by name."""
    return {"kitchen-suite": __version__, **{name: importlib.metadata.version(name) for name in PACKAGES}}


def processor() -> str:
    """Returns the kind of this processor: its architecture, and how the C library and NumPy round on it.

    Processors of the same kind, with the same packages, are expected to play the same episodes to the bit. The rounding
    is a digest of functions of fixed numbers, which extensions such as FMA change.
    """
    numbers = np.random.default_rng(0).uniform(-10.0, 10.0, 4096)
    functions = (math.sin, math.cos, math.tan, math.exp, math.atan)
    scalar = [function(number) for function in functions for number in numbers]
    vectors = [function(numbers) for function in (np.sin, np.cos, np.tan, np.exp, np.arctan)]
    rows = numbers.reshape(-1, 8)
    reductions = [
        rows.sum(axis=0),
        rows.sum(axis=1),
        np.einsum("ni,ni->n", rows, rows),
        np.cross(rows[:, :3], rows[:, 3:6]),
    ]
    results = np.concatenate([scalar, *vectors, *map(np.ravel, reductions)])
    return f"{platform.machine()}, rounding {hashlib.sha256(results.tobytes()).hexdigest()[:8]}"


def machine() -> str:
    """Returns `processor`, and how linear algebra rounds, with a library's own code for each model of processor.

    The control modes of the end effector depend on it.
    """
    generator = np.random.default_rng(0)
    matrices, vectors = generator.standard_normal((64, 6, 9)), generator.standard_normal((64, 6, 1))
    squares = matrices @ matrices.transpose(0, 2, 1)
    results = np.concatenate([squares.ravel(), np.linalg.solve(squares, vectors).ravel()])
    return f"{processor()}, linear algebra {hashlib.sha256(results.tobytes()).hexdigest()[:8]}"
