"""The mathematics of the control modes: formulas, limits, frames and arguments, for one simulation and for many."""

import dataclasses
import json
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from dm_control import mjcf
from dm_env import specs
from helpers.errors import refused
from scipy.spatial.transform import Rotation

from kitchen_suite.entities import PANDA, Robot
from kitchen_suite.tasks.control_modes import end_effector, joints
from kitchen_suite.tasks.control_modes.action_mode import MEDIAN
from kitchen_suite.tasks.kitchen import control_modes as kitchen

# Limits of the Panda's joints [rad, m].
LOW = np.array([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973, 0.0, 0.0])
HIGH = np.array([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973, 0.04, 0.04])

# Servos that differ from joint to joint, whose targets may exceed the joint limits.
GAIN, DAMPING, VELOCITY_GAIN = (np.linspace(*ends, 7) for ends in ((100.0, 400.0), (2.0, 8.0), (7.0, 4.0)))
LAG = (DAMPING + VELOCITY_GAIN) / GAIN
CTRL_LOW, CTRL_HIGH = LOW[:7] - 1.0, HIGH[:7] + np.linspace(1.0, 1.6, 7)

# Fingers that do not close completely [m].
CLOSED, OPEN = 0.01, 0.035

# Joint positions far from all limits [rad].
MIDDLE = np.array([0.3, -0.6, 0.2, -1.9, -0.4, 1.7, 0.8])

# Control steps [s]: the end effector's response is 1.25 of the long one, and the shortest response for the short one.
LONG, SHORT = 0.08, 0.02
RESPONSES = {LONG: 0.1, SHORT: 0.05}

QUARTER_TURN = Rotation.from_rotvec([0.0, 0.0, np.pi / 2.0])


class Fields:
    """Stand-in for one simulation, or for as many as `shape` says: fields of MuJoCo's data."""

    def __init__(self, shape=(), **fields):
        self._leading, self.fields = (slice(None),) * len(shape), fields

    def read(self, field, columns, order="C"):
        return self.fields[field][(*self._leading, columns)]


def specification():
    """Returns a robot whose servos differ from joint to joint."""

    def load(*, visuals):
        model = PANDA.load(visuals=visuals)
        for i, (joint, servo) in enumerate(PANDA.servos.items()):
            model.find("joint", joint).damping = DAMPING[i]
            model.find("actuator", servo).set_attributes(
                kp=GAIN[i], kv=VELOCITY_GAIN[i], ctrlrange=(CTRL_LOW[i], CTRL_HIGH[i])
            )
        for finger in PANDA.fingers:
            model.find("joint", finger).range = (CLOSED, OPEN)
        return model

    return dataclasses.replace(PANDA, load=load, closed=CLOSED, open=OPEN)


@pytest.fixture(scope="module")
def scene():
    """A robot on a base that is moved and turned; a free body and a hinge come first in all of MuJoCo's arrays."""
    root, robot = mjcf.RootElement(model="scene"), Robot(specification(), visuals=False)
    free, swinging = (root.worldbody.add("body", pos=(x, 0.0, 0.0)) for x in (3.0, -3.0))
    for body in (free, swinging):
        body.add("inertial", pos=(0.0, 0.0, 0.0), mass=1.0, diaginertia=(1.0, 1.0, 1.0))
        body.add("site")
    free.add("freejoint")
    root.actuator.add("position", joint=swinging.add("joint", type="hinge", name="hinge"), kp=1.0)
    frame = root.attach(robot.mjcf_model)
    frame.pos = (0.5, -0.4, 0.2)
    frame.quat = np.roll(QUARTER_TURN.as_quat(), 1)
    return SimpleNamespace(physics=mjcf.Physics.from_mjcf_model(root), robot=robot)


READ = ["qpos", "qvel", "qfrc_bias", "xpos", "xquat", "site_xpos", "xanchor", "xaxis"]


@dataclasses.dataclass
class State:
    """The scene at some joint positions: fields of MuJoCo's data, and what MuJoCo computes of the end effector."""

    fields: dict[str, np.ndarray]
    jacobian: np.ndarray
    position: np.ndarray
    orientation: Rotation

    @property
    def arm(self):
        return self.fields["qpos"][8:15]

    @property
    def hold(self):
        """Offsets of the servos' targets that hold the arm."""
        return self.fields["qfrc_bias"][7:14] / GAIN


def state(scene, arm=MIDDLE):
    """Returns the scene's state with the arm at some joint positions."""
    physics, robot = scene.physics, scene.robot
    with physics.reset_context():
        physics.bind(robot.joints).qpos = [*arm, 0.02, 0.03]
    model, data, site = physics.model.ptr, physics.data.ptr, physics.bind(robot.end_effector).element_id
    linear, angular = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    mujoco.mj_jacSite(model, data, linear, angular, site)
    return State(
        fields={name: np.array(getattr(data, name)) for name in READ},
        jacobian=np.concatenate([linear, angular])[:, 7:14],
        position=np.array(data.site_xpos[site]),
        orientation=Rotation.from_matrix(np.reshape(data.site_xmat[site], (3, 3))),
    )


