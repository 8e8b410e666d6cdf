"""The open_cabinet domain: scripted policies, and observation and reward recomputed from MuJoCo's named arrays."""

import types

import mink
import numpy as np
from dm_control.composer.variation import distributions
from scipy.spatial.transform import Rotation

from kitchen_suite import experts, suite
from kitchen_suite.entities import PANDA, OpenCabinetArena
from kitchen_suite.policies.experts.kinematics import ArmKinematics
from kitchen_suite.policies.experts.skills import HandOrientation, Move, Skill
from kitchen_suite.policies.experts.trajectories import JointSpeedLimits, JointTrajectory, plan
from kitchen_suite.tasks.control_modes.joints import DEFAULT_POSE
from kitchen_suite.tasks.open_cabinet import rewards as reward
from kitchen_suite.tasks.open_cabinet.mdp import CONTROL_TIMESTEP

# Variations of the cabinet and the pads about their default values, for tasks of the top drawer [m, rad, N, N s/m, 1].
VARIED = {
    "cabinet/offset": distributions.Uniform((-0.03, -0.05, 0.0), (0.03, 0.05, 0.0)),
    "cabinet/yaw": distributions.Uniform(-0.1, 0.1),
    "cabinet/drawer_top_friction": distributions.Uniform(2.5, 4.0),
    "cabinet/drawer_top_damping": distributions.Uniform(10.0, 20.0),
    "franka/pad_friction": distributions.Uniform(1.2, 1.8),
}

# Gripper logit at which the gripper opens almost surely.
OPEN = -50.0

_FORWARD = HandOrientation(approach=(0.0, 0.0, 1.0), spread=(0.0, 1.0, 0.0))


def load(task="top_drawer", **options):
    """Returns the environment of a task, without visuals and with the seed 0 unless another is given."""
    return suite.load("open_cabinet", task, {"random": 0, "visuals": False, **options})


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
    gains = env.task.scene.robot.gains
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
    return all(frozenset((bar, physics.bind(pad).element_id)) in touching for pad in task.scene.robot.pads)


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


LOW = np.array([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973, 0.0])
HIGH = np.array([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973, 0.04])
TERMS = ["approach", "orientation", "grasp", "opening", "straddling", "effort", "termination"]
ROBOT_JOINTS = [*(f"franka/joint{i}" for i in range(1, 8)), "franka/finger_joint1", "franka/finger_joint2"]


def flat(timestep):
    return np.concatenate(list(timestep.observation.values()))


class Recomputed:
    def __init__(self, physics, drawer, change, total_steps):
        named = physics.named.data
        self.q, self.v = named.qpos[ROBOT_JOINTS], named.qvel[ROBOT_JOINTS]
        self.tcp = named.site_xpos["franka/gripper"].copy()
        self.handle = named.site_xpos[f"cabinet/drawer_{drawer}_handle"].copy()
        self.tcp_turn = Rotation.from_matrix(named.site_xmat["franka/gripper"].reshape(3, 3))
        self.handle_turn = Rotation.from_matrix(named.site_xmat[f"cabinet/drawer_{drawer}_handle"].reshape(3, 3))
        self.pad_positions = [named.geom_xpos[f"franka/{side}_finger_pad"].copy() for side in ("left", "right")]
        self.pads = [position[2] for position in self.pad_positions]
        self.open = named.qpos[f"cabinet/drawer_{drawer}_joint"].item()
        self.speed = named.qvel[f"cabinet/drawer_{drawer}_joint"].item()
        self.gripper = named.ctrl["franka/finger_joint1"].item()
        self.change, self.total_steps = change, total_steps
        self.distance = np.sqrt(((self.handle - self.tcp) ** 2).sum())

    @property
    def observation(self):
        handle, tcp = self.handle_turn.as_quat(canonical=True), self.tcp_turn.as_quat()
        tcp = tcp if handle @ tcp >= 0 else -tcp
        scaled = 2 * (self.q[:8] - LOW) / (HIGH - LOW) - 1
        parts = [scaled, self.v[:8] / 2, self.handle - self.tcp, handle - tcp, [self.open], [self.speed]]
        return np.clip(np.concatenate(parts), -5, 5)

    @property
    def terminates(self):
        return self.tcp[0] - self.handle[0] < -0.03 or abs(self.v).max() > 5

    @property
    def terms(self):
        opened = min(max(self.open, 0), 1)
        opening = 0 if opened > 0 and self.distance > 0.03 else 20 * (np.exp(opened) - 1)
        angle = (self.handle_turn * self.tcp_turn.inv()).magnitude()
        action, velocity = (1e-3, 0) if self.total_steps < 8000 else (2e-3, 2e-7)
        return {
            "approach": 10 * (1 - np.tanh(self.distance / 0.1)),
            "orientation": 1 if opening > 0 else np.cos(angle),
            "grasp": (100 if self.distance < 0.025 else -20) * (0.04 - self.gripper),
            "opening": opening,
            "straddling": min(self.pads[0] - self.handle[2], 0) + min(self.handle[2] - self.pads[1], 0),
            "effort": -action * (self.change**2).sum() - velocity * (self.v[:8] ** 2).sum(),
            "termination": -10 if self.terminates else 0,
        }


