"""What runs in the process of a worker on Ray."""

import pickle
import platform
from collections.abc import Mapping, Sequence
from typing import Any

from kitchen_suite.rendering import gl

# All else is imported late, with what is unpickled: dm_control must not be before it is settled that no GL library is
# needed.


class ClusterError(Exception):
    """Ray cannot be reached or used, or its workers do not get anywhere."""


class Worker:
    """An actor that plays what it is given."""

    def start(self, pickled: bytes, versions: Mapping[str, str]) -> None:
        """Makes everything ready.

        Args:
          pickled: what makes a `ray_pool.Player`.
          versions: of the packages that decide what an episode looks like; they must be the same here.

        Raises:
          ClusterError: they are not, or something else is wrong on this machine.
        """
        try:
            gl.prepare(rendering=False)
            _check_versions(versions)
            self._player = pickle.loads(pickled)()
        except (ImportError, OSError, TypeError, ValueError) as error:
            raise ClusterError(f"a worker on {platform.node()} cannot start: {error}") from error

    def play(self, more: Sequence[tuple[int, int]]) -> tuple[int, Any]:
        """Plays, see `ray_pool.Player`."""
        return self._player.play(more)


def _check_versions(wanted: Mapping[str, str]) -> None:
    """Raises a ValueError that names the packages of which another version is installed here."""
    from kitchen_suite.versions import installed_versions

    present = installed_versions()
    if differing := [
        f"{name} {present[name]} in place of {wanted[name]}" for name in wanted if present[name] != wanted[name]
    ]:
        raise ValueError(f"it has {', '.join(differing)}, so that its episodes would be others")
