"""RLlib trains by the Gymnasium ids: the snippets of the page run as they stand."""

import math
import re
from pathlib import Path

import pytest

pytestmark = pytest.mark.ray

PAGE = Path(__file__).resolve().parents[2] / "docs" / "ray.md"
SNIPPETS = re.findall(r"```py\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)


@pytest.fixture(autouse=True)
def ray_stopped(monkeypatch):
    """Sends no usage statistics, and leaves no process running."""
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    import ray

    yield
    ray.shutdown()


@pytest.mark.parametrize(("snippet", "steps"), [*zip(SNIPPETS, (512, 560), strict=True)], ids=["cabinet", "kitchen"])
def test_ppo_learns_for_an_iteration(snippet, steps):
    names = {}
    exec(compile(snippet, "snippet", "exec"), names)
    assert names["result"]["env_runners"]["num_env_steps_sampled"] >= steps
    learner = names["result"]["learners"]["default_policy"]
    assert learner["num_module_steps_trained"] >= steps
    assert math.isfinite(learner["total_loss"])