def simulation(*states):
    """Returns the simulation of one state, or of many."""
    if len(states) == 1:
        return Fields(**states[0].fields)
    return Fields((len(states),), **{name: np.stack([each.fields[name] for each in states]) for name in READ})


def bound(mode, scene, timestep=LONG):
    mode.bind(scene.physics, scene.robot, timestep)
    return mode


def as_rotation(quaternion):
    """Returns the rotations of quaternions w, x, y, z."""
    return Rotation.from_quat(np.roll(quaternion, -1, axis=-1))


def assert_turned(quaternion, expected):
    """Checks unit quaternions, of which q and -q are the same orientation."""
    np.testing.assert_allclose(np.linalg.norm(quaternion, axis=-1), 1.0, atol=1e-12)
    np.testing.assert_allclose(as_rotation(quaternion).as_matrix(), expected.as_matrix(), atol=1e-12)


def close(actual, expected):
    np.testing.assert_allclose(actual, expected, rtol=1e-10, atol=1e-12)


# Constants.


def test_the_panda_starts_with_the_hand_before_it_and_open():
    close(joints.DEFAULT_POSE * 6.0 / np.pi, np.array([0, -1, 0, -5.2, 0, 6.2, -1.5, *[0.24 / np.pi] * 2]))
    close([joints.JOINT_LOW, joints.JOINT_HIGH], [LOW[:8], HIGH[:8]])
    assert (joints.GRIPPER_CLOSED, joints.GRIPPER_OPEN) == (0.0, 0.04)


def test_the_kitchen_has_forty_steps_of_physics_in_a_control_step():
    close(kitchen.CONTROL_TIMESTEP / kitchen.PHYSICS_TIMESTEP, 40.0)


# Arguments.


@pytest.mark.parametrize(
    ("mode", "arguments"),
    [
        (joints.JointOffset, ["sampled"]),
        (joints.JointDelta, [1.0]),
        (end_effector.EndEffectorDeltaPosition, [0.25, "base"]),
        (end_effector.EndEffectorDeltaPose, [0.25, 1.0, "base"]),
        (kitchen.JointVelocity, [2.0, "observed"]),
        (kitchen.KitchenJointPosition, ["observed"]),
    ],
)
def test_settings_have_defaults_and_are_named(mode, arguments):
    assert [*mode().settings.values()] == arguments
    with pytest.raises(TypeError):
        mode(*arguments)


@pytest.mark.parametrize(
    ("mode", "argument"),
    [
        (joints.JointDelta, "joint_speed"),
        (end_effector.EndEffectorDeltaPosition, "linear_speed"),
        (end_effector.EndEffectorDeltaPose, "linear_speed"),
        (end_effector.EndEffectorDeltaPose, "angular_speed"),
    ],
)
def test_speeds_are_positive_and_at_most_ten(mode, argument):
    for speed in (1e-3, 10.0):
        assert mode(**{argument: speed}).settings[argument] == speed
    for speed in (0.0, -1.0, 10.5, np.inf):
        with refused(ValueError, argument, str(speed)):
            mode(**{argument: speed})


@pytest.mark.parametrize(
    ("mode", "argument", "choices"),
    [
        (joints.JointOffset, "gripper", ["sampled", "deterministic"]),
        (end_effector.EndEffectorDeltaPosition, "frame", ["base", "hand"]),
        (end_effector.EndEffectorDeltaPose, "frame", ["base", "hand"]),
        (kitchen.JointVelocity, "feedback", ["observed", "true", "target"]),
        (kitchen.KitchenJointPosition, "feedback", ["observed", "true", "target"]),
    ],
)
def test_choices_are_listed(mode, argument, choices):
    assert [mode(**{argument: choice}).settings[argument] for choice in choices] == choices
    with refused(ValueError, argument, "'odd'", *map(repr, choices)):
        mode(**{argument: "odd"})


def test_the_velocity_of_a_unit_is_not_negative():
    with refused(ValueError, "velocity_scale", "-0.5"):
        kitchen.JointVelocity(velocity_scale=-0.5)


def test_an_end_effector_mode_must_say_which_pose_an_action_requests():
    with pytest.raises(TypeError, match="_requested"):
        end_effector.EndEffectorMode()


# Specs.

ARM_NAMES = [f"franka/joint{i}" for i in range(1, 8)]
LEFT, RIGHT = "franka/finger_joint1", "franka/finger_joint2"


