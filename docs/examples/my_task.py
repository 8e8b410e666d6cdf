"""A task of one's own: the microwave's door starts ajar, and fast joints cost reward. Run: python my_task.py."""

import dataclasses
import functools

import gymnasium
import numpy as np

import kitchen_suite
from kitchen_suite import suite
from kitchen_suite.domains.base import build_environment
from kitchen_suite.entities.scenes import build_microwave_table_scene
from kitchen_suite.gymnasium_env.cabinets import FrankaMicrowaveTableEnv
from kitchen_suite.tasks.microwave_table.mdp import PARTS, OpenReward
from kitchen_suite.tasks.microwave_table.task import MicrowaveTableTask
from kitchen_suite.vector_env.cabinets import FrankaMicrowaveTableVectorEnv


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

    def _reset_physics(self, physics, random_state):
        super()._reset_physics(physics, random_state)
        physics.bind(self.scene.joints("microwave")).qpos = random_state.uniform(-0.2, 0.0)


def gentle_microwave(
    *, time_limit=5.0, random=None, visuals=True, render_quality="high", environment_kwargs=None, **task_options
):
    """Builds an environment of the task."""
    return build_environment(
        GentleTask(build_microwave_table_scene(visuals=visuals), **task_options),
        time_limit=time_limit,
        random=random,
        render_quality=render_quality,
        environment_kwargs=environment_kwargs,
    )


class GentleMicrowaveEnv(FrankaMicrowaveTableEnv):
    """The task as a Gymnasium environment."""

    def _make_environment(self, task_options):
        return gentle_microwave(**task_options)


class GentleMicrowaveVectorEnv(FrankaMicrowaveTableVectorEnv, gymnasium.vector.VectorEnv):
    """Many of them, stepped together."""

    env_class = GentleMicrowaveEnv


GENTLE_MICROWAVE = suite.Domain(
    name="gentle_microwave",
    build=gentle_microwave,
    tasks={"open": {}},
    env_id="Mine/GentleMicrowave-v1",
    env=f"{__name__}:GentleMicrowaveEnv",
    vector_env=f"{__name__}:GentleMicrowaveVectorEnv",
    episode_steps=500,
)

if __name__ == "__main__":
    suite.register(GENTLE_MICROWAVE)

    environment = kitchen_suite.load("gentle_microwave", "open", {"random": 0})
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
