"""A script that opens a drawer by its handle: inverse kinematics (mink) for the arm, nothing but actions out."""

import mink
import numpy as np

from kitchen_suite.tasks.open_cabinet import CONTROL_TIMESTEP

# Distance before the handle from which the gripper goes straight in [m].
STANDOFF = 0.08
# Speeds of the gripper's target [m/s], [rad/s]; time to close [s]; how far to pull [m].
REACH_SPEED, TURN_SPEED, PULL_SPEED = 0.35, 1.2, 0.15
CLOSING_TIME = 0.6
PULL = 0.36
# How far the hand points down [rad]: the lower handle is out of reach for a level hand.
TILT = {"top": 0.0, "bottom": np.deg2rad(20.0)}


class DrawerScript:
    """Reaches, closes and pulls; made anew for every episode, after its reset."""

    def __init__(self, env, *, close=True):
        self._physics = env.physics
        task = env.task
        drawer = task._drawer
        self._joints = env.physics.bind(task.scene.robot.joints[:7])
        self._gains = [servo.gain for servo in task.scene.robot.servos[:7]]
        model = env.physics.model.ptr
        self._plan = mink.Configuration(model, q=env.physics.data.qpos.copy())
        site = task.scene.robot.end_effector.full_identifier
        self._frame = mink.FrameTask(site, "site", position_cost=1.0, orientation_cost=0.3, lm_damping=1e-3)
        self._limits = [mink.ConfigurationLimit(model)]
        handle = env.physics.bind(task.scene.cabinet.handle_site(drawer))
        grip = mink.SE3.from_rotation_and_translation(
            mink.SO3.from_matrix(np.array(handle.xmat).reshape(3, 3)) @ mink.SO3.from_x_radians(TILT[drawer]),
            np.array(handle.xpos),
        )
        self._outwards = -np.array(handle.xmat).reshape(3, 3)[:, 2]
        start = self._plan.get_transform_frame_to_world(site, "site")
        self._actions = self._path(start, grip, close)

    def _path(self, start, grip, close):
        """Yields the gripper's target pose and the gripper's action of every control step, without end."""

        def before(distance):
            return mink.SE3.from_translation(distance * self._outwards) @ grip

        waypoints = [(before(STANDOFF), REACH_SPEED, -50.0), (grip, 0.5 * REACH_SPEED, -50.0)]
        here = start
        for there, speed, gripper in waypoints:
            turn = np.linalg.norm((here.inverse() @ there).rotation().log()) / TURN_SPEED
            move = np.linalg.norm(there.translation() - here.translation()) / speed
            steps = int(np.ceil(max(turn, move, 0.2) / CONTROL_TIMESTEP))
            for share in np.linspace(0.0, 1.0, steps + 1)[1:]:
                yield here.interpolate(there, alpha=0.5 - 0.5 * np.cos(np.pi * share)), gripper
            here = there
        gripper = 50.0 if close else -50.0
        for _ in range(int(CLOSING_TIME / CONTROL_TIMESTEP)):
            yield grip, gripper
        for distance in np.arange(0.0, PULL, PULL_SPEED * CONTROL_TIMESTEP):
            yield before(distance), gripper
        while True:
            yield before(PULL), gripper

    def action(self):
        target, gripper = next(self._actions)
        self._frame.set_target(target)
        for _ in range(2):
            velocity = mink.solve_ik(
                self._plan, [self._frame], CONTROL_TIMESTEP, "daqp", damping=1e-6, limits=self._limits
            )
            self._plan.integrate_inplace(velocity, CONTROL_TIMESTEP)
        # The servos hold the arm against gravity by being off their targets.
        sag = self._physics.data.qfrc_bias[self._joints.dofadr] / self._gains
        arm = self._plan.q[self._joints.qposadr] - self._joints.qpos + sag
        return np.append(arm, gripper)


def pads_on_bar(env):
    """Whether the left and the right pad touch the drawer's bar now."""
    task, physics = env.task, env.physics
    bar = physics.bind(task.scene.cabinet.handle_geoms(task._drawer)[0]).element_id
    touching = {frozenset(pair) for pair in physics.data.contact.geom}
    robot = task.scene.robot.mjcf_model
    return [
        frozenset((bar, physics.bind(robot.find("geom", f"{side}_finger_pad")).element_id)) in touching
        for side in ("left", "right")
    ]
