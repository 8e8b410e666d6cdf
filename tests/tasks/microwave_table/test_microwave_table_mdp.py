"""The mathematics of the microwave_table domain by numbers computed by hand, for one episode and for many."""

import types

import numpy as np
import pytest

from kitchen_suite.tasks import Transition
from kitchen_suite.tasks.microwave_table.mdp import REWARDS, SIZE, SLICES, MicrowaveTableMDP, MicrowaveTableState

# Columns of a reading, as the sensors of a scene have them.
COLUMNS = {
    "joint_positions": slice(0, 9),
    "joint_velocities": slice(9, 18),
    "handle_position": slice(18, 21),
    "tcp_position": slice(21, 24),
    "door_position": slice(24, 25),
    "door_velocity": slice(25, 26),
}
MDP = MicrowaveTableMDP(
    sensors=types.SimpleNamespace(indices=COLUMNS), action_mode=None, rewards=REWARDS, threshold=0.25
)
HANDLE, TCP = np.array([0.5, 0.0, 0.75]), np.array([0.5, -0.03, 0.71])


def reading(shape, door):
    """Returns values of sensors: the fingertips 5 cm from the handle, joints at 0 to 8 and moving at 9 to 17."""
    values = np.zeros((*shape, 26))
    values[..., :18] = np.arange(18)
    values[..., COLUMNS["handle_position"]], values[..., COLUMNS["tcp_position"]] = HANDLE, TCP
    values[..., 24], values[..., 25] = door, 2.0
    return values


def play(doors):
    """Returns the states of an episode, or of many, whose doors are at some angles after each step."""
    shape = np.shape(doors[0])
    states = [MDP.initial_state(reading(shape, doors[0]), np.zeros((*shape, 0)))]
    for door in doors[1:]:
        after = {"action": np.zeros((*shape, 8)), "target": np.zeros((*shape, 9)), "draws": np.zeros((*shape, 0))}
        states.append(MDP.step(state=states[-1], reading=reading(shape, door), **after))
    return states


def test_parts_end_to_end_are_the_flat_observation():
    stops = [part.stop for part in SLICES.values()]
    assert [part.start for part in SLICES.values()] == [0, *stops[:-1]]
    assert stops[-1] == SIZE == 23


@pytest.mark.parametrize("shape", [(), (3,), (2, 3)])
def test_a_reset_has_an_observation_and_no_reward(shape):
    (state,) = play([np.full(shape, -0.3)])
    expected = [*range(18), 0.0, 0.03, 0.04, -0.3, 2.0]
    np.testing.assert_allclose(state.observation, np.broadcast_to(expected, (*shape, 23)), atol=1e-15)
    np.testing.assert_array_equal(state.joint_positions, np.broadcast_to(np.arange(9), (*shape, 9)))
    np.testing.assert_array_equal(state.joint_velocities, np.broadcast_to(np.arange(9, 18), (*shape, 9)))
    np.testing.assert_allclose(state.handle_offset, np.broadcast_to([0.0, 0.03, 0.04], (*shape, 3)), atol=1e-15)
    np.testing.assert_allclose(state.door_opening, np.full(shape, 0.4))
    assert list(state.terms) == ["approach", "opening"]
    for term in state.terms.values():
        np.testing.assert_array_equal(term, np.zeros(shape))
        assert np.shape(term) == shape
    assert MDP.observation(None, state).dtype == np.float32
    np.testing.assert_array_equal(MDP.observation(None, state), state.observation.astype(np.float32))


@pytest.mark.parametrize("shape", [(), (3,)])
def test_a_step_is_rewarded_and_never_terminates(shape):
    state = play([np.zeros(shape), np.full(shape, -0.6)])[-1]
    expected = {"approach": 1.0 - np.tanh(0.5), "opening": 4.0}
    assert state.terms.keys() == expected.keys()
    for name, value in expected.items():
        np.testing.assert_allclose(state.terms[name], np.full(shape, value), rtol=1e-12)
    np.testing.assert_allclose(MDP.reward(state), np.full(shape, sum(expected.values())), rtol=1e-12)
    assert MDP.terminates(state).dtype == bool
    np.testing.assert_array_equal(MDP.terminates(state), np.zeros(shape, bool))


def test_success_is_a_door_nearer_to_its_goal_than_the_threshold():
    # The goal is at -0.75, and the threshold 0.25: a quarter is not within a quarter.
    doors = np.array([-0.5, -0.51, -0.75, -0.99, -1.0, 0.0])
    (state,) = play([doors])
    assert state.is_success.tolist() == [False, True, True, True, False, False]
    assert state.succeeded.tolist() == state.is_success.tolist()


def test_a_success_at_any_time_lasts():
    # Each row is an episode: open after some of four steps.
    doors = np.array([[0.0, -0.7, -0.7, 0.0], [0.0, 0.0, 0.0, -0.7], [-0.7, 0.0, 0.0, 0.0], [0.0] * 4])
    states = play(doors.T)
    assert [state.is_success.tolist() for state in states] == (doors.T < 0.0).tolist()
    assert [state.succeeded.tolist() for state in states] == [
        [False, False, True, False],
        [True, False, True, False],
        [True, False, True, False],
        [True, True, True, False],
    ]
    for episode, angles in enumerate(doors):
        alone = play(angles)
        assert [bool(state.succeeded) for state in alone] == [bool(state.succeeded[episode]) for state in states]


def test_infos_are_fresh_arrays():
    state = play([np.zeros(2), np.array([-0.3, -0.75])])[-1]
    infos = MDP.info(state)
    expected = {
        "reward/approach": state.terms["approach"],
        "reward/opening": state.terms["opening"],
        "door_opening": state.door_opening,
        "is_success": state.is_success,
        "success_at_any_time": state.succeeded,
    }
    assert list(infos) == list(expected)
    for name, value in expected.items():
        np.testing.assert_array_equal(infos[name], value)
        assert not np.shares_memory(infos[name], value)
    assert infos["success_at_any_time"].dtype == bool


def test_reward_terms_by_hand():
    observation = np.zeros((3, SIZE))
    observation[1, SLICES["handle_offset"]] = 0.06, 0.0, 0.08
    observation[:, SLICES["door_position"]] = [[-0.15], [0.3], [-2.0]]
    state = MicrowaveTableState(observation, np.zeros((3, 9)), {}, np.zeros(3, bool), np.zeros(3, bool))
    step = Transition(state, np.zeros(8), np.zeros(9), state)
    terms = {name: term(step) for name, term in REWARDS.items()}
    assert tuple(terms) == ("approach", "opening")
    np.testing.assert_allclose(terms["approach"], [1.0, 1.0 - np.tanh(1.0), 1.0])
    np.testing.assert_allclose(terms["opening"], [1.0, 0.0, 5.0])


def test_settings_are_given_by_name():
    assert MicrowaveTableMDP(sensors=MDP.sensors, threshold=0.25, action_mode=None, rewards=REWARDS) == MDP
    with pytest.raises(TypeError, match="positional"):
        MicrowaveTableMDP(MDP.sensors, 0.25, action_mode=None, rewards=REWARDS)
