"""The measured results in docs/benchmarks/, which tables of the pages are made of."""

import json
from pathlib import Path
from typing import Any

RESULTS = Path(__file__).parent / "benchmarks"


def read_results(name: str) -> Any:
    """Returns the results of a measurement, by the name of its file."""
    return json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))
