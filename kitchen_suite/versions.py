"""Versions of the packages that the course of an episode depends on."""

import importlib.metadata

import kitchen_suite

PACKAGES = ("dm-control", "gymnasium", "gymnasium-robotics", "mujoco", "numpy")


def installed_versions() -> dict[str, str]:
    """Returns the versions of the suite and of `PACKAGES`, by name."""
    return {
        "kitchen-suite": kitchen_suite.__version__,
        **{name: importlib.metadata.version(name) for name in PACKAGES},
    }
