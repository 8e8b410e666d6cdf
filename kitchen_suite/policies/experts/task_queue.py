"""Order in which the kitchen's expert does its tasks."""

from collections.abc import Mapping, Sequence

# A completed task is repeated if its distance grows beyond this multiple of the threshold; doors spring back a little.
_UNDONE = 1.2


class TaskQueue:
    """Tasks that remain to be done; the first one is the current one.

    Distances are by task, in units of its threshold.

    Attributes:
      tasks: all tasks, in the order in which they were to be done.
    """

    def __init__(self, tasks: Sequence[str]) -> None:
        self.tasks = tuple(tasks)
        self._remaining = list(tasks)

    @property
    def size(self) -> int:
        """Number of tasks that remain."""
        return len(self._remaining)

    @property
    def current(self) -> str | None:
        """The task under way; None when all are done."""
        return self._remaining[0] if self._remaining else None

    def complete(self) -> None:
        """Removes the current task."""
        del self._remaining[0]

    def postpone(self) -> None:
        """Moves the current task behind the others."""
        self._remaining.append(self._remaining.pop(0))

    def restart_undone(self, distances: Mapping[str, float]) -> None:
        """Adds the completed tasks that have come undone, once no others remain."""
        self._remaining = [task for task in self.tasks if distances[task] > _UNDONE]
