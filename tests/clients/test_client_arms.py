"""The Panda of gym-hil and the UR5e of OGBench in the kitchen."""

import itertools
import json
import re

import numpy as np
import pytest
from helpers.episodes import play_expert
from helpers.sweeps import brief

from kitchen_suite import suite
from kitchen_suite.commands import find

pytestmark = pytest.mark.clients

ARMS = pytest.mark.parametrize("robot", ["panda", "ur5e"])


def load(robot, task="kettle", mode="ee_delta_pose", **options):
    arguments = {"robot": robot, "control_mode": mode, "random": 0, "visuals": False, **options}
    return suite.load("kitchen", task, arguments)


def hand_of(environment):
    environment.reset()
    site = environment.physics.bind(environment.task.robot.end_effector)
    return np.array(site.xpos), np.array(site.xmat)


@ARMS
def test_the_hand_starts_where_the_frankas_does(robot):
    franka = suite.load("kitchen", "kettle", {"random": 0, "visuals": False})
    (position, rotation), (expected, turned) = hand_of(load(robot)), hand_of(franka)
    np.testing.assert_allclose(position, expected, atol=1e-3)
    np.testing.assert_allclose(rotation, turned, atol=5e-3)


@pytest.mark.parametrize(
    ("robot", "mode"),
    brief(
        itertools.product(("panda", "ur5e"), ("ee_delta_pose", "ee_pose", "ee_delta_position")),
        [("panda", "ee_delta_pose"), ("ur5e", "ee_pose"), ("panda", "ee_delta_position")],
    ),
)
def test_the_expert_pushes_the_kettle_and_opens_the_microwave(robot, mode):
    for task in ("kettle", "microwave"):
        assert play_expert(load(robot, task, mode))["success"], task


@ARMS
def test_the_expert_plans_in_a_layout_that_has_moved(robot):
    observed = [f"{robot}/base_pose", "microwave/pose"]
    environment = load(robot, "microwave", "ee_delta_position", variations=["layout"], extra_observables=observed)
    assert sum(play_expert(environment)["success"] for _ in range(3)) >= 2


@ARMS
def test_the_hand_opens_and_closes(robot):
    environment = load(robot)
    environment.reset()
    pads = [environment.physics.bind(environment.task.robot.mjcf_model.find("geom", name)) for name in pads_of(robot)]
    widths = []
    for gripper in (1.0, -1.0):
        for _ in range(15):
            environment.step(np.array([0, 0, 0, 0, 0, 0, gripper]))
        widths.append(np.linalg.norm(np.subtract(*(pad.xpos for pad in pads))))
    # The pads, each 8 mm thick, touch, and are 85 mm apart.
    np.testing.assert_allclose(widths, [0.009, 0.093], atol=0.003)


def pads_of(robot):
    return [f"{'' if robot == 'panda' else 'robotiq_2f85/'}{side}_pad1" for side in ("left", "right")]


@pytest.mark.parametrize("robot", brief(["panda", "ur5e"], ["ur5e"]))
def test_episodes_are_recorded_replayed_and_evaluated(robot, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    arguments = json.dumps({"robot": robot, "control_mode": "ee_delta_pose"})
    common = ["--domain_name=kitchen", "--task_name=kettle", "--policy=expert", f"--task_kwargs={arguments}"]
    assert find("record").main([*common, "--num_episodes=2", "--output=episodes"]) == 0
    assert find("replay").main(["episodes"]) == 0
    assert find("evaluate").main([*common, "--protocol=default", "--num_episodes=2", "--output=result"]) == 0
    assert re.search(r"^kettle +100\.0 %", capsys.readouterr().out, re.MULTILINE)
