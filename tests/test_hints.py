"""Errors name the likely intent: names in other spellings, forms that another flag takes, missing extras."""

import importlib.metadata
import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import gymnasium
import pytest
from helpers.errors import refused
from packaging.requirements import Requirement

from kitchen_suite import checks, installation, policies, suite
from kitchen_suite.commands import NAMES, evaluate, find, record, rollout, train
from kitchen_suite.datasets.formats import FORMATS
from kitchen_suite.datasets.minari import check_id
from kitchen_suite.evaluation.protocols import PROTOCOLS
from kitchen_suite.gymnasium_env import KITCHEN_ID
from kitchen_suite.gymnasium_env.renderer import RENDER_MODES
from kitchen_suite.physics_names import PHYSICS
from kitchen_suite.policies.trained import SHIPPED
from kitchen_suite.tasks import GOALS
from kitchen_suite.training.recipes import ALGORITHMS

ROOT = Path(__file__).resolve().parent.parent

ENVIRONMENTS = {domain: suite.find_domain(domain).env_class for domain in suite.DOMAINS}

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
    "shipped policy": [path.stem for path in SHIPPED.glob("*.npz")],
    "preset": suite.find_domain("kitchen").resolve("recording"),
    "command": NAMES,
    "camera": ["left_cap", "right_cap", "franka/hand", "franka/wrist", "overview", "workspace"],
    **{f"task of {domain.name}": domain.tasks for domain in suite.DOMAINS.values()},
    **{f"obs_type of {domain}": env.obs_types for domain, env in ENVIRONMENTS.items()},
    **{f"control mode of {name}": suite.find_domain(name).resolve("task").control_modes for name in suite.DOMAINS},
    **{f"flag of {name}": [*find(name).flags()] for name in NAMES},
}


def spellings(name):
    """Returns a name in upper case and in title case, with each mark between words."""
    marks = [re.sub(r"[-_ /]", mark, name) for mark in "-_ /"]
    return {text for mark in marks for text in (mark, mark.upper(), mark.title(), f" {mark}")} - {name}


@pytest.mark.parametrize("kind", CHOICES)
def test_a_name_in_another_spelling_is_suggested(kind):
    for name in CHOICES[kind]:
        for spelling in spellings(name):
            with refused(ValueError, f"did you mean {name!r}"):
                checks.choice(spelling, CHOICES[kind], kind)


