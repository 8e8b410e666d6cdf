"""The expert of objects: it opens, grasps, carries and lets go, and gives up what it cannot reach."""

import numpy as np
import pytest

from kitchen_suite import policies, suite
from kitchen_suite.policies.experts import grasps, pick_and_place
from kitchen_suite.policies.experts.base import make
from kitchen_suite.policies.experts.skills import CLOSED, OPEN
from kitchen_suite.policies.experts.trajectories import JointSpeedLimits, JointTrajectory

# Tasks in kitchens of the split `test`, in which the expert is certified to complete them.
TASKS = [
    (1, "put_on mug tray"),
    (1, "put_in mug drawers_1/drawer_1"),
    (2, "put_in can wall_sliding_1/inside"),
    (1, "take_out mug drawers_1/drawer_1"),
    (13, "take_out bottle hinge_cabinet_1/inside"),
    (2, "open_and_put_in mug drawers_1/drawer_1"),
]


def load(design, **arguments):
    return suite.load("pick_and_place", "any", {"design": design, "split": "test", "visuals": False, **arguments})


def play(environment, name, seed=0):
    """Plays the expert for a task; returns the environment's last time step."""
    task = environment.task
    act = policies.find("expert")(environment, np.random.default_rng(seed))
    environment.random_state.seed(seed)
    task.follow(task.checked_reset({"requested_tasks": [name]}))
    timestep = environment.reset()
    while not timestep.last():
        timestep = environment.step(act(timestep))
    return timestep


def complete(environment, name):
    """Plays the expert from up to four seeds until it completes a task; returns the last time step.

    Episodes with contacts are chaotic: on another kind of processor the same seed may fail.
    """
    for seed in range(4):
        timestep = play(environment, name, seed)
        if environment.task.episode_metrics["success"]:
            return timestep
    raise AssertionError(f"the expert does not complete {name}")


@pytest.mark.full
@pytest.mark.parametrize(("design", "name"), TASKS)
def test_tasks_of_all_kinds_of_places_are_completed(design, name):
    environment = load(design)
    assert complete(environment, name).discount == 0.0
    assert environment.task.episode_metrics["objects_dropped"] == 0


def test_an_object_is_put_on_a_tray():
    environment = load(1)
    complete(environment, "put_on mug tray")
    number = environment.task.scene.layout.names.index("mug")
    place = next(each for each in environment.task.scene.places if each.name == "tray")
    centre = environment.task.state.centres[number]
    assert (centre[:2] > np.array(place.low[:2])).all()
    assert (centre[:2] < np.array(place.high[:2])).all()
    assert environment.task.episode_metrics["success"]


@pytest.mark.full
@pytest.mark.parametrize("mode", ["ee_delta_pose", "ee_pose", "joint_position"])
def test_the_expert_acts_in_other_control_modes(mode):
    assert complete(load(1, control_mode=mode), "put_on mug tray")


@pytest.mark.full
def test_parts_that_are_not_observed_are_open_where_something_is_put_in():
    assert complete(load(1, num_slots=1), "put_in mug drawers_1/drawer_1")


def test_objects_are_read_from_the_observation_as_they_stand():
    environment = load(2, object_noise_ratio=0.0)
    timestep = environment.reset()
    task = environment.task
    observation = task.policy_inputs.flatten(timestep.observation).ravel().astype(np.float64)
    seen = grasps.things(observation)
    assert len(seen) == len(task.scene.objects)
    requested = int(np.flatnonzero(task.state.requested)[0])
    assert seen[0].kind == task.scene.layout.objects[requested].kind
    assert seen[0].goal_kind
    assert not any(thing.goal_kind for thing in seen[1:])
    np.testing.assert_allclose(seen[0].base, task.state.poses[requested, :3], atol=1e-6)
    assert all(thing.is_upright for thing in seen)


def test_an_object_that_has_fallen_over_is_left_alone():
    environment = load(1)
    task = environment.task
    task.follow(task.checked_reset({"requested_tasks": ["put_on mug tray"]}))
    timestep = environment.reset()
    expert = make(task)
    observation = task.policy_inputs.flatten(timestep.observation).ravel().astype(np.float64)
    row = observation[grasps.SLICES["objects"]].reshape(grasps.MAX_OBJECTS, -1)[0]
    row[grasps.OBJECT_SLICES["z_axis"]] = 1.0, 0.0, 0.0
    assert not grasps.things(observation)[0].is_upright
    expert.reset(np.random.default_rng(0))
    expert.act(observation)
    assert expert._current_trajectory.duration == 0.0


