"""A progress bar of episodes."""

from tqdm import tqdm


class EpisodeBar:
    """A bar that counts episodes and shows how many of them succeeded."""

    def __init__(self, total: int, found: int = 0, successes: int = 0) -> None:
        """Shows it where stderr is a terminal.

        Args:
          total: number of episodes in the end.
          found: how many of them are there already.
          successes: how many of these succeeded.
        """
        self._bar = tqdm(total=total, initial=found, unit="episode", disable=None, leave=False)
        self._count, self._successes = found, successes

    def __enter__(self) -> "EpisodeBar":
        return self

    def __exit__(self, *exception: object) -> None:
        self._bar.close()

    def count(self, success: bool) -> None:
        """Counts an episode."""
        self._count, self._successes = self._count + 1, self._successes + success
        self._bar.set_postfix_str(f"success {self._successes / self._count:.0%}", refresh=False)
        self._bar.update()