# Arguments of commands, and the flag or value that the error suggests.
MEANT = [
    (rollout, "--domain_name=Open-Cabinet", "open_cabinet"),
    (rollout, "--task_name=Light-Switch", "light_switch"),
    (rollout, "--control_mode=EE-Delta-Pose", "ee_delta_pose"),
    (rollout, "--physics=Fast", "fast"),
    (rollout, "--render_quality=HIGH", "high"),
    (rollout, "--variation_split=held-out", "held_out"),
    (rollout, "--variations=Start", "start"),
    (rollout, "--policy=Expert", "expert"),
    (rollout, "--Num-Episodes=3", "--num_episodes"),
    (evaluate, "--protocol=D4RL", "d4rl"),
    (evaluate, "--protocol=diffusion_policy", "diffusion-policy"),
    (record, "--preset=Random-Order", "random_order"),
    (train, "--algorithm=PPO", "ppo"),
    (rollout, '--task_kwargs={"obs_type": "Pixels-Agent-Pos"}', "pixels_agent_pos"),
    # A domain in place of a task, and the reverse.
    (rollout, "--task_name=open_cabinet", "domain 'open_cabinet' and one of its tasks, ['top_drawer'"),
    (rollout, "--task_name=Open-Cabinet", "domain 'open_cabinet'"),
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
    others = [] if command in (rollout, evaluate) else ["--output=runs"]
    assert meant in refusal(command, argument, *others)
    assert not [*folder.iterdir()]


def test_names_of_datasets_and_formats_are_suggested():
    with refused(ValueError, "me/demos-v0"):
        check_id("me/demos")
    with refused(ValueError, "did you mean 'lerobot'"):
        checks.choice("LeRobot", FORMATS, "format")


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


@pytest.mark.parametrize("name", ARGUMENTS)
@pytest.mark.parametrize("make", [gymnasium.make, gymnasium.make_vec])
def test_an_argument_of_another_library_is_answered_with_the_suites(make, name):
    with refused(TypeError, f"did you mean {ARGUMENTS[name]!r}"):
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
    import {module}
except ImportError as error:
    print(error)
{name}
"""
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=100, check=False)
    assert result.returncode == 1
    assert package in result.stdout
    assert f"[{extra}]" in result.stdout
    if extra == "experts":
        assert "AttributeError" in result.stderr
        assert f"[{extra}]" in result.stderr.splitlines()[-1]


@pytest.mark.parametrize(("version", "said"), [((3, 11, 7), True), ((3, 12, 1), False)])
def test_an_extra_for_newer_pythons_says_so(monkeypatch, version, said):
    monkeypatch.setattr(sys, "version_info", version)
    assert ("Python 3.12" in installation.install_command("lerobot")) is said
    assert "Python" not in installation.install_command("video")


def pip_requirement(extra="video"):
    """Returns what the command of a message makes pip install, and whether it can be edited there."""
    program, verb, *options, requirement = shlex.split(installation.install_command(extra))
    assert (program, verb) == ("pip", "install")
    return requirement, options


def record_source(monkeypatch, folder, source):
    """Puts what pip records of an installed suite, and of the `source` it came from, in front of the real record."""
    record = folder / "kitchen_suite-9.9.dist-info"
    record.mkdir()
    record.joinpath("METADATA").write_text("Metadata-Version: 2.1\nName: kitchen-suite\nVersion: 9.9\n")
    if source:
        record.joinpath("direct_url.json").write_text(json.dumps(source))
    monkeypatch.syspath_prepend(str(folder))
    assert importlib.metadata.version("kitchen-suite") == "9.9"


@pytest.mark.parametrize("editable", [False, True])
def test_in_the_checkout_the_command_installs_its_folder(monkeypatch, tmp_path, editable):
    record_source(monkeypatch, tmp_path, {"url": ROOT.as_uri(), "dir_info": {"editable": editable}})
    monkeypatch.chdir(ROOT)
    assert pip_requirement() == (".[video]", [])


@pytest.mark.parametrize("editable", [False, True])
def test_elsewhere_the_command_installs_the_same_folder(monkeypatch, tmp_path, folder, editable):
    record_source(monkeypatch, tmp_path, {"url": ROOT.as_uri(), "dir_info": {"editable": editable}})
    requirement, options = pip_requirement()
    path, extra = requirement[:-1].split("[")
    assert Path(path) == ROOT
    assert extra == "video"
    assert options == ["-e"] * editable


SOURCES = [
    (None, "kitchen-suite[video]"),
    (
        {"url": "https://me.org/suite.git", "vcs_info": {"vcs": "git", "commit_id": "c0ffee"}},
        "kitchen-suite[video] @ git+https://me.org/suite.git@c0ffee",
    ),
    ({"url": "file:///home/me/s-1.whl", "archive_info": {}}, "kitchen-suite[video] @ file:///home/me/s-1.whl"),
    ({"url": "file:///home/me/my%20suite", "dir_info": {}}, "/home/me/my suite[video]"),
]


@pytest.mark.parametrize(("source", "requirement"), SOURCES)
def test_an_installed_suite_names_where_it_came_from(monkeypatch, tmp_path, source, requirement):
    record_source(monkeypatch, tmp_path, source)
    if not source:  # The code is in site-packages, not in a checkout.
        monkeypatch.setattr(installation, "__file__", str(tmp_path / "kitchen_suite" / "checks.py"))
    found, options = pip_requirement()
    assert (found, options) == (requirement, [])
    if not requirement.startswith("/"):
        assert Requirement(found).extras == {"video"}
