"""`kitchen-export`: a process with mujoco and numpy alone steps exported scenes exactly as the environments."""

import json
import os
import re
import subprocess
import sys

import gymnasium
import mujoco
import numpy as np
import pytest
from helpers.episodes import limited_files
from helpers.sweeps import brief_named

from kitchen_suite import suite
from kitchen_suite.commands import export
from kitchen_suite.gymnasium_env.base import suite_env

STEPS = 280
GROUPS = "start,layout,dynamics,sensing,appearance,camera"

# Steps the exported models with recorded controls; prints the greatest difference of each from the recorded states.
STEPPER = """
import sys

import mujoco
import numpy as np

recorded = np.load("recorded.npz")
start = np.load("scene/state.npz")["integration"]
for load, name in ((mujoco.MjModel.from_xml_path, "scene.xml"), (mujoco.MjModel.from_binary_path, "scene.mjb")):
    model = load(f"scene/{name}")
    data = mujoco.MjData(model)
    mujoco.mj_setState(model, data, start, mujoco.mjtState.mjSTATE_INTEGRATION)
    difference = 0.0
    for controls, state in zip(recorded["controls"], recorded["states"], strict=True):
        data.ctrl[:] = controls
        mujoco.mj_step(model, data, int(recorded["substeps"]))
        difference = max(difference, np.abs(np.concatenate([data.qpos, data.qvel]) - state).max())
    print(name, difference)
assert not [name for name in sys.modules if name.startswith(("dm_", "gymnasium", "kitchen_suite"))]
"""

# Distributions of one's own, as JSON.
DISTRIBUTIONS = {
    "cabinet/offset": {"uniform": [[-0.03, -0.05, 0.0], [0.03, 0.05, 0.0]]},
    "cabinet/yaw": {"uniform": [-0.1, 0.1]},
    "cabinet/drawer_top_friction": {"uniform": [2.5, 4.0]},
    "cabinet/drawer_top_damping": {"uniform": [10.0, 20.0]},
    "franka/pad_friction": {"uniform": [1.2, 1.8]},
}

# Arguments of the environment beside the domain: task, variations and seed.
CASES = {
    "kitchen": ("kitchen", {}, 0),
    "open_cabinet": ("open_cabinet", {}, 0),
    "microwave_table": ("microwave_table", {}, 0),
    "kitchens": ("kitchens", {"design": 4, "split": "test"}, 0),
    "kitchen varied": ("kitchen", {"variations": GROUPS}, 3),
    "open_cabinet varied": ("open_cabinet", {"variations": GROUPS}, 4),
    "microwave_table varied": ("microwave_table", {"variations": GROUPS, "variation_split": "held_out"}, 5),
    "kitchen sleep": ("kitchen", {"sleep": True}, 0),
    "kitchen return_kettle": ("kitchen", {"tasks_to_complete": ["return kettle", "close microwave"]}, 2**40),
    "kitchen ee_delta_pose": ("kitchen", {"control_mode": "ee_delta_pose"}, 1),
    "open_cabinet joint_delta": ("open_cabinet", {"control_mode": "joint_delta", "variations": "dynamics"}, 1),
    "open_cabinet distributions": ("open_cabinet", {"variations": DISTRIBUTIONS}, 1),
}


def record(folder, domain, arguments, seed):
    """Records the controls and states of an episode of random actions."""
    with gymnasium.make(suite.DOMAINS[domain].env_id, max_episode_steps=STEPS + 1, **arguments) as environment:
        environment.reset(seed=seed)
        inner = suite_env(environment).environment
        environment.action_space.seed(0)
        controls, states = [], []
        for _ in range(STEPS):
            environment.step(environment.action_space.sample().clip(-1.0, 1.0))
            data = inner.physics.data
            controls.append(data.ctrl.copy())
            states.append(np.concatenate([data.qpos, data.qvel]))
        substeps = inner.task.physics_steps_per_control_step
        np.savez(folder / "recorded.npz", controls=controls, states=states, substeps=substeps)


def variables():
    """Returns environment variables without the path of this checkout; those of an emulated processor are kept."""
    return {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}


def exported(*arguments):
    assert export.main(["--output=scene", *arguments]) == 0


