"""What moves the gripper before the cabinet in tests: the shipped expert, and a script that only pushes."""

import mink
import numpy as np

from kitchen_suite import experts
from kitchen_suite.entities import PANDA
from kitchen_suite.policies.experts.kinematics import Arm
from kitchen_suite.policies.experts.skills import Hand, Move, Skill
from kitchen_suite.policies.experts.trajectories import JointSpeedLimits, Path, plan
from kitchen_suite.tasks.open_cabinet.mdp import CONTROL_TIMESTEP
from kitchen_suite.tasks.open_cabinet.task import DEFAULT_POSE

# The last element of an action that certainly opens the gripper.
OPEN = -50.0


def opening_policy(env):
    """The expert for an environment, of time steps."""
    return experts.make_policy(env, np.random.default_rng(0))


def pushing_script(env):
    """Actions that press the open gripper on the drawer's front, beside the handle, and rub up and down; no end."""
    # In the handle's frame: y is up, z points into the cabinet, whose front is 0.04 m behind the handle.
    beside, heights = (-0.17, 0.0, -0.05), [*[0.03, -0.03] * 4, 0.0]
    places = [beside, *((-0.17, height, 0.045) for height in (0.0, *heights))]
    return _script(env, places, Hand(approach=(0.0, 0.0, 1.0), spread=(0.0, 1.0, 0.0)), OPEN)


def dragging_script(env):
    """Actions that press the closed fingers on the bar from above and drag it along; no end."""
    places = [(0.0, 0.05, -0.08), (0.0, 0.05, 0.0), (0.0, 0.006, 0.0), (0.0, 0.006, -0.36)]
    return _script(env, places, Hand(approach=(0.0, 0.0, 1.0), spread=(0.0, 1.0, 0.0)), -OPEN)


def _script(env, places, hand, gripper):
    """Actions that take the hand through places in the handle's frame; no end."""
    handle = env.physics.bind(env.task.scene.cabinet.handle_site(env.task.drawer))
    frame = mink.SE3.from_rotation_and_translation(
        mink.SO3.from_matrix(np.array(handle.xmat).reshape(3, 3)), np.array(handle.xpos)
    )
    joints = env.physics.bind(env.task.scene.robot.joints[:7])
    gains = [link.actuator.gain for link in PANDA.links]
    arm, pace = Arm("open_cabinet"), JointSpeedLimits(joint_speed=np.full(7, 0.01), timestep=CONTROL_TIMESTEP)
    skill = Skill(
        steps=tuple(Move(to=place, hand=hand, speed=0.1) for place in places),
        posture=tuple(DEFAULT_POSE[:7].tolist()),
    )
    path = Path.still(joints.qpos.copy(), 0.0).then(plan(arm, pace, skill, frame=frame), pace)
    step = 0
    while True:
        step += 1
        target, _ = path.at(step)
        yield np.append(target - joints.qpos + arm.gravity(joints.qpos.copy()) / gains, gripper)


def pads_on_bar(env):
    """Whether both pads touch the drawer's bar now."""
    task, physics = env.task, env.physics
    bar = physics.bind(task.scene.cabinet.handle_geoms(task.drawer)[0]).element_id
    touching = {frozenset(pair) for pair in physics.data.contact.geom}
    pads = [task.scene.robot.finger_geoms(side)[0] for side in ("left", "right")]
    return all(frozenset((bar, physics.bind(pad).element_id)) in touching for pad in pads)


def pulling_episode(env, build):
    """One episode: opening at its end, share of the pulling steps with both pads on the bar, actions.

    Steps that the drawer opens in faster than 1 cm/s are pulling; `build` makes what acts when the episode begins.
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
