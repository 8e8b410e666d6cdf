"""Public names: tab completion and `import *`; representations of objects."""

import importlib
import subprocess
import sys

import gymnasium
import pytest
from helpers.errors import refused

import kitchen_suite
from kitchen_suite import suite
from kitchen_suite.gymnasium_env import FrankaOpenCabinetEnv
from kitchen_suite.vector_env import FrankaOpenCabinetVectorEnv

PUBLIC = (
    *("", ".suite", ".gymnasium_env", ".vector_env", ".environment", ".entities", ".tasks", ".policies", ".experts"),
    ".grasping",
)


@pytest.mark.parametrize("name", PUBLIC)
def test_public_names_exist(name):
    module = importlib.import_module(f"kitchen_suite{name}")
    assert set(module.__all__) <= set(dir(module))
    assert all(getattr(module, public) is not None for public in module.__all__)


@pytest.mark.parametrize("name", [".environment", ".entities", ".tasks", ".policies", ".experts"])
def test_names_that_a_package_imports_are_public(name):
    module = importlib.import_module(f"kitchen_suite{name}")
    imported = {key for key, value in vars(module).items() if key[0] != "_" and type(value) is not type(sys)}
    assert imported == set(module.__all__)


def test_tab_completion_offers_the_api_alone():
    assert set(dir(kitchen_suite)) == {*kitchen_suite.__all__, "__version__", "experts"}
    assert dir(suite) == sorted(suite.__all__)
    assert kitchen_suite.load is suite.load


def test_an_unknown_name_is_an_attribute_error():
    with refused(AttributeError, "'kitchen_suite'", "'kitchens'"):
        _ = kitchen_suite.kitchens


def test_asking_for_the_experts_without_mink_raises_no_import_error(monkeypatch):
    for name in ("mink", "kitchen_suite.experts", "kitchen_suite.policies.experts"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.delattr(kitchen_suite, "experts", raising=False)
    monkeypatch.setitem(sys.modules, "mink", None)
    assert not hasattr(kitchen_suite, "experts")


@pytest.mark.full
def test_submodules_are_imported_when_they_are_used():
    code = (
        "import sys, kitchen_suite\n"
        "assert kitchen_suite.suite.ALL_TASKS\n"
        "assert not {'dm_control', 'mujoco'} & sys.modules.keys()\n"
        "assert kitchen_suite.entities.PANDA"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.full
def test_environments_tasks_and_entities_say_what_they_are():
    kitchen = suite.load("kitchen", "mixed", {"visuals": False})
    task = "KitchenTask(tasks_to_complete=['microwave', 'kettle', 'bottom burner', 'light switch'])"
    assert repr(kitchen) == f"Environment({task}, control_timestep=0.08, step_limit=280)"
    assert repr(kitchen.task.scene.props["microwave"]) == "Microwave('microwave', joints=['microwave/microwave'])"
    cabinet = "OpenCabinetTask(drawer='bottom', reward='grasp')"
    env = FrankaOpenCabinetEnv("bottom", reward="grasp", max_episode_steps=9)
    assert repr(env) == f"FrankaOpenCabinetEnv({cabinet}, render_mode=None, max_episode_steps=9)"
    assert str(env) == gymnasium.Env.__str__(env)
    env = FrankaOpenCabinetVectorEnv(2, drawer="bottom", reward="grasp", num_threads=1)
    assert repr(env) == f"FrankaOpenCabinetVectorEnv({cabinet}, num_envs=2)"
