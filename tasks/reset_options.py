"""Options of a reset that belong to a task, beside those of its variations."""

from collections.abc import Mapping
from typing import Any, ClassVar

from numpy.typing import NDArray


class OptionedTask:
    """A task whose resets may take options of its own.

    Attributes:
      reset_options: names of the options.
    """

    reset_options: ClassVar[tuple[str, ...]] = ()

    @property
    def drawn_tasks(self) -> tuple[str, ...]:
        """Names of the tasks of which each episode draws some; empty if every episode asks for the same."""
        return ()

    def reset_request(self, options: Mapping[str, Any]) -> Any:
        """Returns the checked request for a reset of one episode; None if the options have none.

        Args:
          options: of the reset, among them those of `reset_options`.

        Raises:
          TypeError: an option is of the wrong type.
          ValueError: an option has a value that the task refuses.
        """
        del options
        return None

    def request_reset(self, request: Any) -> None:
        """Makes the next reset follow a request that `reset_request` returned."""

    def recorded_options(self, arrays: Mapping[str, NDArray]) -> dict[str, Any]:
        """Returns the options of a reset that repeat what was drawn in a recorded episode.

        Args:
          arrays: the episode's `observation/...` and `info/...` arrays with a leading axis of `T + 1`.
        """
        del arrays
        return {}
