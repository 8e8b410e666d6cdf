"""Tasks that open a drawer or a door."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.entities.assets import Array
from kitchen_suite.tasks.records import Metrics
from kitchen_suite.tasks.task import SuiteTask


class OpeningTask(SuiteTask):
    """A task that opens a drawer or a door.

    Attributes:
      opened: `drawer`, whose opening is in m, or `door`, whose opening is a share of the goal; infos have it as
        `drawer_opening` or `door_opening`.
    """

    opened: ClassVar[str]

    def metrics(self, infos: Mapping[str, Any]) -> Metrics:
        """Returns whether the drawer or door is open, whether it was at any time, and how far it is open."""
        return {
            "success": bool(infos["is_success"]),
            "success_at_any_time": bool(infos["success_at_any_time"]),
            f"{self.opened}_opening": float(self.progress_in(infos)),
        }

    def progress_in(self, infos: Mapping[str, Any]) -> Array:
        """Returns how far the drawer or door is open [m, or as a share]."""
        return infos[f"{self.opened}_opening"]

    def goals_reached(self, arrays: Mapping[str, NDArray]) -> tuple[tuple[str, ...], NDArray[np.bool_]] | None:
        key = "info/is_success"
        return ((self.opened,), arrays[key][:, np.newaxis]) if key in arrays else None
