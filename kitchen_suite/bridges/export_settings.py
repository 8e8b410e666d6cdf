"""Settings of `kitchen-export`."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from kitchen_suite.rollouts.settings import TaskSettings


@dataclasses.dataclass(frozen=True, kw_only=True)
class ExportSettings(TaskSettings):
    """Settings of `kitchen-export`; each is the flag of its name."""

    output: Path
    domain_name: str = "kitchen"
    seed: int = 0
    variation_values: Mapping[str, Any] = dataclasses.field(default_factory=dict)
