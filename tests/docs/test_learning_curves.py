"""The script of Stable-Baselines3's learning curves trains, keeps rows and draws."""

import dataclasses
import json

import pytest
from docs_scripts import load_script

pytestmark = [pytest.mark.clients, pytest.mark.full]

# Control steps until the evaluation: a rollout of 256 environments, and 63 steps of 64, of which the last two train.
STEPS = {"drawer": 4096, "kettle": 4032}


@pytest.mark.parametrize("name", STEPS)
def test_a_seed_is_trained_evaluated_and_drawn(name, monkeypatch, tmp_path):
    curves = load_script("experiments/learning_curves")
    recipe, steps = curves.RECIPES[name], STEPS[name]
    shorter = {"steps": steps, "interval": steps, "evaluation": {**recipe.evaluation, "num_episodes": 2}}
    monkeypatch.setitem(curves.RECIPES, name, dataclasses.replace(recipe, **shorter))
    monkeypatch.setattr(curves, "FILE", tmp_path / "rows.json")
    monkeypatch.setattr(curves, "PICTURES", tmp_path)
    curves.main([name, "--seeds=5"])
    (row,) = json.loads((tmp_path / "rows.json").read_text(encoding="utf-8"))
    assert (row["recipe"], row["seed"], row["control_steps"]) == (name, 5, [steps])
    # Rounded: on a fast machine so few steps take nothing.
    assert row["minutes"][0] >= 0.0
    assert row["success"][0] in (0.0, 0.5, 1.0)
    assert {*recipe.scores} <= row.keys()
    assert -0.01 < row.get("mean_progress", [0.0])[0] < 0.4
    assert (tmp_path / f"learning_curves_{name}.png").read_bytes().startswith(b"\x89PNG")