@pytest.mark.parametrize(
    ("mode", "names"),
    [
        (joints.JointDelta(), [*ARM_NAMES, "gripper"]),
        (end_effector.EndEffectorDeltaPosition(), ["x", "y", "z", "gripper"]),
        (
            end_effector.EndEffectorDeltaPose(),
            ["x", "y", "z", "rotation_x", "rotation_y", "rotation_z", "gripper"],
        ),
        (
            end_effector.EndEffectorPose(),
            ["x", "y", "z", "quaternion_w", "quaternion_x", "quaternion_y", "quaternion_z", "gripper"],
        ),
        (kitchen.JointVelocity(), [*ARM_NAMES, LEFT, RIGHT]),
    ],
)
def test_actions_in_units_have_names_and_bounds(scene, mode, names):
    spec = mode.spec(scene.robot)
    assert spec.name.split("\t") == names
    assert spec.shape == (len(names),)
    assert spec.minimum.tolist() == [-1.0] * len(names)
    assert spec.maximum.tolist() == [1.0] * len(names)


@pytest.mark.parametrize(
    ("mode", "names", "low", "high"),
    [
        (joints.JointPosition(), [*ARM_NAMES, LEFT], [*LOW[:7], CLOSED], [*HIGH[:7], OPEN]),
        (
            kitchen.KitchenJointPosition(),
            [*ARM_NAMES, LEFT, RIGHT],
            [-2.9, -1.8, -2.9, -3.1, -2.9, 0.0, -2.9, 0.0, 0.0],
            [2.9, 1.8, 2.9, 0.0, 2.9, 3.8, 2.9, 0.04, 0.04],
        ),
    ],
)
def test_positions_are_bounded(scene, mode, names, low, high):
    spec = mode.spec(scene.robot)
    assert spec.name.split("\t") == names
    np.testing.assert_array_equal(spec.minimum, low)
    np.testing.assert_array_equal(spec.maximum, high)


def test_joint_offsets_are_unbounded(scene):
    spec = joints.JointOffset().spec(scene.robot)
    assert (spec.shape, spec.dtype, spec.name.split("\t")) == ((8,), np.float64, [*ARM_NAMES, LEFT])
    assert not isinstance(spec, specs.BoundedArray)


# Joints.


def test_offsets_are_from_present_positions_and_end_at_the_limits(scene):
    mode = bound(joints.JointOffset(gripper="deterministic"), scene)
    states = [state(scene), state(scene, MIDDLE + 0.1)]
    offset = np.array([0.1, -0.2, 0.3, -0.4, 0.5, 0.6, -0.7, 2.0])
    actions = np.array([offset, -offset])
    target, command = mode.control(simulation(*states), None, (), actions, MEDIAN)
    close(target, [[*MIDDLE + offset[:7], 0.0, 0.0], [*MIDDLE + 0.1 - offset[:7], 0.04, 0.04]])
    assert command == ()
    for far, ends in ((50.0, [*HIGH[:7], 0.0, 0.0]), (-50.0, [*LOW[:7], 0.04, 0.04])):
        np.testing.assert_array_equal(mode.control(simulation(states[0]), None, (), np.full(8, far), MEDIAN)[0], ends)


def test_a_draw_below_the_closing_probability_closes_both_fingers(scene):
    mode = bound(joints.JointOffset(), scene)
    action = np.array([*np.zeros(7), 1.0])
    # The probability is 1 / (1 + 1 / e) = 0.731.
    many = mode.control(simulation(*[state(scene)] * 2), None, (), np.stack([action] * 2), np.array([0.70, 0.76]))[0]
    assert many[:, 7:].tolist() == [[0.0, 0.0], [0.04, 0.04]]
    for draw, finger in ((0.70, 0.0), (0.76, 0.04)):
        alone = mode.control(simulation(state(scene)), None, (), action, draw)[0]
        assert alone[7:].tolist() == [finger, finger]


def test_closing_is_drawn_or_decided():
    # Settings that come from a file are equal to the names here, but other objects.
    assert joints.JointOffset(gripper=json.loads('"sampled"')).draws
    assert not joints.JointOffset(gripper=json.loads('"deterministic"')).draws


def test_the_closing_probability_is_the_logistic_function():
    logits = np.array([-3.0, -0.5, 0.0, 0.5, 3.0])
    close(joints.closing_probability(logits), 1.0 / (1.0 + np.exp(-logits)))
    with np.errstate(over="raise"):
        assert joints.closing_probability(np.array([-1e5, 1e5])).tolist() == [0.0, 1.0]
    assert joints.gripper_target(np.array([-1.0, 1.0])).tolist() == [0.04, 0.0]
    # A draw of 0 does not close what closes with probability 0.
    assert joints.gripper_target(-1e5, 0.0) == 0.04


