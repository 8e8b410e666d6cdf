"""Contact forces of `quality=True` are those of MuJoCo's single contacts, whoever sleeps."""

import gymnasium
import numpy as np
import pytest
from helpers.contacts import step_by_hand
from helpers.copies import copies_of, played
from helpers.sweeps import walk

from kitchen_suite import suite
from kitchen_suite.tasks.episode import quality

FAST = {"physics": "fast"}

# Environments by name, in modes whose random walks make the arm touch itself and other things.
CASES = {
    "kitchen": ("kitchen", {"control_mode": "joint_delta"}),
    "kitchen, fast": ("kitchen", {"control_mode": "joint_delta", **FAST}),
    "kitchen, asleep": ("kitchen", {"control_mode": "joint_delta", "sleep": True}),
    "kitchens": ("kitchens", {"control_mode": "joint_delta", "physics": "exact"}),
    "kitchens, fast": ("kitchens", {"control_mode": "joint_delta", **FAST}),
    "pick_and_place, fast": ("pick_and_place", {"control_mode": "joint_delta", **FAST}),
    "open_cabinet": ("open_cabinet", {"control_mode": "joint_delta"}),
    "microwave_table": ("microwave_table", {"control_mode": "joint_position"}),
    "microwave_table, fast": ("microwave_table", {"control_mode": "joint_position", **FAST}),
}


def load(name, **options):
    domain, own = CASES[name]
    options = {"random": 0, "quality": True, "visuals": False, **own, **options}
    return suite.load(domain, suite.default_task(domain), options)


def measured(environment):
    """The forces `(2, n)` on the arm without the hand, and on the hand, in the last control step [N]."""
    return quality.contact_forces(environment.task.meter.read(environment.task.simulation).contacts)


def greatest_difference(name, steps, first_seed=0, episode_steps=140):
    """The greatest difference of a force from that by hand [N], and which of arm and hand were touched.

    In episodes of random walks, each with a seed of its own.
    """
    environment, difference, touched, seed = load(name), 0.0, np.zeros(2, bool), first_seed
    while steps > 0:
        environment.reset()
        for action in walk(environment.action_spec(), min(steps, episode_steps), seed=seed):
            expected, contacts = step_by_hand(environment, action)
            found = measured(environment)
            assert contacts <= quality.NUM_CONTACTS
            assert (found >= 0.0).all()
            difference = max(difference, np.abs(found - expected).max())
            touched |= (expected > 0.0).any(axis=-1)
            steps -= 1
            if environment.resets_next_step:
                break
        seed += 1
    return difference, touched


def test_the_arm_that_touches_its_own_hand_while_objects_sleep_touches_nothing_else():
    environment = load("microwave_table, fast")
    environment.reset()
    for action in walk(environment.action_spec(), 62, seed=2):
        environment.step(action)
    reading = environment.task.meter.read(environment.task.simulation)
    of_robot, _, _, of_hand_with_robot = reading.contacts.reshape(4, -1).sum(axis=-1)
    assert (environment.physics.data.ptr.tree_asleep >= 0).any()
    assert of_robot == of_hand_with_robot > 10.0
    assert environment.task.quality["peak_arm_contact_force"] < 1e-9
    assert environment.task.quality["stray_contacts"] == 0


def test_a_vectorised_arm_that_touches_its_own_hand_while_objects_sleep_touches_nothing_else():
    domain, options = CASES["microwave_table, fast"]
    env_id = suite.DOMAINS[domain].env_id
    env = gymnasium.make(env_id, quality=True, **options).unwrapped
    envs = gymnasium.make_vec(env_id, 2, vectorization_mode="vector_entry_point", quality=True, **options)
    env.reset(seed=1)
    envs.reset(seed=0)
    of_hand_with_robot = 0.0
    for action in walk(env.environment.action_spec(), 62, seed=2).astype(np.float32):
        *_, infos = env.step(action)
        *_, many = envs.step(np.stack([action, action]))
        reading = env.composer_task.meter.read(env.composer_task.simulation)
        of_hand_with_robot = max(of_hand_with_robot, reading.contacts.reshape(4, -1)[3].sum())
    assert of_hand_with_robot > 10.0
    assert (many["peak_arm_contact_force"] < 1e-9).all()
    assert many["mean_arm_contact_force"][1] == infos["mean_arm_contact_force"]


@pytest.mark.full
@pytest.mark.parametrize(("name", "seed"), [("microwave_table, fast", 2), ("kitchen, fast", 1), ("kitchens, fast", 1)])
def test_forces_are_those_of_single_contacts_while_objects_sleep(name, seed):
    difference, _ = greatest_difference(name, 90, seed)
    assert difference < 1e-9


@pytest.mark.nightly
@pytest.mark.parametrize("name", CASES)
def test_forces_of_ten_thousand_control_steps_are_those_of_single_contacts(name):
    difference, touched = greatest_difference(name, 10_000 // len(CASES))
    assert difference < 1e-9
    assert touched.any()


def test_forces_of_rounded_sums_are_never_below_0():
    """The hand alone touches something: of the arm's forces the differences of sums leave some -1e-16."""
    lists = np.random.default_rng(0).uniform(0.0, 1.0, (100, 4))
    contacts = np.zeros((4, 100, quality.NUM_CONTACTS))
    contacts[0, :, :4] = lists  # Of the robot.
    contacts[1, :, :2] = lists[:, :2]  # Of the hand, with something else.
    contacts[2, :, :2] = lists[:, 2:]  # Of the arm with itself.
    arm, hand = quality.contact_forces(contacts.ravel())
    assert (arm >= 0.0).all()
    np.testing.assert_allclose(arm, 0.0, atol=1e-15)
    np.testing.assert_allclose(hand, lists[:, :2].sum(axis=-1), rtol=1e-15)


@pytest.mark.full
@pytest.mark.parametrize(("name", "seed"), [("microwave_table, fast", 2), ("kitchen, fast", 1), ("kitchens, fast", 1)])
@pytest.mark.parametrize("steps", [30, 64])
def test_a_copy_measures_the_forces_of_the_original(name, seed, steps):
    environment = load(name)
    environment.reset()
    actions = walk(environment.action_spec(), steps + 12, seed=seed)
    for action in actions[:steps]:
        environment.step(action)
    copies = copies_of(environment, other=played(load(name), -actions[:20]))
    for action in actions[steps:]:
        environment.step(action)
        expected = measured(environment)
        assert (expected >= 0.0).all()
        for kind, copied in copies.items():
            copied.step(action)
            np.testing.assert_array_equal(measured(copied), expected, err_msg=kind)
            assert copied.task.quality == environment.task.quality, kind
