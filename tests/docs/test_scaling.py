"""Scaling is measured in all its cells, in a fraction of a second each; a world of C stands in for MuJoCo Warp's."""

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


class CWorlds:
    """Worlds of MuJoCo's C library, with the interface of `warp_worlds.WarpWorlds`; `shift` is added to positions."""

    compile_seconds = 0.0

    def __init__(self, model, demonstration, count, shift=0.0):
        self._model = model
        self._substeps = demonstration.substeps
        self._worlds = [mujoco.MjData(model) for _ in range(count)]
        self._shift = shift

    def set(self, states):
        for data, qpos, qvel, warmstart in zip(self._worlds, *states, strict=True):
            mujoco.mj_resetData(self._model, data)
            data.qpos[:] = qpos
            data.qvel[:] = qvel
            data.qacc_warmstart[:] = warmstart

    def load(self, controls):
        return controls

    def step_loaded(self, controls):
        self.step(controls)

    def synchronize(self):
        pass

    def step(self, controls):
        for data, ctrl in zip(self._worlds, controls, strict=True):
            data.ctrl[:] = ctrl
            mujoco.mj_step(self._model, data, self._substeps)

    def qpos(self):
        return np.array([data.qpos for data in self._worlds]) + self._shift


@pytest.fixture(scope="module")
def demonstrated():
    module = load_script("experiments/warp_worlds")
    return module, module.record(), module.exported_model()


def test_worlds_of_c_agree_with_c_and_complete_the_experts_tasks(demonstrated):
    module, demonstration, model = demonstrated
    worlds = CWorlds(model, demonstration, 2)
    compared = module.agreement(model, demonstration, worlds, 2, 5)
    assert {each["greatest"] for each in compared.values()} == {0.0}
    played = module.open_loop(demonstration, worlds, 2)
    assert {*played["completed"].values()} == {2}
    assert len(played["completed"]) == 4
    assert played["kettle_distance"] < 0.01
    assert module.throughput(demonstration, worlds, 2, 0.1) > 1


def test_worlds_that_differ_from_c_do_not_agree(demonstrated):
    module, demonstration, model = demonstrated
    worlds = CWorlds(model, demonstration, 2, shift=0.25)
    compared = module.agreement(model, demonstration, worlds, 2, 3)
    for each in compared.values():
        assert each["median"] == pytest.approx(0.25)
    assert module.open_loop(demonstration, worlds, 2)["kettle_distance"] > 0.25


def test_results_of_warp_have_tables(tables):
    results = {
        "measure": "warp",
        "command": "scaling.py --warp",
        "device": "NVIDIA Example",
        "machine": {"processor": "Example", "processors": 4, "load_before": 0.5},
        "versions": {"mujoco": "3"},
        "results": [{"worlds": 256, "steps_per_second": 250_000.0, "compile_seconds": 30.0}],
        "agreement": {"robot": {"median": 1e-7, "greatest": 2e-6}},
        "open_loop": {"worlds": 256, "control_steps": 9, "completed": {"kettle": 255}, "kettle_distance": 0.0123},
    }
    for text in (tables.plain(results), tables.markdown(results)):
        for shown in ("250000", "30.0", "2.0e-06", "255 of 256", "0.0123", "NVIDIA Example, 4 processors Example"):
            assert shown in text