def test_joint_positions_are_targets_within_the_limits(scene):
    mode = bound(joints.JointPosition(), scene)
    inside = np.array([*MIDDLE, 0.02])
    target, command = mode.control(None, None, (), np.array([inside, inside + 10.0, inside - 10.0]), MEDIAN)
    expected = [[*MIDDLE, 0.02, 0.02], [*HIGH[:7], OPEN, OPEN], [*LOW[:7], CLOSED, CLOSED]]
    np.testing.assert_array_equal(target, expected)
    np.testing.assert_array_equal(mode.control(None, None, (), inside, MEDIAN)[0], expected[0])
    assert command == ()


def test_joint_commands_start_at_the_present_positions(scene):
    states = [state(scene), state(scene, MIDDLE + 0.1)]
    mode = bound(joints.JointDelta(), scene)
    many = simulation(*states)
    command = mode.start(many)
    # A command does not change with the simulation.
    many.fields["qpos"][:] = 9.0
    np.testing.assert_array_equal(command.positions, [MIDDLE, MIDDLE + 0.1])
    np.testing.assert_array_equal(mode.start(simulation(states[0])).positions, MIDDLE)


def test_joint_deltas_change_the_command_and_servos_hold_the_arm(scene):
    mode = bound(joints.JointDelta(joint_speed=2.0), scene)
    shares = np.array([0.5, -0.5, 1.0, -1.0, 0.25, 3.0, -3.0, 0.5])
    # At 2 rad/s, for 0.08 s; shares beyond 1 count as 1.
    change = 0.16 * np.array([0.5, -0.5, 1.0, -1.0, 0.25, 1.0, -1.0])
    states, ahead = [state(scene), state(scene, MIDDLE + 0.1)], np.linspace(-0.1, 0.1, 7)
    commands = np.array([each.arm + ahead for each in states])
    target, command = mode.control(
        simulation(*states), None, joints.JointCommand(commands), np.stack([shares] * 2), MEDIAN
    )
    close(command.positions, commands + change)
    close(target[:, :7], [commands[i] + change + states[i].hold for i in range(2)])
    assert np.abs([each.hold for each in states]).max() > 0.01
    alone, _ = mode.control(simulation(states[0]), None, joints.JointCommand(commands[0]), shares, MEDIAN)
    np.testing.assert_array_equal(alone, target[0])


def delta(scene, arm, command, share=0.0, speed=1.0):
    """Returns the commanded positions that a control step of `joint_delta` leaves."""
    action = np.full(8, share)
    mode, start = bound(joints.JointDelta(joint_speed=speed), scene), joints.JointCommand(np.asarray(command))
    return mode.control(simulation(state(scene, arm)), None, start, action, MEDIAN)[1].positions


def test_joint_commands_stay_near_their_joints_and_within_the_limits(scene):
    close(delta(scene, MIDDLE, MIDDLE, 1.0, speed=10.0), MIDDLE + 0.3)
    close(delta(scene, MIDDLE, MIDDLE, -1.0, speed=10.0), MIDDLE - 0.3)
    close(delta(scene, HIGH[:7] - 0.1, HIGH[:7], 1.0), HIGH[:7])
    close(delta(scene, LOW[:7] + 0.1, LOW[:7], -1.0), LOW[:7])
    # A joint beyond its limit may stay, but go no further.
    close(delta(scene, HIGH[:7] + 0.2, HIGH[:7] + 0.2), HIGH[:7] + 0.2)
    close(delta(scene, LOW[:7] - 0.2, LOW[:7] - 0.2), LOW[:7] - 0.2)
    close(delta(scene, HIGH[:7] + 0.2, HIGH[:7] + 0.2, 1.0), HIGH[:7] + 0.2)
    close(delta(scene, LOW[:7] - 0.2, LOW[:7] - 0.2, -1.0), LOW[:7] - 0.2)


def test_servo_targets_stay_within_their_ranges(scene):
    servos, here = joints.ArmServos(scene.physics, scene.robot), state(scene)
    close(servos.lag, LAG)
    close([servos.low, servos.high], [LOW[:7], HIGH[:7]])
    for sign, ends in ((1.0, CTRL_HIGH), (-1.0, CTRL_LOW)):
        here.fields["qfrc_bias"][7:14] = sign * 1e5
        close(servos.target(simulation(here), MIDDLE), ends)


@pytest.mark.parametrize(("share", "finger"), [(-1.0, OPEN), (1.0, CLOSED), (0.0, 0.0225), (0.5, 0.01625), (7.0, 0.01)])
def test_the_gripper_is_linear_from_open_to_closed(scene, share, finger):
    start = state(scene)
    for mode in (joints.JointDelta(), end_effector.EndEffectorDeltaPose(), end_effector.EndEffectorPose()):
        bound(mode, scene)
        action = np.full(mode.spec(scene.robot).shape, 0.5)
        action[-1] = share
        target, _ = mode.control(simulation(start), None, mode.start(simulation(start)), action, MEDIAN)
        assert target.shape == (9,)
        close(target[7:], [finger, finger])


