"""Control modes: what actions do, how exactly they are followed, states and copies, and bad input."""

import copy
import itertools
import pickle
from unittest import mock

import gymnasium
import mujoco
import numpy as np
import pytest
from docs_scripts import load_script
from helpers.errors import refused
from helpers.sweeps import CASES, brief, walk

from kitchen_suite import suite
from kitchen_suite.entities import KITCHEN_FRANKA, PANDA
from kitchen_suite.tasks import rotations as poses
from kitchen_suite.tasks import task as base
from kitchen_suite.tasks.control_modes import inverse_kinematics

tracking = load_script("experiments/tracking")
load = tracking.load

DOMAINS = tuple(suite.DOMAINS)
ROBOTS = {domain: PANDA if domain in ("open_cabinet", "microwave_table") else KITCHEN_FRANKA for domain in DOMAINS}


# Cases of every kind of mode.
BRIEF = (("kitchen", "ee_delta_pose"), ("kitchen", "joint_delta"), ("open_cabinet", "ee_pose"))


def kinds(cases):
    """Marks all cases but those of `BRIEF` as slow."""
    cases = [*cases]
    return brief(cases, kept=[case for case in BRIEF if case in cases])


def every(modes):
    return [(domain, mode) for domain in DOMAINS for mode in modes]


@pytest.mark.full
@pytest.mark.parametrize(("domain", "mode"), kinds(every(tracking.HOLDING_MODES)))
def test_the_end_effector_holds_still(domain, mode):
    distance, turn = tracking.drift(load(domain, mode), mode, suite.DOMAINS[domain].episode_steps)
    assert distance <= 2e-3
    assert turn <= 0.5


@pytest.mark.full
@pytest.mark.parametrize("axis", brief(range(3), kept=[2]))
@pytest.mark.parametrize(("domain", "mode"), kinds(every(tracking.LINE_MODES)))
def test_the_end_effector_follows_a_line(domain, mode, axis):
    for sign in (1, -1) if mode == "ee_delta_pose" else (1,):
        line = tracking.follow_line(load(domain, mode), mode, axis, sign)
        assert line.lateral <= 3e-3
        assert line.rotation <= 0.5
        assert abs(line.shortfall) <= 5e-3


def turned(environment, action, steps):
    """Rotation vector of the end effector, in the world, that some control steps with one action cause."""
    _, before = tracking.end_effector_pose(environment)
    for _ in range(steps):
        environment.step(action)
    return poses.difference(tracking.end_effector_pose(environment)[1], before)


@pytest.mark.full
@pytest.mark.parametrize(
    ("domain", "frame"),
    brief(
        itertools.product(("kitchen", "open_cabinet"), ("base", "hand")),
        kept=[("kitchen", "base"), ("open_cabinet", "hand")],
    ),
)
def test_rotation_vectors_turn_about_the_axes_of_the_frame(domain, frame):
    environment = load(domain, "ee_delta_pose", frame=frame, angular_speed=0.5)
    steps = round(0.8 / environment.control_timestep())
    for axis in range(3):
        _, orientation = tracking.end_effector_pose(environment)
        about = orientation if frame == "hand" else tracking.base_pose(environment)[1]
        action = tracking.holding_action(environment, "ee_delta_pose")
        action[3 + axis] = 0.5
        expected = poses.rotated(about, 0.2 * np.eye(3)[axis])
        # The arm lags behind by less than a tenth of a second.
        np.testing.assert_allclose(turned(environment, action, steps), expected, atol=0.06)
        turned(environment, tracking.holding_action(environment, "ee_delta_pose"), steps)


@pytest.mark.full
@pytest.mark.parametrize(
    ("domain", "mode"),
    [("kitchen", "joint_delta"), ("open_cabinet", "ee_pose"), ("microwave_table", "ee_delta_position")],
)
def test_the_gripper_opens_and_closes_linearly(domain, mode):
    environment = load(domain, mode)
    action, spec = tracking.holding_action(environment, mode), ROBOTS[domain]
    fingers = environment.physics.bind(environment.task.robot.actuators[7:])
    for number, share in ((1.0, 0.0), (-1.0, 1.0), (0.5, 0.25), (7.0, 0.0)):
        action[-1] = number
        environment.step(action)
        np.testing.assert_allclose(fingers.ctrl, spec.closed + share * (spec.open - spec.closed), atol=1e-12)


