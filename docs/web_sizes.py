"""Prints the size of a web page of 280 control steps in each domain, and the time that making it takes.

  python docs/web_sizes.py

The time is that of making the scene, of the frames and of writing the page, without that of the episode and of imports.
"""

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from kitchen_suite import policies, suite
from kitchen_suite.rendering import cameras
from kitchen_suite.rendering.web_page import WebPage
from kitchen_suite.rendering.web_scenes import SceneRecorder

STEPS = 280


def row(domain: str, path: Path) -> str:
    """Returns the row of a domain, after its page has been written to a path."""
    import mjviser  # noqa: F401

    options = {"visuals": True, "render_quality": "fast"}
    environment = suite.load(domain, suite.default_task(domain), task_kwargs={**options, "random": 0})
    timestep = environment.reset()
    policy = policies.POLICIES["random"](environment, np.random.default_rng(0))
    seconds, page = 0.0, WebPage()
    with SceneRecorder() as recorder:
        started = time.perf_counter()
        recorder.start(environment.physics, cameras.find_camera(environment.physics, "overview"))
        seconds += time.perf_counter() - started
        for _ in range(STEPS):
            timestep = environment.step(policy(timestep))
            started = time.perf_counter()
            recorder.add_frame(environment.physics, environment.control_timestep())
            seconds += time.perf_counter() - started
        started = time.perf_counter()
        page.add(recorder.finish(1.0), {"name": domain, "tasks": [], "rewards": [], "returns": [], "metrics": {}})
        path.write_text(page.html(domain), "utf-8")
        seconds += time.perf_counter() - started
    return f"| {domain} | {path.stat().st_size / 1e6:.1f} MB | {seconds:.1f} s |"


def main() -> int:
    """Prints the rows of the table in docs/web.md."""
    with tempfile.TemporaryDirectory() as folder:
        for domain in suite.TASKS_BY_DOMAIN:
            print(row(domain, Path(folder) / "page.html"), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
