"""`import kitchen_suite.original`: programs for FrankaKitchen-v1 with one line changed, whoever is imported first."""

import json
import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from helpers.sweeps import brief

import kitchen_suite.original
from kitchen_suite.gymnasium_env import FrankaKitchenEnv
from kitchen_suite.vector_env import FrankaKitchenVectorEnv

ID = "FrankaKitchen-v1"
OURS, ROBOTICS = "import kitchen_suite.original", "import gymnasium_robotics"
IMPORTS = {
    "ours alone": [OURS],
    "the original first": [ROBOTICS, OURS],
    "ours first": [OURS, ROBOTICS],
    "ours first, then the suite's": [OURS, "import kitchen_suite", ROBOTICS],
    "the suite first": ["import kitchen_suite.gymnasium_env.kitchen", OURS, ROBOTICS],
    "registered as gymnasium's pages say": [ROBOTICS, OURS, "gymnasium.register_envs(gymnasium_robotics)"],
    "registered afterwards": [OURS, ROBOTICS, "gymnasium.register_envs(gymnasium_robotics)"],
    "twice": [OURS, "importlib.reload(kitchen_suite.original)"],
}
PROGRAM = """
env = gymnasium.make("FrankaKitchen-v1", tasks_to_complete=["microwave", "kettle"])
env.reset(seed=0)
env.step(env.action_space.sample())
print(json.dumps([type(env.unwrapped).__module__, env.spec.id, env.spec.max_episode_steps]))
"""


def run(code, *options):
    return subprocess.run(
        [sys.executable, *options, "-c", code], capture_output=True, text=True, timeout=300, check=False
    )


@pytest.mark.full
@pytest.mark.parametrize("imports", IMPORTS.values(), ids=IMPORTS)
def test_the_id_is_ours_without_a_warning_in_any_order(imports):
    # Gymnasium's warnings are UserWarnings; MuJoCo's window library has one of its own where there is no display.
    code = "\n".join(["import importlib, json, gymnasium", *imports, PROGRAM])
    result = run(code, "-W", "error", "-W", "ignore:.*DISPLAY.*")
    assert result.returncode == 0, result.stderr
    assert json.loads(result.stdout) == ["kitchen_suite.gymnasium_env.kitchen", ID, 280]
    assert not [line for line in result.stderr.splitlines() if "Adroit" not in line]


@pytest.mark.full
def test_importing_it_prints_nothing():
    result = run(OURS, "-W", "error", "-W", "ignore:.*DISPLAY.*")
    assert (result.returncode, result.stdout, result.stderr) == (0, "", "")


def test_the_other_ids_of_gymnasium_robotics_stay_its_own():
    entry_points = [
        spec.entry_point for name, spec in gymnasium.registry.items() if name.startswith(("Fetch", "Adroit"))
    ]
    assert len(entry_points) > 20
    assert all(entry_point.startswith("gymnasium_robotics") for entry_point in entry_points)


@pytest.mark.full
def test_the_id_takes_the_originals_arguments():
    arguments = {
        "tasks_to_complete": ["kettle", "light switch"],
        "terminate_on_tasks_completed": False,
        "remove_task_when_completed": False,
        "object_noise_ratio": 0.001,
        "robot_noise_ratio": 0.02,
        "max_episode_steps": 3,
        "render_mode": "rgb_array",
        "width": 64,
        "height": 64,
        "camera_name": "left_cap",
    }
    env = gymnasium.make(kitchen_suite.original.ID, **arguments)
    ours = env.unwrapped
    assert type(ours) is FrankaKitchenEnv
    assert list(ours.tasks_to_complete) == ["kettle", "light switch"]
    assert (ours.terminate_on_tasks_completed, ours.remove_task_when_completed) == (False, False)
    assert (ours.object_noise_ratio, ours.robot_env.robot_noise_ratio) == (0.001, 0.02)
    env.reset(seed=0)
    assert [env.step(np.zeros(9, np.float32))[3] for _ in range(3)] == [False, False, True]


@pytest.mark.full
def test_the_spec_is_the_originals():
    spec = gymnasium.spec(ID)
    assert (spec.max_episode_steps, spec.kwargs, spec.nondeterministic, spec.reward_threshold) == (280, {}, False, None)
    env = gymnasium.make(gymnasium.envs.registration.EnvSpec.from_json(gymnasium.make(ID).spec.to_json()))
    assert env.spec.id == ID


@pytest.mark.full
def test_the_id_is_the_suites_kitchen():
    envs = [gymnasium.make(name) for name in (ID, "KitchenSuite/FrankaKitchen-v1")]
    one, other = [env.reset(seed=5)[0]["observation"] for env in envs]
    np.testing.assert_array_equal(one, other)


@pytest.mark.full
@pytest.mark.parametrize("mode", brief([None, "sync", "async", "vector_entry_point"], ["sync", "vector_entry_point"]))
def test_vectors_are_made_of_it(mode):
    envs = gymnasium.make_vec(ID, 2, vectorization_mode=mode, tasks_to_complete=["kettle"])
    observation, _ = envs.reset(seed=0)
    single, _ = gymnasium.make(ID, tasks_to_complete=["kettle"]).reset(seed=1)
    np.testing.assert_array_equal(observation["observation"][1], single["observation"])
    assert isinstance(envs, FrankaKitchenVectorEnv) == (mode in (None, "vector_entry_point"))
    if mode in ("sync", "async"):
        assert envs.get_attr("tasks_to_complete") == ({"kettle"}, {"kettle"})
        assert envs.get_attr("dt") == (0.08, 0.08)
    envs.close()
