"""A domain of one's own: the Panda pushes a lever on a table. Run: python my_domain.py."""

import dataclasses
from typing import NamedTuple

import gymnasium
import numpy as np

from kitchen_suite import suite
from kitchen_suite.entities import PANDA, MicrowaveTableArena, Prop, Robot, Scene
from kitchen_suite.tasks import (
    MDP,
    OFFSET_MODES,
    FeatureSensors,
    Observation,
    SuiteTask,
    Transition,
    make_mode,
    split_options,
)

# isort: split
# After the suite: imported first, dm_control would open a GL library at once.
from dm_control import mjcf

HOME = np.array([0.0, -0.6, 0.0, -2.4, 0.0, 1.9, 0.8, 0.04, 0.04])  # Of the arm's joints [rad] and the fingers [m].
PUSHED = 0.5  # Angle from which the lever counts as pushed [rad].


class Lever(Prop):
    """A lever of 0.2 kg that stands upright, with a spring."""

    def _build(self):
        self._mjcf_root = mjcf.RootElement(model="lever")
        arm = self._mjcf_root.worldbody.add("body", name="arm")
        arm.add("joint", name="hinge", axis=(0, 1, 0), range=(-1.2, 1.2), stiffness=0.5, damping=0.05)
        arm.add("geom", type="capsule", size=(0.012,), fromto=(0, 0, 0.03, 0, 0, 0.15), mass=0.2, rgba=(0.8, 0.5, 0, 1))
        arm.add("site", name="tip", pos=(0, 0, 0.15))

    @property
    def joints(self):
        return (self._mjcf_root.find("joint", "hinge"),)


def build_lever_scene(*, visuals=True):
    """Builds the room of the microwave_table domain, with a lever in place of the microwave."""
    arena = MicrowaveTableArena(visuals=visuals)
    arena.mjcf_model.find("site", "microwave").name = "lever"
    return Scene.furnish(arena, Robot(PANDA, visuals=visuals), [Lever()])


class LeverState(NamedTuple):
    """State after a control step: features `(..., k)`, targets of the actuators, and the terms of the reward."""

    joint_positions: np.ndarray
    joint_velocities: np.ndarray
    offset: np.ndarray  # From the gripper to the lever's tip [m].
    angle: np.ndarray  # Of the lever [rad].
    target: np.ndarray
    terms: dict


def approach(step):
    """1 - tanh(d / 0.1), where d is the distance from the gripper to the lever's tip [m]."""
    return 1.0 - np.tanh(np.sqrt(np.square(step.after.offset).sum(axis=-1)) / 0.1)


def push(step):
    """The lever's angle as a fraction of the one from which it counts as pushed."""
    return np.abs(step.after.angle[..., 0]) / PUSHED


@dataclasses.dataclass(frozen=True, kw_only=True)
class LeverMDP(MDP):
    """The mathematics of an episode, for one or for many."""

    observations = {
        "joint_positions": Observation(lambda simulation, state: state.joint_positions, of_robot=True),
        "joint_velocities": Observation(lambda simulation, state: state.joint_velocities, of_robot=True),
        "offset": Observation(lambda simulation, state: state.offset),
        "angle": Observation(lambda simulation, state: state.angle),
    }

    def initial_state(self, reading, draws):
        positions = reading[..., self.sensors.indices["joint_positions"]]
        return self._state(reading, positions)._replace(terms=self.no_reward(reading.shape[:-1]))

    def transition(self, state, *, action, target, reading, draws):
        return Transition(state, action, target, self._state(reading, target))

    def terminates(self, state):
        return np.abs(state.angle[..., 0]) > PUSHED

    def info(self, state):
        return {
            **self.reward_info(state),
            "is_success": np.abs(state.angle[..., 0]) > PUSHED,
        }

    def _state(self, reading, target):
        parts = {name: reading[..., part] for name, part in self.sensors.indices.items()}
        return LeverState(
            joint_positions=parts["joint_positions"],
            joint_velocities=parts["joint_velocities"],
            offset=parts["tip"] - parts["gripper"],
            angle=parts["angle"],
            target=target,
            terms={},
        )


class LeverTask(SuiteTask):
    """Push the lever over."""

    default_control_timestep = 0.01  # [s]
    control_modes = OFFSET_MODES
    instructions = ("push the lever over",)

    def __init__(self, scene, *, control_mode="joint_offset", **options):
        control, others = split_options(options, self.control_modes)
        sensors = FeatureSensors(scene.arena.mjcf_model, scene.robot)
        sensors.add_joints("joint_positions", "jointpos", scene.robot.joints)
        sensors.add_joints("joint_velocities", "jointvel", scene.robot.joints)
        sensors.add_frame("gripper", "framepos", scene.robot.end_effector)
        sensors.add_frame("tip", "framepos", scene.props["lever"].handles[0])
        sensors.add_joints("angle", "jointpos", scene.joints("lever"))
        mdp = LeverMDP(
            sensors=sensors,
            action_mode=make_mode(control_mode, self.control_modes, control),
            rewards={"approach": approach, "push": push},
        )
        super().__init__(scene, mdp, **others)
        self.vary(handles=scene.props["lever"].handles)

    def reset_physics(self, physics, random_state):
        pose = HOME + random_state.uniform(-0.02, 0.02, HOME.size) * (HOME != 0.04)
        physics.bind(self.robot.joints).qpos = pose
        physics.bind(self.scene.joints("lever")).qpos = random_state.uniform(-0.1, 0.1)
        physics.data.qvel[:] = 0.0
        physics.data.ctrl[self.mdp.sensors.ctrl] = pose


LEVER = suite.Domain(
    "lever",
    scene=build_lever_scene,
    task=LeverTask,
    tasks={"push": {}},
    env_id="Mine/Lever-v1",
    episode_steps=300,
)

if __name__ == "__main__":
    suite.register(LEVER)
    environment = suite.load("lever", "push", {"random": 0})
    environment.reset()
    print("dm_control:", environment.step(np.zeros(8)).reward)
    env = gymnasium.make("Mine/Lever-v1")
    env.reset(seed=0)
    print("single:", env.step(np.zeros(8))[1])
    envs = gymnasium.make_vec("Mine/Lever-v1", num_envs=4)
    envs.reset(seed=0)
    print("vectorised:", envs.step(np.zeros((4, 8)))[1])
