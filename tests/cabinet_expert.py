"""Policies of the open_cabinet tests: the shipped expert, and scripts that push or drag the drawer."""

import mink
import numpy as np

from kitchen_suite import experts
from kitchen_suite.entities import PANDA, OpenCabinetArena
from kitchen_suite.policies.experts.kinematics import ArmKinematics
from kitchen_suite.policies.experts.skills import HandOrientation, Move, Skill
from kitchen_suite.policies.experts.trajectories import JointSpeedLimits, JointTrajectory, plan
from kitchen_suite.tasks.open_cabinet.mdp import CONTROL_TIMESTEP
from kitchen_suite.tasks.open_cabinet.task import DEFAULT_POSE

# Gripper logit at which the gripper opens almost surely.
OPEN = -50.0

_FORWARD = HandOrientation(approach=(0.0, 0.0, 1.0), spread=(0.0, 1.0, 0.0))


def opening_policy(env):
    """The expert for an environment, as a policy of time steps."""
    return experts.make_policy(env, np.random.default_rng(0))


def pushing_script(env):
    """Actions without end that press the open gripper on the drawer's front, beside the handle, and rub up and down."""
    # In the handle's frame: y is up, z points into the cabinet, whose front is 0.04 m behind the handle.
    beside, heights = (-0.17, 0.0, -0.05), [*[0.03, -0.03] * 4, 0.0]
    positions = [beside, *((-0.17, height, 0.045) for height in (0.0, *heights))]
    return _script(env, positions, OPEN)


def dragging_script(env):
    """Actions without end that press the closed fingers on the bar from above and drag it along."""
    positions = [(0.0, 0.05, -0.08), (0.0, 0.05, 0.0), (0.0, 0.006, 0.0), (0.0, 0.006, -0.36)]
    return _script(env, positions, -OPEN)


def _script(env, positions, gripper):
    """Yields actions without end that move the hand through positions in the handle's frame."""
    handle = env.physics.bind(env.task.scene.cabinet.handle_site(env.task.drawer))
    frame = mink.SE3.from_rotation_and_translation(
        mink.SO3.from_matrix(np.array(handle.xmat).reshape(3, 3)), np.array(handle.xpos)
    )
    joints = env.physics.bind(env.task.scene.robot.joints[:7])
    gains = [link.actuator.gain for link in PANDA.links]
    kinematics = ArmKinematics(OpenCabinetArena, PANDA)
    limits = JointSpeedLimits(joint_speed=np.full(7, 0.01), timestep=CONTROL_TIMESTEP)
    skill = Skill(
        moves=tuple(Move(position=position, orientation=_FORWARD, speed=0.1) for position in positions),
        ik_seed=tuple(DEFAULT_POSE[:7].tolist()),
    )
    start = JointTrajectory.stationary(joints.qpos.copy(), 0.0)
    trajectory = start.then(plan(kinematics, limits, skill, frame=frame), limits)
    step = 0
    while True:
        step += 1
        target, _ = trajectory.at(step)
        yield np.append(target - joints.qpos + kinematics.gravity(joints.qpos.copy()) / gains, gripper)


def pads_on_bar(env):
    """Whether both pads touch the drawer's bar now."""
    task, physics = env.task, env.physics
    bar = physics.bind(task.scene.cabinet.handle_geoms(task.drawer)[0]).element_id
    touching = {frozenset(pair) for pair in physics.data.contact.geom}
    pads = [task.scene.robot.finger_geoms(side)[0] for side in ("left", "right")]
    return all(frozenset((bar, physics.bind(pad).element_id)) in touching for pad in pads)


def pulling_episode(env, build):
    """One episode: opening at its end, fraction of the pulling steps with both pads on the bar, actions.

    Pulling steps are those in which the drawer opens faster than 1 cm/s. `build` builds the policy after the reset.
    """
    timestep = env.reset()
    act = build(env)
    holding, actions = [], []
    while not timestep.last():
        actions.append(act(timestep))
        timestep = env.step(actions[-1])
        if timestep.observation["drawer_velocity"][0] > 0.01:
            holding.append(pads_on_bar(env))
    assert timestep.discount == 1.0
    return env.task.drawer_opening, np.mean(holding) if holding else 0.0, actions
