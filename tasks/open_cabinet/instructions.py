"""The tasks of the open_cabinet domain in words."""

from collections.abc import Mapping
from types import MappingProxyType

# Instructions by drawer; see `tasks.instructions`.
INSTRUCTIONS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "top": (
            "open the top drawer of the cabinet",
            "open the upper drawer of the cabinet",
            "pull the top drawer of the cabinet open",
            "pull out the top drawer by its handle",
        ),
        "bottom": (
            "open the bottom drawer of the cabinet",
            "open the lower drawer of the cabinet",
            "pull the bottom drawer of the cabinet open",
            "pull out the bottom drawer by its handle",
        ),
    }
)
