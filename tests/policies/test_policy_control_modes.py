"""Trained policies in another control mode than the one that they were trained in."""

import numpy as np
import pytest

from kitchen_suite import policies, suite
from kitchen_suite.policies.files import shipped
from kitchen_suite.tasks.kitchen.control_modes import CONTROL_MODES

STEPS = 20


def trajectory(mode: str, **kwargs) -> np.ndarray:
    """Returns positions and velocities `(t, n)` of an episode of a shipped policy in a control mode."""
    arguments = {"visuals": False, "control_mode": mode, "random": 7, "robot_noise_ratio": 0.05, **kwargs}
    environment = suite.load("kitchen", "kettle", arguments)
    policy = policies.find("trained")(environment, np.random.default_rng(0))
    timestep, states = environment.reset(), []
    for _ in range(STEPS):
        timestep = environment.step(policy(timestep))
        states.append(environment.physics.get_state())
    return np.array(states)


@pytest.mark.full
def test_a_policy_of_joint_velocity_acts_in_joint_position_as_in_its_own_mode():
    velocity, position = trajectory("joint_velocity"), trajectory("joint_position")
    assert np.ptp(velocity, axis=0).max() > 0.1
    np.testing.assert_array_equal(position, velocity)


@pytest.mark.full
@pytest.mark.parametrize("mode", sorted(set(CONTROL_MODES) - {"joint_velocity", "joint_position"}))
def test_in_other_modes_it_is_refused(mode):
    with pytest.raises(policies.PolicyError, match=f"acts in control mode 'joint_velocity', not '{mode}'|maps"):
        trajectory(mode)


@pytest.mark.full
def test_the_policy_of_a_task_goes_before_that_of_the_whole_kitchen():
    names = {
        task: shipped(suite.load("kitchen", task, {"visuals": False}).task).stem
        for task in ("kettle", "complete", "all", "random_4", "random_1")
    }
    whole = ("complete", "all", "random_4")
    assert names == {"kettle": "kettle", "random_1": "seven_in_turn", **dict.fromkeys(whole, "kitchen")}


@pytest.mark.full
@pytest.mark.parametrize("variations", [["start"], ["layout"], {"microwave/door": -0.1}])
@pytest.mark.parametrize("task", ["kettle", "random_1"])
def test_where_something_varies_a_policy_that_was_trained_with_variations_is_preferred(task, variations):
    assert shipped(suite.load("kitchen", task, {"visuals": False, "variations": variations}).task).stem == "kitchen"


@pytest.mark.full
def test_the_policy_of_the_kitchen_is_not_for_tasks_beyond_the_seven():
    with pytest.raises(ValueError, match=r"no trained policy .*kitchen"):
        shipped(suite.load("kitchen", "close_microwave", {"visuals": False}).task)
