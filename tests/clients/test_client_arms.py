"""The examples of other arms: the Panda of gym-hil and the UR5e of OGBench in the kitchen."""

import numpy as np
import pytest
from docs_scripts import load_script
from helpers.episodes import play_expert

from kitchen_suite import suite

pytestmark = pytest.mark.clients

# The record of each example, and the prefix of the pads of its hand.
RECORDS = {"panda": ("PANDA_2F85", ""), "ur5e": ("UR5E", "robotiq_2f85/")}
ARMS = pytest.mark.parametrize("robot", RECORDS)


def load(robot, task="kettle", mode="ee_delta_pose"):
    spec = getattr(load_script(f"examples/{robot}"), RECORDS[robot][0])
    return suite.load("kitchen", task, {"robot": spec, "control_mode": mode, "random": 0, "visuals": False})


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


@ARMS
@pytest.mark.parametrize("mode", ["ee_delta_pose", "ee_pose", "ee_delta_position"])
def test_the_expert_opens_the_microwave(robot, mode):
    assert play_expert(load(robot, "microwave", mode))["success"]


@ARMS
def test_the_hand_opens_and_closes(robot):
    environment = load(robot)
    environment.reset()
    model, prefix = environment.task.robot.mjcf_model, RECORDS[robot][1]
    pads = [environment.physics.bind(model.find("geom", f"{prefix}{side}_pad1")) for side in ("left", "right")]
    widths = []
    for gripper in (1.0, -1.0):
        for _ in range(15):
            environment.step(np.array([0, 0, 0, 0, 0, 0, gripper]))
        widths.append(np.linalg.norm(np.subtract(*(pad.xpos for pad in pads))))
    # The pads, each 8 mm thick, touch, and are 85 mm apart.
    np.testing.assert_allclose(widths, [0.009, 0.093], atol=0.003)