# End effector.


@pytest.mark.parametrize("timestep", [LONG, SHORT])
def test_the_arm_moves_by_the_step_that_reaches_error_and_posture(scene, timestep):
    """Where one joint step leads to both, it is the step, whatever the damping."""
    arm, response = end_effector.ArmKinematics(scene.physics, scene.robot, timestep), RESPONSES[timestep]
    states = [state(scene), state(scene, MIDDLE + 0.1)]
    steps = np.random.default_rng(0).uniform(-0.02, 0.02, (2, 7))
    errors = np.array([each.jacobian @ step for each, step in zip(states, steps, strict=True)])
    # The posture is approached at 0.25 / s.
    postures = np.array([each.arm for each in states]) + steps / (0.25 * response)
    expected = [each.arm + LAG / response * step + each.hold for each, step in zip(states, steps, strict=True)]
    close(arm.target(simulation(*states), errors, postures), expected)
    close(arm.target(simulation(states[1]), errors[1], postures[1]), expected[1])


@pytest.mark.parametrize(
    ("inside", "step", "expected"),
    [
        # Joints stop at their limits.
        (0.01, 0.05, 0.01),
        # Beyond them, they go no further, but may come back.
        (-0.02, 0.05, 0.0),
        (-0.02, -0.05, -0.05),
    ],
)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_arms_steps_end_at_the_joint_limits(scene, inside, step, expected, sign):
    """Each joint in turn, in a simulation of its own."""
    limit = HIGH if sign > 0.0 else LOW
    arms = np.tile(MIDDLE, (7, 1))
    np.fill_diagonal(arms, limit[:7] - sign * inside)
    states, steps = [state(scene, arm) for arm in arms], sign * step * np.eye(7)
    errors = np.array([each.jacobian @ step for each, step in zip(states, steps, strict=True)])
    target = end_effector.ArmKinematics(scene.physics, scene.robot, LONG).target(
        simulation(*states), errors, arms + steps / (0.25 * 0.1)
    )
    moved = (target - [each.hold for each in states] - arms) * 0.1 / LAG
    close(np.diag(moved), np.full(7, sign * expected))


def test_pose_commands_start_at_the_present_pose(scene):
    states = [state(scene), state(scene, MIDDLE + 0.1)]
    mode, many = bound(end_effector.EndEffectorPose(), scene), simulation(*states)
    command = mode.start(many)
    alone = mode.start(simulation(states[1]))
    for field in many.fields.values():
        field[:] = 9.0
    for i, each in enumerate(states):
        close(command.position[i], each.position)
        assert_turned(command.orientation[i], each.orientation)
        np.testing.assert_array_equal(command.posture[i], each.arm)
    for part, row in zip(alone, command, strict=True):
        np.testing.assert_array_equal(part, row[1])


def ee_command(here, offset=(0.0, 0.0, 0.0), rotation=(0.0, 0.0, 0.0), posture=MIDDLE):
    """Returns a command at some offset from the pose of the end effector, in the world."""
    orientation = Rotation.from_rotvec(rotation) * here.orientation
    return end_effector.PoseCommand(here.position + offset, np.roll(orientation.as_quat(), 1), np.asarray(posture))


def turn(frame, here, rotation=(0.0, 0.0, 0.0)):
    """Returns the rotation from an action's frame to the world, for a command from `ee_command`."""
    return QUARTER_TURN if frame == "base" else Rotation.from_rotvec(rotation) * here.orientation


OFFSET, ROTATION = np.array([0.01, -0.02, 0.03]), np.array([0.1, 0.05, -0.08])
SHARES = np.array([0.5, -3.0, 3.0])
# Of 0.25 m/s, or rad/s, for 0.08 s; shares beyond 1 count as 1.
CHANGE = 0.02 * np.array([0.5, -1.0, 1.0])


@pytest.mark.parametrize("frame", ["base", "hand"])
def test_position_changes_are_along_the_axes_of_the_frame(scene, frame):
    # A setting from a file.
    frame, here = json.loads(f'"{frame}"'), state(scene)
    start = ee_command(here, OFFSET, ROTATION)
    expected = here.position + OFFSET + turn(frame, here, ROTATION).apply(CHANGE)
    position = bound(end_effector.EndEffectorDeltaPosition(frame=frame), scene)
    _, command = position.control(simulation(here), None, start, np.array([*SHARES, 0.0]), MEDIAN)
    close(command.position, expected)
    np.testing.assert_array_equal(command.orientation, start.orientation)
    np.testing.assert_array_equal(command.posture, start.posture)
    whole = bound(end_effector.EndEffectorDeltaPose(frame=frame), scene)
    _, command = whole.control(simulation(here), None, start, np.array([*SHARES, 0, 0, 0, 0]), MEDIAN)
    close(command.position, expected)
    assert_turned(command.orientation, as_rotation(start.orientation))


