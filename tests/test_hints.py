"""Errors name the likely intent: names in other spellings, forms that another flag takes, missing extras."""

import re
import subprocess
import sys
from pathlib import Path

import gymnasium
import pytest
from helpers.errors import refused

from kitchen_suite import checks, installation, policies, suite
from kitchen_suite.commands import NAMES, evaluate, rollout
from kitchen_suite.datasets.formats import FORMATS
from kitchen_suite.datasets.minari import check_id
from kitchen_suite.evaluation.protocols import PROTOCOLS
from kitchen_suite.gymnasium_env import KITCHEN_ID
from kitchen_suite.gymnasium_env.renderer import RENDER_MODES
from kitchen_suite.physics_names import PHYSICS
from kitchen_suite.tasks import GOALS
from kitchen_suite.training.recipes import ALGORITHMS

ROOT = Path(__file__).resolve().parent.parent

# All that is chosen by name.
CHOICES = {
    "domain": suite.DOMAINS,
    "protocol": PROTOCOLS,
    "format": FORMATS,
    "algorithm": ALGORITHMS,
    "policy": policies.POLICIES,
    "physics": PHYSICS,
    "render mode": RENDER_MODES,
    "goal": GOALS,
    "command": NAMES,
    **{f"task of {domain.name}": domain.tasks for domain in suite.DOMAINS.values()},
    **{f"obs_type of {name}": domain.env_class.obs_types for name, domain in suite.DOMAINS.items()},
    **{f"control mode of {name}": domain.resolve("task").control_modes for name, domain in suite.DOMAINS.items()},
}


def test_a_name_in_another_spelling_is_suggested():
    names = ["left_cap", "franka/hand", "light switch", "unseen-kitchens", "d4rl"]
    for name in names:
        for mark in "-_ /":
            text = re.sub(r"[-_ /]", mark, name)
            for spelling in {text, text.upper(), text.title(), f" {text}"} - {name}:
                with refused(ValueError, f"did you mean {name!r}"):
                    checks.choice(spelling, names, "name")


def test_no_two_choices_are_spellings_of_one_name():
    for kind, names in CHOICES.items():
        assert [checks.same_name(name, names) for name in names] == [*names], kind


# Arguments of commands, and the flag or value that the error suggests.
MEANT = [
    (rollout, "--domain_name=Open-Cabinet", "open_cabinet"),
    (rollout, "--task_name=Light-Switch", "light_switch"),
    (rollout, "--physics=Fast", "fast"),
    (rollout, "--variations=Start", "start"),
    (rollout, "--policy=Expert", "expert"),
    (rollout, "--Num-Episodes=3", "--num_episodes"),
    (evaluate, "--protocol=diffusion_policy", "diffusion-policy"),
    (rollout, '--task_kwargs={"obs_type": "Pixels-Agent-Pos"}', "pixels_agent_pos"),
    # A domain in place of a task, and the reverse.
    (rollout, "--task_name=open_cabinet", "domain 'open_cabinet' and one of its tasks, ['top_drawer'"),
    (rollout, "--domain_name=top_drawer", "domain 'open_cabinet'"),
    # Several tasks in place of one.
    (rollout, "--task_name=kettle,microwave", '{"tasks_to_complete": ["kettle", "microwave"]}'),
    (rollout, "--task_name=light switch + kettle", '{"tasks_to_complete": ["light switch", "kettle"]}'),
    # Policies.
    (rollout, "--policy=my_bc.py:act", "my_bc:act"),
    (rollout, "--policy=my_bc.py", "my_bc:NAME"),
    (rollout, "--policy=./mine/my_bc.py:act", "mine.my_bc:act"),
    (rollout, "--policy=/home/me/my_bc.py:act", "my_bc:act, from the folder"),
    (rollout, "--domain_name=my_task.py:DOMAIN", "my_task:DOMAIN"),
    (rollout, "--policy=localhost:8000", "ws://localhost:8000"),
    (rollout, "--policy=10.0.0.7:8000", "ws://10.0.0.7:8000"),
    (rollout, "--policy=http://localhost:8000", "ws://localhost:8000"),
    (rollout, "--policy=https://me.org/policy", "wss://me.org/policy"),
    (rollout, "--policy=bc.npz", "bc.npz"),
    (rollout, "--policy=trained:bc.npz", "write bc.npz"),
    (rollout, "--policy=expert:speed=0.8", "expert(speed=0.8)"),
]


