"""Writes episodes and videos, each file whole or not at all."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from kitchen_suite.files import check_writable, save_arrays
from kitchen_suite.rollouts.episode import Episode

_PATTERN = "episode_*.npz"


def claim_folder(folder: Path) -> None:
    """Makes a folder ready for episodes.

    Raises:
      OSError: it cannot be made or written to, or it holds episodes already.
    """
    folder.mkdir(parents=True, exist_ok=True)
    check_writable(folder)
    if any(folder.glob(_PATTERN)):
        raise FileExistsError(f"{folder} holds episodes already, which are never overwritten: name another folder")


def save_episode(folder: Path, index: int, episode: Episode, metadata: Mapping[str, Any]) -> Path:
    """Writes an episode as a compressed npz that `numpy.load` reads without pickle.

    Its arrays: `observation/<key>` with one row more than `action`, `reward` and `discount`; and `metadata`, a string
    of JSON.

    Args:
      folder: where to.
      index: number of the episode, which makes up the file name.
      episode: what to write.
      metadata: what else should be known about it.

    Returns:
      The file.
    """
    known = {**metadata, "episode": index, "seed": episode.outcome.seed, "results": episode.outcome.results}
    arrays: dict[str, NDArray] = {
        **{f"observation/{key}": rows for key, rows in episode.observations.items()},
        "action": episode.actions,
        "reward": episode.rewards,
        "discount": episode.discounts,
    }
    return save_arrays(episode_path(folder, index), arrays, known)


def episode_path(folder: Path, index: int) -> Path:
    """Where the episode of that number is."""
    return folder / _PATTERN.replace("*", f"{index:06d}")


def episode_indices(folder: Path) -> list[int]:
    """Numbers of the episodes in a folder, in order."""
    first = len(_PATTERN.partition("*")[0])
    numbers = (path.stem[first:] for path in folder.glob(_PATTERN))
    return sorted(int(number) for number in numbers if number.isdecimal())
