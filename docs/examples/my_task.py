"""A custom task: the microwave's door starts ajar, and fast joints cost reward. Run: python my_task.py."""

import gymnasium
import numpy as np

from kitchen_suite import suite
from kitchen_suite.entities import build_microwave_table_scene
from kitchen_suite.tasks import MicrowaveTableTask


def speed(step):
    """A penalty of 0.1 for each rad/s of the fastest joint; a step may be of one episode or of many."""
    return -0.1 * np.abs(step.after.joint_velocities).max(axis=-1)


class GentleTask(MicrowaveTableTask):
    """Open the door gently; it starts at an angle U(-0.2, 0) rad."""

    instructions = ("open the microwave door gently",)
    extra_rewards = {"speed": speed}

    def reset_physics(self, physics, random_state):
        super().reset_physics(physics, random_state)
        physics.bind(self.scene.joints("microwave")).qpos = random_state.uniform(-0.2, 0.0)


GENTLE_MICROWAVE = suite.Domain(
    "gentle_microwave",
    scene=build_microwave_table_scene,
    task=GentleTask,
    tasks={"open": {}},
    env_id="Mine/GentleMicrowave-v1",
    episode_steps=500,
)

if __name__ == "__main__":
    suite.register(GENTLE_MICROWAVE)
    environment = suite.load("gentle_microwave", "open", {"random": 0})
    environment.reset()
    print("dm_control:", environment.step(np.zeros(8)).reward)
    env = gymnasium.make("Mine/GentleMicrowave-v1")
    env.reset(seed=0)
    print("single:", env.step(np.zeros(8))[1])
    envs = gymnasium.make_vec("Mine/GentleMicrowave-v1", num_envs=4)
    envs.reset(seed=0)
    print("vectorised:", envs.step(np.zeros((4, 8)))[1])
