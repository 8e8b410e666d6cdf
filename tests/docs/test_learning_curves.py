"""The script of Stable-Baselines3's learning curves trains, keeps rows and draws."""

import json

import pytest
from docs_scripts import load_script

pytestmark = [pytest.mark.clients, pytest.mark.full]


def test_a_seed_is_trained_evaluated_and_drawn(monkeypatch, tmp_path):
    curves = load_script("experiments/learning_curves")
    file, picture = tmp_path / "rows.json", tmp_path / "curves.png"
    # One rollout of 256 environments.
    for name, value in {"FILE": file, "PICTURE": picture, "EPISODES": 2, "STEPS": 4096, "INTERVAL": 4096}.items():
        monkeypatch.setattr(curves, name, value)
    curves.main(["--seeds=5"])
    (row,) = json.loads(file.read_text(encoding="utf-8"))
    assert (row["seed"], row["control_steps"]) == (5, [4096])
    assert 0.0 < row["minutes"][0] < 10.0
    assert row["success"][0] in (0.0, 0.5, 1.0)
    assert -0.01 < row["opening"][0] < 0.4
    assert picture.read_bytes().startswith(b"\x89PNG")
