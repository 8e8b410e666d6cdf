"""A person's commands: the hand goes where it is told to, in every control mode of every domain."""

import numpy as np
import pytest
from helpers.errors import refused
from helpers.sweeps import brief

from kitchen_suite import suite
from kitchen_suite.policies.experts.teleoperation import TeleoperatedPolicy, Teleoperation

TASKS = {
    **{"kitchen": "kettle", "microwave_table": "open", "open_cabinet": "top_drawer", "kitchens": "open"},
    "pick_and_place": "put_on",
}
MODES = [(domain, mode) for domain in TASKS for mode in suite.DOMAINS[domain].resolve("expert").control_modes]
QUICK = [("kitchen", "joint_velocity"), ("microwave_table", "ee_pose"), ("open_cabinet", "joint_offset")]

SECONDS = 3.0


def started(domain="kitchen", **arguments):
    """An environment, a person's policy that has seen its start, and the first time step."""
    environment = suite.load(domain, TASKS[domain], {"visuals": False, "random": 0, **arguments})
    policy, timestep = TeleoperatedPolicy(environment.task), environment.reset()
    policy.observe(timestep)
    return environment, policy, timestep


def play(environment, policy, timestep, seconds=SECONDS):
    """Acts for some time; returns the last time step, and shows it to the policy."""
    for _ in range(round(seconds / environment.control_timestep())):
        timestep = environment.step(policy(timestep))
    policy.observe(timestep)
    return timestep


def angle(one, other):
    return 2 * np.arccos(min(1.0, abs(one @ other)))


@pytest.mark.full
@pytest.mark.parametrize(("domain", "mode"), brief(MODES, QUICK))
def test_the_hand_goes_where_it_is_told_to(domain, mode):
    environment, policy, timestep = started(domain, control_mode=mode)
    arm = policy.arm
    start, orientation = arm.hand
    for _ in range(5):
        arm.nudge([0.0, 0.01, 0.02], [0.0, 0.0, 0.04])
    play(environment, policy, timestep)
    (place, turned), (position, rotation) = arm.command, arm.hand
    assert np.linalg.norm(place - start) == pytest.approx(np.hypot(0.05, 0.1))
    assert np.linalg.norm(position - place) < 0.005
    assert angle(turned, orientation) == pytest.approx(0.2)
    # One mode has no turns.
    assert mode == "ee_delta_position" or angle(rotation, turned) < 0.02


@pytest.mark.full
def test_the_hand_stays_until_it_is_told_to_move():
    environment, policy, timestep = started()
    arm = policy.arm
    assert arm.is_idle
    assert arm.command is None
    start, _ = arm.hand
    timestep = play(environment, policy, timestep)
    assert np.linalg.norm(arm.hand[0] - start) < 0.005
    arm.nudge([0.0, 0.0, 0.14])
    assert not arm.is_idle
    for _ in range(3):
        timestep = environment.step(policy(timestep))
    arm.hold()
    assert arm.is_idle
    play(environment, policy, timestep)
    assert np.linalg.norm(arm.hand[0] - start) < 0.12


@pytest.mark.full
def test_a_nudge_is_in_the_frame_of_the_base():
    _, policy, _ = started("open_cabinet")
    environment, arm = suite.load("open_cabinet", "top_drawer"), policy.arm
    environment.reset()
    base = environment.physics.bind(environment.task.robot.mjcf_model.find("body", "link0"))
    axes, (start, _) = np.reshape(base.xmat, (3, 3)), arm.hand
    for axis in range(3):
        arm.hold()
        arm.nudge(0.02 * np.eye(3)[axis])
        np.testing.assert_allclose(arm.command[0] - start, 0.02 * axes[:, axis], atol=1e-9)


def test_commands_stay_near_the_hand():
    _, policy, _ = started()
    for _ in range(50):
        policy.arm.nudge([0.0, 0.0, 0.03])
    assert np.linalg.norm(policy.arm.command[0] - policy.arm.hand[0]) == pytest.approx(0.15)


@pytest.mark.full
def test_the_fingers_close_and_open():
    environment, policy, timestep = started()
    widths = []
    for close in (False, True, False):
        policy.arm.grasp(close)
        timestep = play(environment, policy, timestep, 1.5)
        widths.append(timestep.observation["franka/joint_positions"][7:].sum())
    assert widths[1] < 0.02 < 0.05 < min(widths[0], widths[2])


def test_the_speed_is_limited():
    environment, policy, timestep = started(control_mode="ee_delta_pose")
    arm, (start, orientation) = policy.arm, policy.arm.hand
    arm.move_to(start + np.array([0.0, 0.0, 0.3]), orientation)
    play(environment, policy, timestep, 0.8)
    assert 0.05 < arm.hand[0][2] - start[2] < 0.8 * 0.3


def test_labels_say_that_a_person_acts():
    _environment, policy, timestep = started()
    action = policy(timestep)
    assert policy.labels["is_intervention"] is True
    np.testing.assert_array_equal(policy.labels["teleop_action"], action)


def test_it_acts_where_layouts_vary_whatever_is_observed():
    environment, policy, timestep = started(variations=["layout"])
    assert play(environment, policy, timestep, 0.2) is not None


@pytest.mark.full
@pytest.mark.parametrize(
    ("position", "orientation", "shown"),
    [([0, 0], [1, 0, 0, 0], "position"), ([0, 0, np.nan], [1, 0, 0, 0], "finite"), ([0, 0, 1], [0, 0, 0, 0], "zero")],
)
def test_a_bad_pose_is_named(position, orientation, shown):
    arm = Teleoperation.for_task(suite.load("kitchen", "kettle").task)
    with refused(ValueError, shown):
        arm.move_to(position, orientation)
