"""Scripts that move the gripper before the cabinet: inverse kinematics (mink) for the arm, nothing but actions out."""

import mink
import numpy as np

from kitchen_suite.tasks.open_cabinet import CONTROL_TIMESTEP

# Actions of the gripper, far enough from zero to be certain.
OPEN, CLOSE = -50.0, 50.0
# Distance before the handle from which the gripper goes straight in [m].
STANDOFF = 0.08
# Speeds of the gripper's target [m/s], [rad/s]; control steps to close; how far to pull [m].
REACH_SPEED, TURN_SPEED, PULL_SPEED = 0.35, 1.2, 0.15
CLOSING_STEPS = 60
PULL = 0.36
# How far the hand points down [rad]: the lower handle is out of reach for a level hand.
TILT = {"top": 0.0, "bottom": np.deg2rad(20.0)}


class GripperMover:
    """Turns poses of the gripper into actions; made anew for every episode, after its reset."""

    def __init__(self, env):
        self._physics, robot = env.physics, env.task.scene.robot
        self._joints = env.physics.bind(robot.joints[:7])
        self._gains = [servo.gain for servo in robot.servos[:7]]
        self._plan = mink.Configuration(env.physics.model.ptr, q=env.physics.data.qpos.copy())
        self._site = robot.end_effector.full_identifier
        self._frame = mink.FrameTask(self._site, "site", position_cost=1.0, orientation_cost=0.3, lm_damping=1e-3)
        self._limits = [mink.ConfigurationLimit(env.physics.model.ptr)]

    @property
    def pose(self):
        return self._plan.get_transform_frame_to_world(self._site, "site")

    def action(self, pose, gripper):
        self._frame.set_target(pose)
        for _ in range(2):
            velocity = mink.solve_ik(
                self._plan, [self._frame], CONTROL_TIMESTEP, "daqp", damping=1e-6, limits=self._limits
            )
            self._plan.integrate_inplace(velocity, CONTROL_TIMESTEP)
        # The servos hold the arm against gravity by being off their targets.
        sag = self._physics.data.qfrc_bias[self._joints.dofadr] / self._gains
        return np.append(self._plan.q[self._joints.qposadr] - self._joints.qpos + sag, gripper)


def poses_between(start, end, speed):
    """Poses of every control step on the way, gently accelerated."""
    turn = np.linalg.norm((start.inverse() @ end).rotation().log()) / TURN_SPEED
    move = np.linalg.norm(end.translation() - start.translation()) / speed
    steps = int(np.ceil(max(turn, move, 0.2) / CONTROL_TIMESTEP))
    for share in np.linspace(0.0, 1.0, steps + 1)[1:]:
        yield start.interpolate(end, alpha=0.5 - 0.5 * np.cos(np.pi * share))


def moved(pose, x=0.0, y=0.0, z=0.0):
    return mink.SE3.from_translation(np.array([x, y, z])) @ pose


def grip_pose(env):
    """Where the gripper is to be to hold the drawer's handle."""
    drawer = env.task.drawer
    handle = env.physics.bind(env.task.scene.cabinet.handle_site(drawer))
    rotation = mink.SO3.from_matrix(np.array(handle.xmat).reshape(3, 3)) @ mink.SO3.from_x_radians(TILT[drawer])
    return mink.SE3.from_rotation_and_translation(rotation, np.array(handle.xpos))


def opening_script(env, *, close=True):
    """Actions that reach for the handle, close (unless told otherwise) and pull; without end."""
    mover, grip = GripperMover(env), grip_pose(env)
    before = moved(grip, x=STANDOFF)
    for pose in poses_between(mover.pose, before, REACH_SPEED):
        yield mover.action(pose, OPEN)
    for pose in poses_between(before, grip, REACH_SPEED / 2):
        yield mover.action(pose, OPEN)
    gripper = CLOSE if close else OPEN
    for _ in range(CLOSING_STEPS):
        yield mover.action(grip, gripper)
    for distance in np.arange(0.0, PULL, PULL_SPEED * CONTROL_TIMESTEP):
        yield mover.action(moved(grip, x=distance), gripper)
    while True:
        yield mover.action(moved(grip, x=PULL), gripper)


def pushing_script(env):
    """Actions that press the open gripper on the drawer's front, beside the handle, and rub up and down; no end."""
    mover, grip = GripperMover(env), grip_pose(env)
    beside = moved(grip, x=0.05, y=0.17)
    for pose in poses_between(mover.pose, beside, REACH_SPEED):
        yield mover.action(pose, OPEN)
    for pose in poses_between(beside, moved(beside, x=-0.095), 0.05):
        yield mover.action(pose, OPEN)
    for step in range(10_000):
        yield mover.action(moved(beside, x=-0.095, z=0.03 * np.sin(step / 30)), OPEN)


def pads_on_bar(env):
    """Whether both pads touch the drawer's bar now."""
    task, physics = env.task, env.physics
    bar = physics.bind(task.scene.cabinet.handle_geoms(task.drawer)[0]).element_id
    touching = {frozenset(pair) for pair in physics.data.contact.geom}
    pads = [task.scene.robot.finger_geoms(side)[0] for side in ("left", "right")]
    return all(frozenset((bar, physics.bind(pad).element_id)) in touching for pad in pads)