@pytest.mark.full
def test_nothing_winds_up_against_an_obstacle():
    environment = load("kitchen", "ee_delta_pose")
    down, up = (np.array([0.0, 0.0, sign, 0.0, 0.0, 0.0, 1.0]) for sign in (-1.0, 1.0))
    for _ in range(60):
        environment.step(down)
    position, _ = tracking.end_effector_pose(environment)
    assert environment.physics.data.ncon > 4
    assert np.linalg.norm(environment.task.episode.command.position - position) <= 0.08 + 0.03
    for _ in range(8):
        environment.step(up)
    assert tracking.end_effector_pose(environment)[0][2] > position[2] + 0.03


def arm_of(environment):
    """The arm's joints, bound to the physics."""
    return environment.physics.bind(environment.task.robot.joints[:7])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_joint_commands_stay_near_their_joints(sign):
    environment = load("open_cabinet", "joint_delta", joint_speed=10.0)
    low, high = environment.task.robot.joint_limits[:, :7]
    farthest = 0.0
    for _ in range(30):
        joints = np.array(arm_of(environment).qpos)
        environment.step(np.full(8, sign))
        command = environment.task.episode.command.positions
        assert (np.abs(command - joints) <= 0.3 + 1e-12).all()
        assert (command <= np.maximum(high, joints)).all()
        assert (command >= np.minimum(low, joints)).all()
        farthest = max(farthest, np.abs(command - joints).max())
    # Without the bound, the commands of the first steps would run ahead of the servos.
    assert farthest > 0.29


@pytest.mark.full
def test_the_orientation_of_the_reset_is_held():
    """Also after the hand has been turned further than a commanded orientation may be away."""
    environment = load("kitchen", "ee_delta_position")
    _, orientation = tracking.end_effector_pose(environment)
    arm_of(environment).qpos[6] -= 0.6
    hold = tracking.holding_action(environment, "ee_delta_position")
    environment.step(hold)
    assert tracking.angle(tracking.end_effector_pose(environment)[1], orientation) > 15.0
    for _ in range(50):
        environment.step(hold)
    assert tracking.angle(tracking.end_effector_pose(environment)[1], orientation) < 1.0


@pytest.mark.full
def test_the_null_space_returns_to_the_posture_of_the_reset():
    environment = load("open_cabinet", "ee_delta_pose")
    physics, joints = environment.physics, arm_of(environment)
    reset, place = np.array(joints.qpos), tracking.end_effector_pose(environment)[0]
    for _ in range(40):
        ids = joints.element_id
        jacobian = inverse_kinematics.jacobian(place, physics.data.xanchor[ids], physics.data.xaxis[ids])
        # The last of the right singular vectors moves the elbow, and not the hand.
        elbow = np.linalg.svd(jacobian)[2][-1]
        joints.qpos += 0.01 * elbow * np.copysign(1.0, elbow[0])
        physics.forward()
    away = np.linalg.norm(np.array(joints.qpos) - reset)
    for _ in range(800):
        environment.step(tracking.holding_action(environment, "ee_delta_pose"))
    assert np.linalg.norm(np.array(joints.qpos) - reset) < 0.3 * away
    assert np.linalg.norm(tracking.end_effector_pose(environment)[0] - place) < 5e-3


def test_quaternions_are_normalised_and_have_two_signs():
    environments = [load("open_cabinet", "ee_pose") for _ in range(3)]
    action = tracking.holding_action(environments[0], "ee_pose")
    action[:3] += (0.03, 0.0, 0.05)
    for environment, factor in zip(environments, (1.0, -1.0, 0.5), strict=True):
        changed = action.copy()
        changed[3:7] *= factor
        for _ in range(30):
            environment.step(changed)
    first, *others = (environment.physics.data.qpos for environment in environments)
    for other in others:
        np.testing.assert_allclose(other, first, atol=1e-9)


