"""Measures frames per second by `render_quality`, in one interleaved run.

`python docs/render_speed.py` prints a table for README's pages. The best of the rounds counts, since other programs
only make a frame slower.
"""

import time

from tabulate import tabulate

from kitchen_suite import suite
from kitchen_suite.environment import Environment
from kitchen_suite.rendering.quality import RENDER_QUALITIES

TASKS = {"kitchen": "all", "open_cabinet": "top_drawer"}
SIZES = ((128, 128), (640, 480))
ROUNDS = 10


def seconds(environment: Environment, width: int, height: int) -> float:
    """Returns how long one image takes [s]."""
    started = time.perf_counter()
    environment.physics.render(height, width, camera_id="overview")
    return time.perf_counter() - started


def row(domain: str, width: int, height: int) -> tuple[str, str, str, str, str]:
    """Returns domain, size, frames per second of each quality, and their ratio."""
    environments = [
        suite.load(domain, TASKS[domain], {"random": 0, "render_quality": quality}) for quality in RENDER_QUALITIES
    ]
    rounds = [[seconds(environment, width, height) for environment in environments] for _ in range(ROUNDS)]
    high, fast = (min(times) for times in zip(*rounds, strict=True))
    for environment in environments:
        environment.close()
    return domain, f"{width} x {height}", f"{1 / high:.1f}", f"{1 / fast:.1f}", f"{high / fast:.1f}"


if __name__ == "__main__":
    rows = [row(domain, *size) for domain in TASKS for size in SIZES]
    print(tabulate(rows, ("domain", "size", "high", "fast", "ratio"), tablefmt="github", disable_numparse=True))
