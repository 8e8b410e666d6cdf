"""Scaling is measured in all its cells, in a fraction of a second each."""

import contextlib
import json
import os
import subprocess
import sys

import mujoco
import numpy as np
import pytest
from docs_scripts import DOCS, load_script

from kitchen_suite.environment import INTEGRATION_STATE
from kitchen_suite.vector_env.kitchen import FrankaKitchenVectorEnv

pytestmark = pytest.mark.full

FLAGS = ("--num_envs=1,3", "--num_threads=1,2", "--rounds=2", "--minutes=0.01")
KINDS = ("kitchen: vectorised", "kitchen: vectorised, fast physics", "open_cabinet: vectorised")


@pytest.fixture(scope="module")
def scaling():
    return load_script("experiments/scaling")


@pytest.fixture(scope="module")
def tables():
    return load_script("experiments/benchmark_tables")


def read(folder):
    return json.loads((folder / "scaling.json").read_text("utf-8"))


@pytest.mark.nightly
def test_every_kind_is_measured_with_all_numbers_of_environments_and_threads(tables, tmp_path):
    command = [sys.executable, str(DOCS / "experiments" / "scaling.py"), *FLAGS, f"--output={tmp_path}"]
    # Without a GL library there are no pictures.
    variables = {**os.environ, "MUJOCO_GL": "disable"}
    printed = subprocess.check_output(command, env=variables, text=True, stderr=subprocess.DEVNULL)
    results = read(tmp_path)
    rows = {(row["vector_env"], row["num_envs"], row["num_threads"]): row for row in results["results"]}
    ours = [key for key in rows if "EnvPool" not in key[0]]
    assert ours == [(kind, count, threads) for kind in KINDS for count in (1, 3) for threads in (1, 2)]
    for key in ours:
        row = rows[key]
        assert row["steps_per_second"] > 1
        assert row["reset"] > 0
        assert row["of_bare"] > 0
        # A further environment takes some memory, but no second model.
        assert -20 < row["memory"] < 20
        if row["num_threads"] == 1:
            assert row["efficiency"] == row["bare_efficiency"] == 1.0
    assert results["machine"]["processors"] >= 1
    assert {"python", "mujoco", "dm-control", "numpy"} <= results["versions"].keys()
    for text in (printed, tables.markdown(results)):
        assert len([line for line in text.splitlines() if line.strip("| ").startswith(KINDS)]) == len(ours)
        assert results["machine"]["processor"] in text


@pytest.mark.rendering
def test_pictures_are_measured_where_there_is_a_gl_library(scaling, tmp_path, monkeypatch):
    monkeypatch.setattr(scaling, "MEASURED", {})
    monkeypatch.setattr(scaling, "PIXEL_ENVS", 2)
    scaling.main([*FLAGS, f"--output={tmp_path}"])
    (row,) = read(tmp_path)["results"]
    assert "pixels" in row["vector_env"]
    assert row["steps_per_second"] > 0
    assert row["of_bare"] is None


def test_threads_are_the_powers_of_two_and_all_processors(scaling):
    counts = {count: scaling.thread_counts(count) for count in (1, 2, 6, 8)}
    assert counts == {1: (1,), 2: (1, 2), 6: (1, 2, 4, 6), 8: (1, 2, 4, 8)}


def test_ratios_are_taken_within_rounds(scaling):
    two = [scaling.Visit(rate, reset=1.0) for rate in (100.0, 400.0, 900.0)]
    one = [scaling.Visit(rate, reset=1.0) for rate in (100.0, 200.0, 600.0)]
    assert scaling.median_ratio(two, one) == 1.5
    assert scaling.efficiency(two, one, 2) == 0.75
    assert scaling.efficiency(two, [], 2) is None


@pytest.mark.parametrize("physics", ["exact", "fast"])
def test_the_bare_batch_makes_the_environments_physics_steps(scaling, physics):
    """Without noise, the environments' positions are those of the bare batch, with the same actions."""
    options = {"robot_noise_ratio": 0.0, "object_noise_ratio": 0.0, "physics": physics}
    environments = FrankaKitchenVectorEnv(3, num_threads=1, terminate_on_tasks_completed=False, **options)
    domain = scaling.DOMAINS["kitchen"]
    with contextlib.closing(environments):
        environments.reset(seed=0)
        with contextlib.closing(scaling.BareBatch(environments, 1, domain.control)) as bare:
            bare.reset()
            actions = domain.draw_actions(np.random.default_rng(0), (4, 3))
            for action in actions:
                environments.step(action)
                bare.step(action)
            own = environments.physics_state
            model = environments.template_env.environment.physics.model.ptr
            data = mujoco.MjData(model)
            for i, state in enumerate(own):
                mujoco.mj_setState(model, data, bare.states[i], INTEGRATION_STATE)
                np.testing.assert_array_equal(np.concatenate([data.qpos, data.qvel, data.act]), state)
