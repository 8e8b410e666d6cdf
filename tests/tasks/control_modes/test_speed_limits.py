"""At the borders of the workspace, hand and joints stay within their limits of speed; slow steps are unchanged."""

import gymnasium
import numpy as np
import pytest
from helpers.sweeps import walk
from helpers.vectors import many, part

from kitchen_suite import suite
from kitchen_suite.tasks.control_modes import speed_limits


def load(domain, **settings):
    settings = {"random": 0, "visuals": False, "control_mode": "ee_delta_position", **settings}
    return suite.load(domain, suite.default_task(domain), settings)


def drive(environment, direction, seconds):
    """Returns the hand's greatest ratio of actual to commanded speed, and the joints' greatest speed [rad/s]."""
    environment.reset()
    physics, robot = environment.physics, environment.task.robot
    joints, hand = physics.bind(robot.joints[:7]), physics.bind(robot.end_effector)
    timestep = environment.control_timestep()
    commanded = environment.task.mdp.action_mode.linear_speed * np.linalg.norm(direction)
    action = np.zeros(environment.action_spec().shape)
    action[:3] = direction
    ratio, speed, last = 0.0, 0.0, hand.xpos.copy()
    for _ in range(round(seconds / timestep)):
        if environment.step(action).last():
            break
        moved, last = np.linalg.norm(hand.xpos - last), hand.xpos.copy()
        ratio = max(ratio, moved / timestep / commanded)
        speed = max(speed, np.abs(joints.qvel).max())
    return ratio, speed


def without_limits(monkeypatch):
    monkeypatch.setattr(speed_limits, "limited", lambda *args: args[3])


# Of the domain, a border at which the hand got to 2.0 to 3.3 times its commanded speed, or a joint to 4.8 rad/s.
BORDERS = [
    ("microwave_table", (-1, 0, 0)),
    ("microwave_table", (-1, 0, -1)),
    ("open_cabinet", (1, 1, -1)),
]


@pytest.mark.parametrize(("domain", "direction"), BORDERS)
def test_hand_and_joints_stay_within_their_limits_at_a_border(domain, direction):
    ratio, speed = drive(load(domain), direction, seconds=6.0)
    assert ratio <= 1.5
    assert speed < 3.0


@pytest.mark.parametrize(("domain", "direction"), BORDERS)
def test_these_borders_need_limits(domain, direction, monkeypatch):
    without_limits(monkeypatch)
    ratio, speed = drive(load(domain), direction, seconds=6.0)
    assert ratio > 1.7 or speed > 3.5


def test_limits_follow_the_commanded_speed():
    ratio, speed = drive(load("open_cabinet", linear_speed=0.1), (-1, 0, 0), seconds=6.0)
    assert ratio <= 1.5
    assert speed < 3.0


@pytest.mark.parametrize("domain", ["microwave_table", "open_cabinet"])
def test_slow_steps_are_equal_with_and_without_limits(domain, monkeypatch):
    def positions():
        environment = load(domain, control_mode="ee_delta_pose")
        environment.reset()
        for action in 0.25 * walk(environment.action_spec(), 30, 1)[:, 0]:
            environment.step(action)
        return environment.physics.data.qpos.copy()

    limited = positions()
    without_limits(monkeypatch)
    np.testing.assert_array_equal(positions(), limited)


def test_limited_steps_of_many_are_those_of_one(monkeypatch):
    changed, limited = [], speed_limits.limited

    def observed(*args):
        velocities = limited(*args)
        changed.append(bool((velocities != args[3]).any()))
        return velocities

    monkeypatch.setattr(speed_limits, "limited", observed)
    settings = {"control_mode": "ee_delta_position", "max_episode_steps": 300}
    env_id = suite.DOMAINS["open_cabinet"].env_id
    together = many(env_id, 2, **settings)
    alone = [gymnasium.make(env_id, **settings) for _ in range(2)]
    together.reset(seed=5)
    for i, env in enumerate(alone):
        env.reset(seed=5 + i)
    actions = np.array([[-1.0, -1.0, -1.0, 0.0], [1.0, 0.0, 1.0, 0.0]])
    for _ in range(150):
        rows = together.step(actions)[0]
        for i, env in enumerate(alone):
            np.testing.assert_equal(part(rows, i), env.step(actions[i])[0])
    assert any(changed)


@pytest.mark.parametrize("domain", ["kitchen", "kitchens"])
def test_long_control_steps_have_no_limits(domain, monkeypatch):
    def refuse(*args):
        raise AssertionError("the arm of a kitchen has no limits")

    monkeypatch.setattr(speed_limits, "limited", refuse)
    environment = load(domain)
    environment.reset()
    environment.step(np.array([-1.0, 0.0, -1.0, 0.0]))
