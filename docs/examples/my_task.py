"""A task of one's own: the microwave's door starts ajar, and fast joints cost reward. Run: python my_task.py."""

import dataclasses
import functools

import gymnasium
import numpy as np

from kitchen_suite import suite
from kitchen_suite.entities import build_microwave_table_scene
from kitchen_suite.tasks import MicrowaveTableTask
from kitchen_suite.tasks.microwave_table.mdp import PARTS, OpenReward


class GentleReward(OpenReward):
    """The terms of the microwave table, and a penalty of 0.1 for each rad/s of the fastest joint."""

    terms = (*OpenReward.terms, "speed")

    def __call__(self, observation, goal):
        # The last axis has the parts of an observation; any axes before it count environments.
        velocities = observation[..., PARTS["joint_velocities"]]
        return {**super().__call__(observation, goal), "speed": -0.1 * np.abs(velocities).max(axis=-1)}


class GentleTask(MicrowaveTableTask):
    """Open the door gently; it starts at an angle U(-0.2, 0) rad."""

    domain_name = "gentle_microwave"
    instructions = ("open the microwave door gently",)

    @functools.cached_property
    def mdp(self):
        return dataclasses.replace(super().mdp, reward_terms=GentleReward())

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
    observation, info = env.reset(seed=0)
    observation, reward, terminated, truncated, info = env.step(np.zeros(8, np.float32))
    print("Gymnasium:", reward, info["reward/speed"])

    envs = gymnasium.make_vec("Mine/GentleMicrowave-v1", num_envs=4)
    observations, infos = envs.reset(seed=0)
    observations, rewards, terminations, truncations, infos = envs.step(np.zeros((4, 8), np.float32))
    assert rewards[0] == reward
    assert np.array_equal(observations[0], observation)
    print("vectorised:", rewards)