@pytest.mark.full
@pytest.mark.parametrize("norm", [0.0, 1e-7])
def test_a_quaternion_without_direction_is_refused(norm):
    environment = load("kitchen", "ee_pose")
    before, action = environment.get_state(), tracking.holding_action(environment, "ee_pose")
    action[3:7] = norm, 0.0, 0.0, 0.0
    with pytest.raises(ValueError, match=r"quaternion of an action .*1e-06"):
        environment.step(action)
    np.testing.assert_array_equal(environment.get_state()["physics"], before["physics"])
    environments = gymnasium.make_vec("KitchenSuite/FrankaKitchen-v1", 2, control_mode="ee_pose", num_threads=1)
    environments.reset(seed=0)
    good = tracking.holding_action(environment, "ee_pose")
    with pytest.raises(ValueError, match="quaternion of an action"):
        environments.step(np.stack([good, action]))
    assert environments.step(np.stack([good, good]))[4]["episode_step"].tolist() == [1, 1]


@pytest.mark.full
@pytest.mark.parametrize(
    "feedback", ["observed", *(pytest.param(name, marks=pytest.mark.nightly) for name in ("true", "target"))]
)
def test_joint_positions_repeat_an_episode_of_velocities(feedback):
    """Targets recorded from `joint_velocity`, in double precision, give the same trajectory to the bit."""
    velocities, positions = (
        load("kitchen", mode, feedback=feedback, random=5) for mode in ("joint_velocity", "joint_position")
    )
    for action in walk(velocities.action_spec(), 60):
        one = velocities.step(action)
        other = positions.step(velocities.physics.data.ctrl.copy())
        np.testing.assert_array_equal(positions.physics.data.ctrl, velocities.physics.data.ctrl)
        np.testing.assert_array_equal(
            other.observation["franka/joint_positions"], one.observation["franka/joint_positions"]
        )
    np.testing.assert_array_equal(positions.physics.data.qpos, velocities.physics.data.qpos)


@pytest.mark.full
def test_joint_positions_are_clipped():
    kitchen, cabinet = load("kitchen", "joint_position", feedback="true"), load("open_cabinet", "joint_position")
    for environment in (kitchen, cabinet):
        spec = environment.action_spec()
        environment.step(np.full(spec.shape, 1e3))
        bound = environment.physics.bind(environment.task.robot.actuators)
        assert (np.array(bound.ctrl)[: spec.shape[0]] <= spec.maximum).all()
    np.testing.assert_allclose(np.array(bound.ctrl)[:7], spec.maximum[:7])
    np.testing.assert_allclose(np.array(bound.ctrl)[7:], 0.04)
    # At most 10 rad/s away from the start.
    assert kitchen.physics.data.ctrl[1] < -1.7685 + 0.8 + 1e-4


@pytest.mark.full
@pytest.mark.parametrize(("domain", "mode"), kinds(CASES))
def test_states_continue_in_the_middle_of_an_episode(domain, mode):
    one, other = load(domain, mode), load(domain, mode, random=9)
    actions = walk(one.action_spec(), 14)
    for action in actions[:7]:
        one.step(action)
    state = copy.deepcopy(one.get_state())
    assert ("command" in state["task"]) == (mode in tracking.HOLDING_MODES)
    other.set_state(state)
    for action in actions[7:]:
        np.testing.assert_equal(other.step(action).observation, one.step(action).observation)
    np.testing.assert_array_equal(other.physics.data.qpos, one.physics.data.qpos)


@pytest.mark.parametrize("mode", ["joint_delta", "ee_delta_pose"])
def test_a_command_that_does_not_fit_is_refused(mode):
    environment = load("open_cabinet", mode)
    state = environment.get_state()
    del state["task"]["command"]
    with pytest.raises(ValueError, match="command"):
        environment.set_state(state)


@pytest.mark.full
@pytest.mark.parametrize(("domain", "mode"), BRIEF)
def test_copies_and_pickles_continue(domain, mode):
    env = gymnasium.make(suite.DOMAINS[domain].env_id, control_mode=mode, disable_env_checker=True).unwrapped
    env.reset(seed=3)
    actions = walk(env.environment.action_spec(), 10)
    for action in actions[:5]:
        env.step(action)
    twins = copy.deepcopy(env), pickle.loads(pickle.dumps(env))
    for action in actions[5:]:
        expected = env.step(action)
        for twin in twins:
            np.testing.assert_equal(twin.step(action)[:4], expected[:4])


