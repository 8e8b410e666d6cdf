"""The greatest returns of failed episodes that training finds."""

import importlib
import json

import pytest

pytestmark = pytest.mark.clients


def test_a_case_has_the_greatest_return_of_the_episodes_that_failed(tmp_path, monkeypatch):
    script = importlib.import_module("failed_returns")
    monkeypatch.setattr(script, "RESULTS", tmp_path / "failed_returns.json")
    monkeypatch.setattr(script, "DEFAULT_TASKS", ("light switch",))
    monkeypatch.setattr(script, "EPISODES", 3)
    monkeypatch.setattr(script, "EPISODE_STEPS", 20)
    monkeypatch.setattr(script, "INTERVAL", 1_000)
    measure = script.measure
    monkeypatch.setattr(script, "measure", lambda *case: measure(*case, steps=3_000))
    script.main()
    rows = json.loads(script.RESULTS.read_text("utf-8"))
    assert [(row["task"], row["reward"]) for row in rows] == [("light switch", "dense"), ("light switch", "dense_gain")]
    for row in rows:
        assert row["episodes"] > 0
        assert 0 < row["greatest_return"] < 20
    # Cases with a row are not measured again.
    monkeypatch.setattr(script, "measure", lambda *case: pytest.fail(f"{case} is measured again"))
    script.main()
