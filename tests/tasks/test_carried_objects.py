"""Collisions of what the hand carries, measured with `quality=True`."""

import gymnasium
import numpy as np
import pytest
from helpers.contacts import carried_by_hand, step_by_hand

import kitchen_suite
from kitchen_suite import EnvironmentSpec, policies, suite
from kitchen_suite.tasks.episode.carried_objects import NUM_CONTACTS, collision_forces

ENV_ID = suite.DOMAINS["pick_and_place"].env_id
# A kitchen in which the expert is certified.
KITCHEN = {"design": 1, "split": "test"}


@pytest.fixture(scope="module")
def carry():
    """Actions `(T, 9)` of the expert from the reset with seed 0, in single precision."""
    spec = EnvironmentSpec.make("pick_and_place", "any", {**KITCHEN, "certified": True}, 120)
    (episode,) = kitchen_suite.play(spec, "expert", seeds=[0])
    return episode.arrays["action"]


def measured(environment):
    """The forces `(k, n)` on the objects of a kitchen in the last control step [N]."""
    part = environment.task.parts["carried_objects"]
    forces = collision_forces(part.read(environment.task.simulation)).reshape(5, -1)
    count = len(environment.task.scene.objects)
    # Empty slots count nothing.
    assert not forces[count:].any()
    return forces[:count]


def test_forces_on_a_carried_mug_are_those_of_single_contacts_summed_by_hand(carry):
    env = gymnasium.make(ENV_ID, **KITCHEN, certified=True, quality=True)
    _, info = env.reset(seed=0)
    assert info["peak_carried_contact_force"] == 0.0
    environment = env.unwrapped.environment
    peak = 0.0
    for action in carry:
        expected, contacts = step_by_hand(environment, action, carried_by_hand)
        assert contacts <= NUM_CONTACTS
        np.testing.assert_allclose(measured(environment), expected, rtol=1e-9, atol=1e-6)
        peak = max(peak, expected.max())
    # It is lifted from the worktop, on which its weight rests while the hand closes.
    assert environment.task.quality["peak_carried_contact_force"] == pytest.approx(peak)
    assert peak > 1.0


def test_a_force_counts_while_the_hand_touches_the_object():
    contacts = np.zeros((2, 3, 2, NUM_CONTACTS))  # Of three objects in two physics steps: all, and with the hand.
    contacts[0, 0, :, :3] = [[4.0, 5.0, 6.0], [4.0, 0.0, 0.0]]
    contacts[1, 0, :, :1] = [[4.0], [4.0]]
    contacts[0, 1, :, :2] = [[7.0, 8.0], [7.0, 0.0]]  # Which the hand does not touch.
    expected = [11.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    np.testing.assert_array_equal(collision_forces(contacts.ravel()), expected)
    np.testing.assert_array_equal(collision_forces(np.stack([contacts.ravel()] * 2)), [expected, expected])


@pytest.mark.full
def test_what_is_pressed_down_has_a_greater_peak():
    options = {"certified": True, "quality": True, "control_mode": "ee_delta_pose", "visuals": False}
    environment = suite.load("pick_and_place", "any", {**KITCHEN, **options, "random": 0})
    timestep = environment.reset()
    act = policies.find("expert")(environment, np.random.default_rng(0))
    start = environment.task.state
    (asked,) = np.flatnonzero(start.requested)
    while environment.task.state.centres[asked, 2] < start.centres[asked, 2] + 0.03:
        assert not timestep.last()
        action = act(timestep)
        timestep = environment.step(action)
    before = environment.task.quality["peak_carried_contact_force"]
    for _ in range(40):
        environment.step(np.array([0.0, 0.0, -1.0, 0.0, 0.0, 0.0, action[-1]]))
    assert environment.task.quality["peak_carried_contact_force"] > before + 2.0


@pytest.mark.full
def test_kitchens_of_several_designs_have_the_force_of_each_alone(carry):
    designs = [KITCHEN["design"], 5]
    options = {"split": "test", "certified": True, "quality": True}
    envs = gymnasium.make_vec(
        ENV_ID, 2, vectorization_mode="vector_entry_point", num_threads=1, design=designs, **options
    )
    alone = [gymnasium.make(ENV_ID, design=design, **options) for design in designs]
    envs.reset(seed=0)
    for i, env in enumerate(alone):
        env.reset(seed=i)
    for action in carry:
        *_, many = envs.step(np.stack([action, np.zeros_like(action)]))
        for i, env in enumerate(alone):
            *_, infos = env.step(action if i == 0 else np.zeros_like(action))
            assert infos["peak_carried_contact_force"] == many["peak_carried_contact_force"][i]
    assert many["peak_carried_contact_force"][0] > 1.0