class RecomputedGrasp(Recomputed):
    """Recomputes the reward `grasp`."""

    @property
    def terms(self):
        return {
            **super().terms,
            "orientation": 4 * np.cos((self.handle_turn * self.tcp_turn.inv()).magnitude()),
            "grasp": 4 * self.enclosure * (1 - np.tanh(self.gap / 0.02))
            - 20 * (1 - self.enclosure) * (0.04 - self.gripper),
            "opening": 50 * self.holding * np.clip(self.open, 0, 1)
            + 10 * self.speed * (self.holding if self.speed > 0 else 1),
        }

    @property
    def holding(self):
        return self.enclosure * 0.001 / (0.001 + self.gap)

    @property
    def gap(self):
        return max(*self.spaces, 0)

    @property
    def enclosure(self):
        x, _, z = self.tcp_turn.inv().apply(self.nearest - self.tcp)
        along = np.linalg.norm(self.nearest - self.handle)
        shares = [3 - 3 * abs(x) / 0.0105, 3 - 3 * abs(z) / 0.0095, 3 - 3 * along / 0.03, 2 + min(self.spaces) / 0.003]
        return np.prod(np.clip(shares, 0, 1))

    @property
    def nearest(self):
        """Point of the bar's axis that is nearest to the gripper."""
        bar = self.handle_turn.as_matrix()[:, 0]
        return self.handle + bar * (bar @ (self.tcp - self.handle))

    @property
    def spaces(self):
        """Gaps between the inner faces of the pads and the bar, across the gripper."""
        inwards = [-self.tcp_turn.as_matrix()[:, 1], self.tcp_turn.as_matrix()[:, 1]]
        faces = [pad + 0.005 * inward for pad, inward in zip(self.pad_positions, inwards, strict=True)]
        return [inward @ (self.nearest - face) - 0.006 for face, inward in zip(faces, inwards, strict=True)]


def step_of(features, *, gripper, action_change, total_steps, terminated, handle_radius=0.008):
    """A control step, with what the terms of the rewards read of it."""
    before = types.SimpleNamespace(previous_action=np.zeros(8), total_steps=total_steps)
    after = types.SimpleNamespace(terminates=terminated)
    grip = reward.grip(features, handle_radius)
    return types.SimpleNamespace(
        before=before, action=action_change, after=after, features=features, gripper=gripper, grip=grip
    )


def reward_terms(rewards, features, **parts):
    """Terms of a step's reward by name; `parts` as of `step_of`."""
    step = step_of(features, **parts)
    return {name: term(step) for name, term in rewards.items()}