@pytest.mark.full
@pytest.mark.parametrize("domain", DOMAINS)
def test_without_legacy_steps_an_episode_is_the_same(domain):
    task, options = suite.DOMAINS[domain].default_task, {"random": 0, "visuals": False, "control_mode": "ee_delta_pose"}
    environments = [suite.load(domain, task, options, {"legacy_step": legacy}) for legacy in (True, False)]
    for environment in environments:
        environment.reset()
    default, other = environments
    for action in walk(default.action_spec(), 12):
        default.step(action)
        other.step(action)
        np.testing.assert_array_equal(other.physics.data.ctrl, default.physics.data.ctrl)


@pytest.mark.full
@pytest.mark.parametrize(("mode", "calls"), [("joint_velocity", 0), ("joint_position", 0), ("joint_delta", 1)])
def test_kinematics_are_computed_only_for_modes_that_read_them(mode, calls, monkeypatch):
    environment = load("kitchen", mode)
    compute = mock.Mock(wraps=mujoco.mj_kinematics)
    monkeypatch.setattr(base.mujoco, "mj_kinematics", compute)
    environment.reset()
    assert compute.call_count == calls


ONE_OF_EACH_MODE = [
    *(("kitchen", mode) for mode in ("joint_velocity", "joint_position", "joint_delta")),
    *(("open_cabinet", mode) for mode in ("joint_offset", "ee_pose")),
    *(("microwave_table", mode) for mode in ("ee_delta_position", "ee_delta_pose")),
]


@pytest.mark.full
@pytest.mark.parametrize(("domain", "mode"), ONE_OF_EACH_MODE)
def test_spaces_are_the_specs(domain, mode):
    env = gymnasium.make(suite.DOMAINS[domain].env_id, control_mode=mode, disable_env_checker=True).unwrapped
    spec, space = env.environment.action_spec(), env.action_space
    assert (space.shape, space.dtype) == (spec.shape, np.float32)
    if hasattr(spec, "minimum"):
        np.testing.assert_array_equal(space.low, spec.minimum.astype(np.float32))
        np.testing.assert_array_equal(space.high, spec.maximum.astype(np.float32))
    assert len(spec.name.split("\t")) == spec.shape[0]


@pytest.mark.parametrize(
    ("domain", "arguments", "error", "shown"),
    [
        ("kitchen", {"control_mode": "ee_delta"}, ValueError, ["control_mode", "'ee_delta'"]),
        ("kitchen", {"control_mode": "joint_offset"}, ValueError, ["control_mode", "'joint_offset'"]),
        ("open_cabinet", {"control_mode": "joint_velocity"}, ValueError, ["'joint_velocity'"]),
        ("kitchen", {"control_mode": "ee_pose", "velocity_scale": 1.0}, ValueError, ["velocity_scale"]),
        (
            "kitchen",
            {"control_mode": "joint_delta", "feedback": "true"},
            ValueError,
            ["joint_velocity", "joint_position"],
        ),
        ("kitchen", {"linear_speed": 0.1}, ValueError, ["linear_speed", "control_mode", "ee_delta_position"]),
        ("kitchen", {"control_mode": "ee_pose", "frame": "hand"}, ValueError, ["frame"]),
        ("open_cabinet", {"control_mode": "ee_delta_pose", "gripper": "sampled"}, ValueError, ["gripper"]),
        ("kitchen", {"control_mode": "ee_delta_pose", "frame": "world"}, ValueError, ["'world'"]),
        ("kitchen", {"control_mode": "ee_delta_pose", "angular_speed": "fast"}, TypeError, ["angular_speed"]),
        (
            "kitchen",
            {"control_mode": "ee_delta_pose", "linear_speed": 1e155},
            ValueError,
            ["linear_speed", "10", "1e+155"],
        ),
        ("kitchen", {"control_mode": "ee_delta_pose", "angular_speed": 1e308}, ValueError, ["angular_speed", "10"]),
        ("kitchen", {"control_mode": "joint_delta", "joint_speed": 11}, ValueError, ["joint_speed", "10", "11"]),
        ("microwave_table", {"control_mode": "ee_pose", "speed": 1.0}, TypeError, ["'speed'"]),
    ],
)
def test_bad_arguments(domain, arguments, error, shown):
    with refused(error, *shown):
        suite.load(domain, suite.DOMAINS[domain].default_task, {"visuals": False, **arguments})