@pytest.mark.parametrize(("command", "argument", "meant"), MEANT, ids=[argument for _, argument, _ in MEANT])
def test_what_a_user_meant_is_said(folder, refusal, command, argument, meant):
    assert meant in refusal(command, argument)
    assert not [*folder.iterdir()]


def test_names_of_datasets_are_suggested():
    with refused(ValueError, "me/demos-v0"):
        check_id("me/demos")


# Suggestions, as they are then written.
FOLLOWED = [
    ["--domain_name=open_cabinet", "--task_name=top_drawer"],
    ["--task_name=kettle", '--task_kwargs={"tasks_to_complete": ["kettle", "microwave"]}'],
    ["--policy=my_bc:act"],
    ["--policy=mine.my_bc:act"],
]


@pytest.mark.full
@pytest.mark.parametrize("arguments", FOLLOWED, ids=" ".join)
def test_what_is_suggested_works(folder, run, monkeypatch, arguments):
    folder.joinpath("mine").mkdir()
    for path in ("my_bc.py", "mine/my_bc.py"):
        folder.joinpath(path).write_text("import numpy as np\n\n\ndef act(timestep):\n    return np.zeros(9)\n")
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.delitem(sys.modules, "my_bc", raising=False)
    assert run(rollout, "--num_episodes=1", "--max_episode_steps=2", *arguments)[0] == 0


# Arguments of other libraries, and those of the suite.
ARGUMENTS = {
    "max_steps": "max_episode_steps",
    "max_episode_length": "max_episode_steps",
    "horizon": "max_episode_steps",
    "Max-Episode-Steps": "max_episode_steps",
    "controller": "control_mode",
    "obs_mode": "obs_type",
    "camera_names": "cameras",
}


@pytest.mark.parametrize("make", [gymnasium.make, gymnasium.make_vec])
def test_an_argument_of_another_library_is_answered_with_the_suites(make):
    for name, meant in ARGUMENTS.items():
        with refused(TypeError, f"did you mean {meant!r}"):
            make(KITCHEN_ID, **{name: 5})


def test_in_dm_control_the_length_of_an_episode_is_a_time_limit():
    with refused(TypeError, "did you mean 'time_limit'"):
        suite.load("kitchen", "kettle", {"max_steps": 5})


MISSING_EXTRAS = {
    "kitchen_suite.experts.make_policy": ("mink", "experts"),
    "kitchen_suite.lerobot.make_env": ("lerobot", "lerobot"),
}


@pytest.mark.full
@pytest.mark.parametrize("name", MISSING_EXTRAS)
def test_what_needs_an_extra_names_it(name):
    package, extra = MISSING_EXTRAS[name]
    module = name.rpartition(".")[0]
    code = f"""
import sys
sys.modules[{package!r}] = None
import kitchen_suite
assert not hasattr(kitchen_suite, "experts") or {extra!r} != "experts"
try:
    from {module} import {name.rpartition(".")[2]}
except ImportError as error:
    print(error)
{name}
"""
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=100, check=False)
    assert result.returncode == 1
    assert package in result.stdout
    assert f"[{extra}]" in result.stdout
    assert ("AttributeError" in result.stderr) is (extra == "experts")
    assert extra != "experts" or f"[{extra}]" in result.stderr.splitlines()[-1]


@pytest.mark.parametrize(("version", "said"), [((3, 11, 7), True), ((3, 12, 1), False)])
def test_an_extra_for_newer_pythons_says_so(monkeypatch, version, said):
    monkeypatch.setattr(sys, "version_info", version)
    assert ("Python 3.12" in installation.install_command("lerobot")) is said
    assert installation.install_command("video") == "pip install 'kitchen-suite[video]'"
