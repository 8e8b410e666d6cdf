"""A task made of the suite's entities, in plain dm_control composer: reach for the handle of a microwave.

python own_task.py --steps=100
"""

import argparse

import numpy as np

from kitchen_suite.entities import PANDA, Microwave, Robot

# isort: split
# After the suite: imported first, dm_control would open a GL library at once.
import mujoco
from dm_control import composer

HOME = np.array([0.0, -0.6, 0.0, -2.4, 0.0, 1.9, 0.8, 0.02, 0.02])  # joints of the arm [rad], fingers [m]


class Reach(composer.Task):
    """The reward is exp(-5 d), where d is the distance from the gripper to 10 cm in front of the handle [m]."""

    def __init__(self) -> None:
        self._arena, self.robot, self.microwave = composer.Arena(), Robot(PANDA), Microwave()
        self._arena.attach(self.robot)
        frame = self._arena.attach(self.microwave)
        frame.pos, frame.quat = (0.9, 0.25, 0.25), (1, 0, 0, -1)  # its door faces the robot
        self.robot.observables.joint_positions.enabled = True
        self.set_timesteps(control_timestep=0.05, physics_timestep=0.002)

    @property
    def root_entity(self) -> composer.Entity:
        return self._arena

    def initialize_episode(self, physics, random_state) -> None:
        physics.bind(self.robot.joints).qpos = HOME + random_state.uniform(-0.02, 0.02, HOME.shape)

    def offset(self, physics) -> np.ndarray:
        """Returns the vector from the gripper to 10 cm in front of the handle [m]."""
        handle = physics.bind(self.microwave.handles[0]).xpos
        return handle - (0.1, 0, 0) - physics.bind(self.robot.end_effector).xpos

    def get_reward(self, physics) -> float:
        return float(np.exp(-5 * np.linalg.norm(self.offset(physics))))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=30, help="control steps (default: %(default)s)")
    task = Reach()
    environment = composer.Environment(task, random_state=0)
    environment.reset()
    targets = HOME.copy()  # the action: targets of the nine actuators
    jacobian = np.zeros((3, len(HOME) + 1))  # of the robot's joints and the door
    for step in range(parser.parse_args().steps):
        physics = environment.physics
        site = physics.bind(task.robot.end_effector).element_id
        mujoco.mj_jacSite(physics.model.ptr, physics.data.ptr, jacobian, None, site)
        targets[:7] += 0.2 * np.linalg.pinv(jacobian[:, :7]) @ task.offset(physics)
        timestep = environment.step(targets)
        if step % 10 == 9:
            print(f"step {step + 1}: {np.linalg.norm(task.offset(physics)):.3f} m away, reward {timestep.reward:.3f}")