@pytest.mark.parametrize("frame", ["base", "hand"])
def test_rotation_changes_are_about_the_axes_of_the_frame(scene, frame):
    here = state(scene)
    start = ee_command(here, OFFSET, ROTATION)
    mode = bound(end_effector.EndEffectorDeltaPose(angular_speed=0.25, frame=frame), scene)
    _, command = mode.control(simulation(here), None, start, np.array([0, 0, 0, *SHARES, 0.0]), MEDIAN)
    about = turn(frame, here, ROTATION).apply(CHANGE)
    close(command.position, here.position + OFFSET)
    assert_turned(command.orientation, Rotation.from_rotvec(about) * as_rotation(start.orientation))
    np.testing.assert_array_equal(command.posture, start.posture)


def test_speeds_scale_changes(scene):
    here = state(scene)
    mode = bound(end_effector.EndEffectorDeltaPose(linear_speed=0.5, angular_speed=2.0), scene, SHORT)
    action = np.array([1.0, 0, 0, 0, 0, 0.5, 0])
    _, command = mode.control(simulation(here), None, ee_command(here), action, MEDIAN)
    close(command.position, here.position + QUARTER_TURN.apply([0.01, 0, 0]))
    assert_turned(command.orientation, Rotation.from_rotvec([0, 0, 0.02]) * here.orientation)


def test_a_commanded_pose_is_brought_near_the_actual_one(scene):
    here = state(scene)
    far = ee_command(here, (0.3, 0.0, -0.4), (0.0, 1.2, 0.0))
    still = np.zeros(7)
    mode = bound(end_effector.EndEffectorDeltaPose(), scene)
    _, command = mode.control(simulation(here), None, far, still, MEDIAN)
    close(command.position, here.position + 0.08 * np.array([0.6, 0.0, -0.8]))
    assert_turned(command.orientation, Rotation.from_rotvec([0.0, 0.3, 0.0]) * here.orientation)
    # The orientation of the reset is kept however far the hand is turned.
    position = bound(end_effector.EndEffectorDeltaPosition(), scene)
    _, command = position.control(simulation(here), None, far, still[:4], MEDIAN)
    close(command.position, here.position + 0.08 * np.array([0.6, 0.0, -0.8]))
    np.testing.assert_array_equal(command.orientation, far.orientation)


def test_poses_are_in_the_frame_of_the_base(scene):
    mode, states = bound(end_effector.EndEffectorPose(), scene), [state(scene), state(scene, MIDDLE + 0.1)]
    base = np.array([0.5, -0.4, 0.2])
    actions, expected = [], []
    for each in states:
        position, orientation = each.position + OFFSET, Rotation.from_rotvec(ROTATION) * each.orientation
        local = QUARTER_TURN.inv().apply(position - base)
        quaternion = np.roll((QUARTER_TURN.inv() * orientation).as_quat(), 1)
        # Of any length.
        actions.append(np.array([*local, *0.5 * quaternion, 0.0]))
        expected.append((position, orientation))
    start = mode.start(simulation(*states))
    _, command = mode.control(simulation(*states), None, start, np.array(actions), MEDIAN)
    for i, (position, orientation) in enumerate(expected):
        close(command.position[i], position)
        assert_turned(command.orientation[i], orientation)
    np.testing.assert_array_equal(command.posture, start.posture)
    _, alone = mode.control(simulation(states[1]), None, ee_command(states[1]), actions[1], MEDIAN)
    close(alone.position, expected[1][0])
    assert_turned(alone.orientation, expected[1][1])


def commanded(scene, here, quaternion):
    """Returns the orientation that a control step of `ee_pose` leaves, with a quaternion in the frame of the base."""
    mode, start = bound(end_effector.EndEffectorPose(), scene), ee_command(here)
    action = np.array([0.5, 0.5, 0.5, *quaternion, 0.5])
    return mode.control(simulation(here), None, start, action, MEDIAN)[1].orientation


@pytest.mark.parametrize("quaternion", [*np.eye(4)])
def test_orientations_may_be_those_of_the_base_and_half_turns(scene, quaternion):
    here = state(scene)
    whole = (QUARTER_TURN * as_rotation(quaternion) * here.orientation.inv()).as_rotvec()
    nearer = Rotation.from_rotvec(0.3 * whole / np.linalg.norm(whole))
    assert_turned(commanded(scene, here, quaternion), nearer * here.orientation)


