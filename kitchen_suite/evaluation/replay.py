"""Checks recordings and receipts: their episodes are played again, and compared."""

import contextlib
from pathlib import Path

from kitchen_suite.episodes.recording import Recording
from kitchen_suite.episodes.replay import Replay, Verdict, worst
from kitchen_suite.evaluation.verify import verify


def replay(
    path: str | Path,
    *,
    episodes: str = "all",
    published: str | Path | None = None,
    dataset: str | Path | None = None,
    num_envs: int = 16,
    num_threads: int | None = None,
) -> Verdict:
    """Plays the episodes of a recording or a receipt again, and compares all numbers and scores.

    Args:
      path: folder of a recording, or file of a receipt.
      episodes: which episodes of a recording: `all`, or numbers and ranges such as `0,5,7-9`.
      published: file of a result as JSON, such as `kitchen-evaluate` writes, which has to be that of a receipt.
      dataset: folder of the recording from which the goals of a receipt were taken.
      num_envs: number of environments in which the episodes of a receipt are stepped together.
      num_threads: number of threads that step them; one per processor when None.

    Returns the verdict on all episodes.

    Raises:
      AlteredError: a receipt does not agree with itself, or with the published result or the dataset.
      OSError: the file or folder cannot be read.
      ValueError: there are no such episodes.
    """
    if Path(path).is_file():
        if episodes != "all":
            raise ValueError("the episodes of a receipt are replayed all together")
        return verify(
            Path(path),
            published=None if published is None else Path(published),
            dataset=None if dataset is None else Path(dataset),
            num_envs=num_envs,
            num_threads=num_threads,
        )
    if published is not None or dataset is not None:
        raise ValueError("a published result and a dataset are compared with a receipt, not with a recording")
    played = Replay(Recording.open(Path(path)), episodes, 1)
    with contextlib.closing(played.environment):
        return worst(comparison.verdict for _, comparison in played)
