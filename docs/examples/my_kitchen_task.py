"""A custom task in the kitchen: the microwave half open, a burner on, calmly. Run: python my_kitchen_task.py."""

import gymnasium
import numpy as np

from kitchen_suite import suite
from kitchen_suite.entities import build_kitchen_scene
from kitchen_suite.tasks import KitchenTask


def calm(step):
    """A penalty of 0.1 for each rad that the fastest joint has moved; a step may be of one episode or of many."""
    return -0.1 * np.abs(step.after.positions - step.before.positions).max(axis=-1)


class CalmTask(KitchenTask):
    """The tasks of the kitchen with one more term of the reward; the slide cabinet starts open by U(0, 0.05) m."""

    extra_rewards = {"calm": calm}

    def reset_physics(self, physics, random_state):
        super().reset_physics(physics, random_state)
        physics.bind(self.scene.joints("slide_cabinet")).qpos = random_state.uniform(0.0, 0.05)


HALF_OPEN = {"tasks_to_complete": ["microwave", "top burner"], "goals": {"microwave": [-0.37]}, "reward": "dense"}
CALM_KITCHEN = suite.Domain(
    "calm_kitchen",
    scene=build_kitchen_scene,
    task=CalmTask,
    tasks={"half_open": HALF_OPEN},
    env_id="Mine/CalmKitchen-v1",
    episode_steps=280,
)

if __name__ == "__main__":
    suite.register(CALM_KITCHEN)
    env = gymnasium.make("Mine/CalmKitchen-v1")
    env.reset(seed=0)
    print("single:", env.step(np.ones(9))[1])
    envs = gymnasium.make_vec("Mine/CalmKitchen-v1", num_envs=4)
    envs.reset(seed=0)
    print("vectorised:", envs.step(np.ones((4, 9)))[1])
