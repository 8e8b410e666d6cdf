"""A custom control mode: velocities of the arm's joints, with an open hand. Run: python my_control_mode.py."""

import gymnasium
import numpy as np

from kitchen_suite import suite
from kitchen_suite.entities import build_kitchen_scene
from kitchen_suite.tasks import ActionMode, KitchenTask, unit_spec

OPEN = 0.04  # Positions of both fingers when the hand is open [m].


class ArmVelocity(ActionMode):
    """`arm_velocity`: seven joint velocities in [-1, 1] rad/s, from the joint positions without noise."""

    name = "arm_velocity"
    formula = "ctrl[:7] = q[:7] + action * control_timestep; ctrl[7:] = 0.04"

    def spec(self, robot):
        return unit_spec([actuator.full_identifier for actuator in robot.actuators[:7]])

    def bind(self, physics, robot, timestep):
        self._timestep = timestep

    def control(self, simulation, state, command, action, draw):
        arm = state.positions[..., :7] + self._timestep * np.clip(action, -1.0, 1.0)
        hand = np.full((*arm.shape[:-1], 2), OPEN)
        return np.concatenate([arm, hand], axis=-1), command


class ArmTask(KitchenTask):
    """The tasks of the kitchen with the additional control mode `arm_velocity`."""

    control_modes = {**KitchenTask.control_modes, "arm_velocity": ArmVelocity}


ARM_KITCHEN = suite.Domain(
    "arm_kitchen",
    scene=build_kitchen_scene,
    task=ArmTask,
    tasks={"microwave": {"tasks_to_complete": ["microwave"], "control_mode": "arm_velocity"}},
    env_id="Mine/ArmKitchen-v1",
    episode_steps=280,
)

if __name__ == "__main__":
    suite.register(ARM_KITCHEN)
    environment = suite.load("arm_kitchen", "microwave", {"random": 0})
    environment.reset()
    print("dm_control:", environment.step(np.ones(7)).observation["franka/joint_positions"][0])
    env = gymnasium.make("Mine/ArmKitchenMicrowave-v1")
    env.reset(seed=0)
    print("single:", env.step(np.ones(7))[0]["observation"][0])
    envs = gymnasium.make_vec("Mine/ArmKitchenMicrowave-v1", num_envs=4)
    envs.reset(seed=0)
    print("vectorised:", envs.step(np.ones((4, 7)))[0]["observation"][:, 0])