@pytest.mark.parametrize("length", [2e-6, -2e-6, 1.0])
def test_the_length_and_sign_of_a_quaternion_mean_nothing(scene, length):
    here, small = state(scene), Rotation.from_rotvec([1e-4, 0.0, 0.0])
    quaternion = np.roll((QUARTER_TURN.inv() * small * here.orientation).as_quat(), 1)
    assert_turned(commanded(scene, here, length * quaternion), small * here.orientation)


def damped_step(here, error, posture):
    """Returns the step `x` that minimises `|J x - error|^2 + (0.05 |x - posture|)^2`, by its normal equations."""
    jacobian = here.jacobian
    return np.linalg.solve(
        jacobian.T @ jacobian + 0.0025 * np.eye(7), jacobian.T @ error + 0.0025 * np.asarray(posture)
    )


@pytest.mark.parametrize("timestep", [LONG, SHORT])
def test_servos_drive_the_end_effector_to_the_command(scene, timestep):
    response, states = RESPONSES[timestep], [state(scene), state(scene, MIDDLE + 0.1)]
    # In short control steps, slow enough not to be limited.
    offset, rotation = (np.multiply(1.0 if timestep == LONG else 0.05, each) for each in (OFFSET, ROTATION))
    starts = [ee_command(each, offset, rotation, each.arm + 0.2) for each in states]
    many = end_effector.PoseCommand(*(np.stack(part) for part in zip(*starts, strict=True)))
    expected = [
        each.arm
        + LAG / response * damped_step(each, [*offset, *rotation], np.full(7, 0.25 * response * 0.2))
        + each.hold
        for each in states
    ]
    for mode, size in ((end_effector.EndEffectorDeltaPosition(), 4), (end_effector.EndEffectorDeltaPose(), 7)):
        bound(mode, scene, timestep)
        target, _ = mode.control(simulation(*states), None, many, np.zeros((2, size)), MEDIAN)
        close(target[:, :7], expected)
        alone, _ = mode.control(simulation(states[1]), None, starts[1], np.zeros(size), MEDIAN)
        close(alone[:7], expected[1])


def test_the_load_of_a_servo_is_the_torque_of_a_change_beside_gravity(scene):
    here, change = state(scene), np.array([0.1, -0.2, 0.3, -0.4, 0.5, -0.6, 0.0])
    servos = joints.ArmServos(scene.physics, scene.robot)
    torque = (DAMPING + VELOCITY_GAIN) * change
    gravity = here.fields["qfrc_bias"][7:14]
    greatest = np.array([87.0] * 4 + [12.0] * 3)
    # What remains of the greatest torque in the direction of the change, but no less than a fifth of it.
    room = [
        max(most - (g if t > 0.0 else -g), most / 5.0) for t, g, most in zip(torque, gravity, greatest, strict=True)
    ]
    close(servos.load(simulation(here), change), np.abs(torque) / room)
    assert servos.light.tolist() == [False] * 4 + [True] * 3
    assert servos.have_feedback


def test_a_quaternion_needs_a_length():
    mode = end_effector.EndEffectorPose()

    def action(*quaternion):
        return np.array([0.5, 0.5, 0.5, *quaternion, 0.5])

    for unit in np.eye(4):
        for length in (1e-6, -1e-6, 1e200):
            mode.check(action(*length * unit))
        mode.check(np.array([action(*unit), action(*-unit)]))
    with refused(ValueError, "quaternion", "1e-06", "5e-07"):
        mode.check(action(0.0, 5e-7, 0.0, 0.0))
    # One of many is enough.
    with refused(ValueError, "quaternion", "got 0"):
        mode.check(np.array([action(1.0, 0.0, 0.0, 0.0), action(0.0, 0.0, 0.0, 0.0)]))


# The kitchen's own modes.

NINE = np.array([0.1, -0.5, 0.2, -1.5, 0.3, 1.8, -0.4, 0.02, 0.03])
KITCHEN_LOW = np.array([-2.9, -1.8, -2.9, -3.1, -2.9, 0.0, -2.9, 0.0, 0.0])
KITCHEN_HIGH = np.array([2.9, 1.8, 2.9, 0.0, 2.9, 3.8, 2.9, 0.04, 0.04])


def kitchen_state(shape=(), **parts):
    """Returns a state of the kitchen as far as its modes read it."""
    zeros = {"noise": np.zeros((*shape, 59)), "positions": np.zeros((*shape, 9)), "target": np.zeros((*shape, 9))}
    return SimpleNamespace(**zeros | parts)