@pytest.mark.filterwarnings("error")
def test_the_greatest_speeds_neither_warn_nor_diverge():
    mode = {"control_mode": "ee_delta_pose", "linear_speed": 10, "angular_speed": 10}
    environment = suite.load("microwave_table", "open", {"visuals": False, **mode})
    environment.reset()
    for action in (np.ones(7), -np.ones(7)):
        assert np.isfinite(environment.step(action).observation["joint_positions"]).all()


@pytest.mark.full
@pytest.mark.parametrize("mode", ["joint_delta", "ee_delta_position", "ee_pose"])
def test_bad_actions(mode):
    environment = load("kitchen", mode)
    size = environment.action_spec().shape[0]
    with pytest.raises(ValueError, match=f"action must have shape .{size},."):
        environment.step(np.zeros(9 if size != 9 else 8))
    with pytest.raises(ValueError, match="action must be finite"):
        environment.step(np.full(size, np.nan))


def problem(rows, seed=0):
    """A random problem of inverse kinematics with joint limits near the present positions."""
    rng = np.random.default_rng(seed)
    jacobian = inverse_kinematics.jacobian(
        rng.normal(size=(rows, 3)), rng.normal(size=(rows, 7, 3)), rng.normal(size=(rows, 7, 3))
    )
    error, posture = 0.1 * rng.normal(size=(rows, 6)), 0.01 * rng.normal(size=(rows, 7))
    return jacobian, error, posture, -rng.uniform(0.0, 0.1, (rows, 7)), rng.uniform(0.0, 0.1, (rows, 7))


def test_a_row_of_many_problems_has_the_solution_of_one():
    many = problem(33)
    solved = inverse_kinematics.joint_step(*many)
    for row in range(33):
        np.testing.assert_array_equal(inverse_kinematics.joint_step(*(array[row] for array in many)), solved[row])


def test_steps_stay_within_the_joint_limits_and_reach_the_target_without_them():
    jacobian, error, posture, low, high = problem(200)
    step = inverse_kinematics.joint_step(jacobian, error, posture, low, high)
    assert ((step >= low) & (step <= high)).all()
    free = inverse_kinematics.joint_step(jacobian, error, posture, np.full_like(low, -9.0), np.full_like(high, 9.0))
    reached = (jacobian @ free[..., np.newaxis])[..., 0]
    assert np.median(np.linalg.norm(reached - error, axis=1)) < 0.01
    # With a joint fixed at its limit, the others make up for it: nearer to the target than a step that is clipped.
    clipped = np.clip(free, low, high)
    errors = [np.linalg.norm((jacobian @ each[..., np.newaxis])[..., 0] - error, axis=1) for each in (step, clipped)]
    assert np.mean(errors[0]) < np.mean(errors[1])


def test_rotations():
    rng = np.random.default_rng(0)
    vectors = rng.uniform(-1.7, 1.7, (50, 3))
    vectors[0] = 0.0
    quaternions = poses.quaternion(vectors)
    np.testing.assert_allclose(poses.rotation_vector(quaternions), vectors, atol=1e-12)
    np.testing.assert_allclose(poses.rotation_vector(-quaternions), vectors, atol=1e-12)
    points = rng.normal(size=(50, 3))
    np.testing.assert_allclose(poses.rotated(poses.inverse(quaternions), poses.rotated(quaternions, points)), points)
    matrix = [np.cos(0.3), -np.sin(0.3), np.sin(0.3), np.cos(0.3)]
    turned_x = poses.rotated(poses.quaternion(np.array([0.0, 0.0, 0.3])), np.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose(turned_x, [matrix[0], matrix[2], 0.0])
    near = poses.within(np.array([[0.0, 0.0, 0.0], [3.0, 4.0, 0.0], [0.01, 0.0, 0.0]]), 0.5)
    np.testing.assert_allclose(near, [[0.0, 0.0, 0.0], [0.3, 0.4, 0.0], [0.01, 0.0, 0.0]])


def test_cross_products_are_those_of_numpy_to_the_bit():
    random = np.random.RandomState(0)
    for shape, other in (((3,), (3,)), ((5, 3), (3,)), ((4, 7, 3), (4, 1, 3))):
        one, two = random.normal(size=shape), random.normal(size=other)
        np.testing.assert_array_equal(poses.cross(one, two), np.cross(one, two))
