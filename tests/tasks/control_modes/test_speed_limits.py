"""At the borders of the workspace, hand and joints stay within their limits of speed; slow steps are unchanged."""

from types import SimpleNamespace
from unittest import mock

import gymnasium
import numpy as np
import pytest
from docs_scripts import load_script
from helpers.sweeps import walk
from helpers.vectors import many, part

from kitchen_suite import suite
from kitchen_suite.tasks.control_modes import speed_limits

tracking = load_script("experiments/tracking")


def drive(domain, direction, **settings):
    """Returns the hand's greatest ratio of actual to commanded speed, and the joints' greatest speed [rad/s]."""
    environment = tracking.load(domain, "ee_delta_position", **settings)
    driven = tracking.drive(environment, np.array(direction), seconds=6.0)
    return driven.ratios.max(), driven.joint_speeds.max()


def without_limits(monkeypatch):
    monkeypatch.setattr(speed_limits, "limited", lambda *args: args[3])


# Of the domain, borders at which the hand is too fast without limits, or where velocities are scaled down alone.
BORDERS = [
    ("microwave_table", (-1.0, 0.0, 0.0)),
    ("microwave_table", (1.0, 0.0, 0.0)),
    ("open_cabinet", (0.0, 1.0, -1.0)),
    ("open_cabinet", (1.0, 1.0, 0.0)),
]


@pytest.mark.parametrize(("domain", "direction"), BORDERS)
def test_hand_and_joints_stay_within_their_limits_at_a_border(domain, direction):
    ratio, speed = drive(domain, direction)
    assert ratio <= 1.5
    assert speed < 3.0


@pytest.mark.parametrize(("domain", "direction"), BORDERS)
def test_these_borders_need_limits(domain, direction, monkeypatch):
    without_limits(monkeypatch)
    ratio, speed = drive(domain, direction)
    assert ratio > 1.7 or speed > 3.5


def test_limits_follow_the_commanded_speed():
    ratio, speed = drive("open_cabinet", (-1, 0, 0), linear_speed=0.1)
    assert ratio <= 1.5
    assert speed < 3.0


@pytest.mark.parametrize("domain", ["microwave_table", "open_cabinet"])
def test_slow_steps_are_equal_with_and_without_limits(domain, monkeypatch):
    def positions():
        environment = tracking.load(domain, "ee_delta_pose")
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
    # The second hand is slow, and not limited.
    actions = np.array([[-1.0, -1.0, -1.0, 0.0], [0.1, 0.0, 0.1, 0.0]])
    for _ in range(150):
        rows = together.step(actions)[0]
        for i, env in enumerate(alone):
            np.testing.assert_equal(part(rows, i), env.step(actions[i])[0])
    assert any(changed)


def test_slow_velocities_stay_beside_fast_ones():
    # Servos that can exert a fifth of what any change asks, of two arms at rest.
    servos = SimpleNamespace(
        light=np.zeros(7, bool),
        velocities=lambda simulation: np.zeros((2, 7)),
        load=lambda simulation, change: np.full(change.shape, 5.0),
    )
    velocities = np.repeat([[0.1], [1.0]], 7, axis=1)
    limited = speed_limits.limited(servos, None, np.zeros((2, 6, 7)), velocities, np.ones(2))
    np.testing.assert_array_equal(limited[0], velocities[0])
    np.testing.assert_allclose(limited[1], velocities[1] / 5.0)


# Control steps that are too long, and an arm whose joints are damped by themselves.
UNLIMITED = [
    ("kitchen", {}),
    ("kitchens", {}),
    ("open_cabinet", {"control_timestep": 0.04}),
    ("kitchen", {"control_timestep": 0.02}),
]


@pytest.mark.parametrize(("domain", "settings"), UNLIMITED)
def test_long_control_steps_and_damped_joints_have_no_limits(domain, settings, monkeypatch):
    monkeypatch.setattr(speed_limits, "limited", mock.Mock(side_effect=AssertionError("this arm has no limits")))
    environment = tracking.load(domain, "ee_delta_position", **settings)
    environment.step(np.array([-1.0, 0.0, -1.0, 0.0]))