def fed_back():
    """A state in which each feedback has positions of its own, two episodes of it, and the positions by feedback."""
    noise = np.concatenate([np.full(9, 0.01), np.full(50, 7.0)])
    alone = kitchen_state(positions=NINE, noise=noise, target=NINE + 0.1)
    both = kitchen_state((2,), positions=[NINE, NINE + 0.2], noise=[noise, -noise], target=[NINE + 0.1, NINE])
    for name, value in vars(both).items():
        setattr(both, name, np.array(value))
    rows = {"observed": [NINE + 0.01, NINE + 0.19], "true": [NINE, NINE + 0.2], "target": [NINE + 0.1, NINE]}
    return alone, both, rows


@pytest.mark.parametrize("feedback", ["observed", "true", "target"])
def test_velocities_are_integrated_from_the_feedback(feedback):
    alone, both, rows = fed_back()
    shares = np.array([0.5, -0.5, 1.0, -1.0, 2.0, -2.0, 0.0, 0.01, -0.01])
    # Of 1.5 rad/s, for 0.08 s; shares beyond 1 count as 1.
    change = 0.12 * np.array([0.5, -0.5, 1.0, -1.0, 1.0, -1.0, 0.0, 0.01, -0.01])
    expected = [np.clip(row + change, KITCHEN_LOW, KITCHEN_HIGH) for row in rows[feedback]]
    mode = kitchen.JointVelocity(velocity_scale=1.5, feedback=json.loads(f'"{feedback}"'))
    target, command = mode.control(None, both, (), np.stack([shares] * 2), MEDIAN)
    close(target, expected)
    assert command == ()
    close(mode.control(None, alone, (), shares, MEDIAN)[0], expected[0])


@pytest.mark.parametrize("feedback", ["observed", "true", "target"])
def test_positions_are_at_most_as_far_from_the_feedback_as_the_greatest_velocity_leads(feedback):
    alone, both, rows = fed_back()
    mode = kitchen.KitchenJointPosition(feedback=json.loads(f'"{feedback}"'))
    wanted = NINE + np.array([0.7, -0.7, 1.5, -1.5, 0.2, -0.2, 0.0, 0.001, -0.001])
    # At 10 rad/s, for 0.08 s.
    expected = [np.clip(np.clip(wanted, row - 0.8, row + 0.8), KITCHEN_LOW, KITCHEN_HIGH) for row in rows[feedback]]
    target, command = mode.control(None, both, (), np.stack([wanted] * 2), MEDIAN)
    close(target, expected)
    assert command == ()
    close(mode.control(None, alone, (), wanted, MEDIAN)[0], expected[0])


def integrated(positions, action, **settings):
    return kitchen.position_target(
        np.asarray(positions), np.asarray(action), **{"velocity_scale": 2.0, "timestep": 0.1, **settings}
    )


def test_velocities_are_limited():
    close(integrated(np.zeros(9), np.full(9, 0.05), velocity_scale=8.0)[0], 0.04)
    close(integrated(NINE, np.full(9, 1.0), velocity_scale=5.0)[0], NINE[0] + 0.5)
    # At most 10 rad/s, which a scale of 20 reaches with half a unit.
    shares = np.array([0.25, 0.75, 1.0, -0.25, -0.75, -1.0, 0.0, 0.0, 0.0])
    speeds = np.array([5.0, 10.0, 10.0, -5.0, -10.0, -10.0, 0.0, 0.0, 0.0])
    close(integrated(NINE, shares, velocity_scale=20.0), np.clip(NINE + 0.1 * speeds, KITCHEN_LOW, KITCHEN_HIGH))


def test_targets_of_velocities_end_at_the_limits():
    np.testing.assert_array_equal(integrated(np.full(9, 10.0), np.ones(9)), KITCHEN_HIGH)
    np.testing.assert_array_equal(integrated(np.full(9, -10.0), np.ones(9)), KITCHEN_LOW)
    many = integrated(np.array([np.full(9, 10.0), NINE]), np.zeros((2, 9)))
    np.testing.assert_array_equal(many, [KITCHEN_HIGH, NINE])


def test_velocity_scale_and_timestep_are_named():
    with pytest.raises(TypeError):
        kitchen.position_target(NINE, NINE, 2.0, 0.08)


def test_actions_of_default_velocities_become_positions():
    mode = kitchen.KitchenJointPosition()
    observed = np.concatenate([NINE, np.full(50, 7.0)])
    action = np.array([0.5, -0.5, 1.0, -1.0, 2.0, -2.0, 0.0, 0.01, -0.01])
    default, _ = kitchen.JointVelocity().control(None, kitchen_state(positions=NINE), (), action, MEDIAN)
    converted = mode.conversion(json.loads('"joint_velocity"'))(observed, action)
    np.testing.assert_array_equal(converted, default)
    close(converted[0], NINE[0] + 0.08)
    for other in ("joint_position", "ee_pose", "velocity"):
        assert mode.conversion(other) is None