@pytest.mark.full
@pytest.mark.parametrize(("domain", "arguments", "seed"), brief_named(CASES, ["microwave_table varied"]))
def test_mujoco_alone_steps_as_the_environment(domain, arguments, seed, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    exported(f"--domain_name={domain}", f"--seed={seed}", f"--task_kwargs={json.dumps(arguments)}")
    printed = capsys.readouterr().out
    record(tmp_path, domain, arguments, seed)
    output = subprocess.check_output([sys.executable, "-c", STEPPER], text=True, env=variables())
    differences = dict(line.split() for line in output.splitlines())
    assert float(differences["scene.mjb"]) == 0.0
    if "variations" not in arguments:
        assert float(differences["scene.xml"]) == 0.0
        assert "scene.xml: greatest difference: 0\n" in printed
    in_physics = re.search(r"greatest difference in physics: (\S+)", printed)[1]
    # Inverse inertias are computed by the compiler in one case, and kept in the other.
    assert float(in_physics) < 1e-12


@pytest.mark.full
def test_a_folder_describes_its_scene(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    values = {"microwave/damping_scale": 0.5, "franka/gain_scale": 1.2}
    exported("--domain_name=microwave_table", "--variations=dynamics", f"--variation_values={json.dumps(values)}")
    described = json.loads((tmp_path / "scene" / "scene.json").read_text())
    assert {name: described["variation_values"][name] for name in values} == values
    assert described["substeps"] * described["physics_timestep"] == pytest.approx(described["control_timestep"])
    assert described["task_name"] == "open"
    assert described["action"]["control_mode"] == "joint_offset"
    assert [len(described["action"]["elements"]), len(described["actuators"])] == [8, 9]
    assert "overview" in described["cameras"]
    assert "Permission is hereby granted" in (tmp_path / "scene" / "LICENSE-gymnasium-robotics.txt").read_text()
    assert {"scene.xml", "scene.mjb", "state.npz", "assets"} <= {path.name for path in (tmp_path / "scene").iterdir()}
    assert not [path for path in tmp_path.iterdir() if path.name != "scene"]

    # The page's code runs, with either file.
    page = (tmp_path / "scene" / "README.md").read_text()
    (block,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    for code in (block, block.replace("from_binary_path", "from_xml_path").replace("mjb", "xml")):
        printed = subprocess.check_output([sys.executable, "-c", code], text=True, cwd="scene", env=variables())
        assert printed.count("[") == 1

    changed = mujoco.MjModel.from_xml_path("scene/scene.xml")
    environment = suite.load("microwave_table", "open", {"visuals": False})
    built = environment.physics.model.ptr
    joint = "microwave/microwave"
    np.testing.assert_array_equal(changed.joint(joint).damping, 0.5 * built.joint(joint).damping)


def test_the_action_of_the_default_mode_follows_from_the_formula(tmp_path, monkeypatch):
    with gymnasium.make("KitchenSuite/FrankaKitchen-v1") as environment:
        observation, _ = environment.reset(seed=0)
        inner = suite_env(environment).environment
        mode = inner.task.mdp.action_mode
        low, high = (np.array(json.loads(text)) for text in re.findall(r"= (\[[^]]*\])", mode.formula))
        action = np.linspace(-1.2, 1.2, 9)
        environment.step(action)
        velocity = np.clip(np.clip(action, -1, 1) * mode.settings["velocity_scale"], -10, 10)
        expected = np.clip(observation["observation"][:9] + velocity * inner.control_timestep(), low, high)
        np.testing.assert_array_equal(inner.physics.data.ctrl, expected)


@pytest.mark.full
@pytest.mark.parametrize("domain", suite.DOMAINS)
def test_every_mode_has_a_formula(domain):
    task = suite.load(domain, suite.default_task(domain), {"visuals": False}).task
    assert all(make().formula for make in task.control_modes.values())


BAD = {
    "--task_name=nothing": ["'kitchen'", "'nothing'"],
    '--variation_values={"kettle/mass":1}': ["variation_values needs variations"],
    '--variations=dynamics --variation_values={"kettle/mas":1}': ["'kettle/mass'"],
    '--variations=dynamics --variation_values={"kettle/mass":-1}': ["kettle/mass", "-1"],
    "--control_mode=ee": ["control_mode", "'ee'"],
    "--output=file": ["file"],
    "--output=full": ["full"],
}


@pytest.mark.parametrize("arguments", BAD)
def test_bad_arguments_get_one_line_and_write_nothing(arguments, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "file").touch()
    assert export.main(["--output=scene", *arguments.split()]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert all(part in err for part in BAD[arguments]), err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "full"]


@pytest.mark.full
def test_a_failure_leaves_nothing(tmp_path, monkeypatch, capsys):
    def fail(root, built, live):
        raise OSError("disk full")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("kitchen_suite.adapters.mjcf.write_values", fail)
    assert export.main(["--output=scene", "--domain_name=microwave_table"]) == 1
    assert capsys.readouterr().err == "kitchen-export: disk full\n"
    assert not [*tmp_path.iterdir()]


@pytest.mark.full
def test_a_name_with_a_backslash_is_a_name_as_any_other(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert export.main(["--output=back\\slash/scene", "--domain_name=microwave_table"]) == 0
    assert [path.name for path in tmp_path.iterdir()] == ["back\\slash"]
    monkeypatch.chdir(tmp_path / "back\\slash" / "scene")
    assert mujoco.MjModel.from_xml_path("scene.xml").nq == mujoco.MjModel.from_binary_path("scene.mjb").nq


@pytest.mark.full
def test_a_full_disk_is_one_line_and_leaves_nothing(tmp_path, monkeypatch, capfd, caplog):
    monkeypatch.chdir(tmp_path)
    with limited_files(2**10):
        assert export.main(["--output=scene", "--domain_name=microwave_table"]) == 1
    # Outside pytest, records are further lines.
    assert (capfd.readouterr().err.count("\n"), caplog.records) == (1, [])
    assert not [*tmp_path.iterdir()]