def around_a_corner():
    """A motion of the joints that carries something around a corner."""
    corner = np.zeros((3, 7))
    corner[1:, 0] = 1.0
    corner[2, 1] = 1.0
    limits = JointSpeedLimits(joint_speed=(0.05,) * 7, timestep=0.08)
    start, end = (JointTrajectory.stationary(np.full(7, place), OPEN) for place in (-1.0, 2.0))
    held = JointTrajectory(times=np.array([0.0, 20.0, 40.0]), knots=corner, fingers=np.full(3, CLOSED))
    return start.then(held, limits).then(end, limits)


@pytest.mark.parametrize(
    ("by_window", "window", "fewest"),
    [([0], 10.0, 0), ([3, 0], 5.0, 0), ([3, 3, 2], 2.0, 2), ([3, 3, 3], 10.0, 3)],
    ids=["clear", "a corner is cut", "touches anyway", "touches as often"],
)
def test_what_is_carried_cuts_no_corner_into_something(by_window, window, fewest):
    """The numbers are those of the control steps in which a motion of each window touches something."""
    counts = iter(by_window)
    kitchen = object.__new__(pick_and_place._ObjectKitchen)
    checked = []
    kitchen._touches = lambda knots, number, held: checked.append(len(knots)) or next(counts)
    sharp = around_a_corner()
    touches, smooth = kitchen._smoothed(sharp, 0, None)
    assert touches == fewest
    np.testing.assert_array_equal(smooth.knots, sharp.smoothed(window).knots)
    # Every control step with closed fingers.
    assert set(checked) == {np.count_nonzero(smooth.fingers == CLOSED)}


def test_what_is_carried_turns_smoothly():
    sharp = around_a_corner()
    smooth = sharp.smoothed(6.0)
    steps = np.arange(sharp.duration)
    positions = [np.stack([each.at(time)[0] for time in steps]) for each in (sharp, smooth)]
    fingers = [np.array([each.at(time)[1] for time in steps + 0.5]) for each in (sharp, smooth)]
    np.testing.assert_array_equal(*fingers)
    is_free = fingers[0] == OPEN
    assert 0.2 < is_free.mean() < 0.8
    np.testing.assert_allclose(positions[1][is_free], positions[0][is_free], atol=1e-9)
    assert smooth.duration == sharp.duration
    np.testing.assert_array_equal(smooth.knots[-1], sharp.knots[-1])
    turns = [np.abs(np.diff(each[~is_free], n=2, axis=0)).max() for each in positions]
    assert turns[1] < 0.3 * turns[0]
    # No farther from the path than the window is wide.
    assert np.abs(positions[1] - positions[0]).max() < 6.0 * 0.05


def test_a_hand_that_is_left_beside_what_it_put_down_leaves_it():
    environment = load(1, object_noise_ratio=0.0, robot_noise_ratio=0.0)
    task = environment.task
    task.follow(task.checked_reset({"requested_tasks": ["put_on mug tray"]}))
    timestep = environment.reset()
    expert = make(task)
    observation = task.policy_inputs.flatten(timestep.observation).ravel().astype(np.float64)
    row = observation[grasps.SLICES["objects"]].reshape(grasps.MAX_OBJECTS, -1)[0]
    joints = observation[grasps.SLICES["joint_positions"]][:7]
    hand = expert.encoder.arm.kinematics.forward(joints).translation()
    # The tray, and the mug on it, are where the hand is.
    row[grasps.OBJECT_SLICES["position"]] = hand - grasps.robot_base()
    row[grasps.OBJECT_SLICES["goal_position"]] = hand - grasps.robot_base() - [0.0, 0.0, 0.03]
    assert grasps.things(observation)[0].is_done
    expert.reset(np.random.default_rng(0))
    for _ in range(20):
        expert.act(observation)
    last = expert.encoder.arm.kinematics.forward(expert._current_trajectory.knots[-1]).translation()
    assert last[2] - hand[2] > 0.05
