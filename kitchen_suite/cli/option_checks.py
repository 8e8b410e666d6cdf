"""Checks of the values of single flags: each raises a ValueError that says what the value must be."""

import os
from pathlib import Path


def check_even(pixels: int) -> None:
    """Raises a ValueError for an odd number."""
    if pixels % 2:
        raise ValueError("must be even")


def check_folder(path: Path) -> None:
    """Raises a ValueError for a path that is there and is no folder."""
    if path.exists() and not path.is_dir():
        raise ValueError("is not a folder")


def check_video(path: Path) -> None:
    """Raises a ValueError for a path that cannot be written to as a video."""
    _check_suffix(path, ".mp4")


def check_page(path: Path) -> None:
    """Raises a ValueError for a path that cannot be written to as a web page."""
    _check_suffix(path, ".html")


def check_file(path: Path) -> None:
    """Raises a ValueError for a path that cannot be written to as a file."""
    if path.exists() and not path.is_file():
        raise ValueError("is not a file")
    _check_parent(path)


def _check_suffix(path: Path, suffix: str) -> None:
    """Raises a ValueError for a path that cannot be written to as a file whose name ends with a suffix."""
    if path.suffix != suffix or path.is_dir():
        raise ValueError(f"must be a file that ends with {suffix}")
    _check_parent(path)


def _check_parent(path: Path) -> None:
    """Raises a ValueError for a path in a folder that cannot be written to."""
    if not path.parent.is_dir() or not os.access(path.parent, os.W_OK):
        raise ValueError(f"there is no folder {str(path.parent)!r} that may be written to")
