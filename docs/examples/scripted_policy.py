"""A custom scripted policy, which all commands take: a list of speeds of the hand opens the microwave.

python scripted_policy.py
kitchen-rollout --policy=scripted_policy:Script --task_name=microwave --control_mode=ee_delta_pose --video=microwave.mp4
"""

import numpy as np

import kitchen_suite
from kitchen_suite import EnvironmentSpec

# Speeds of the hand (x, y, z, rotation vector) and the gripper, and for how many control steps.
MOVES = [
    ((0.8, 0.66, -0.48, 0, 0, 0, -1), 16),  # to the handle
    ((0.8, 0, 0, 0, 0, 0, -1), 7),  # around it
    ((0, 0, 0, 0, 0, 0, 1), 4),  # close the gripper
    ((-0.9, 0.25, 0, 0, 0, -0.4, 1), 19),  # pull
]
ACTIONS = np.array([action for action, steps in MOVES for _ in range(steps)])


class Script:
    """Plays the list, and then stays; `timestep.observation` is not used.

    Each environment has a policy of its own, since the class is given, and `reset` is called before each episode.
    """

    def __init__(self):
        self.step = 0

    def reset(self):
        """Begins the list again."""
        self.step = 0

    def __call__(self, timestep):
        """Returns the next action."""
        self.step += 1
        return ACTIONS[self.step - 1] if self.step <= len(ACTIONS) else np.array([0, 0, 0, 0, 0, 0, 1])


if __name__ == "__main__":
    spec = EnvironmentSpec.make("kitchen", "microwave", {"control_mode": "ee_delta_pose"})
    for episode in kitchen_suite.play(spec, Script, seeds=range(2), num_envs=2):
        print(f"seed {episode.seed}: {episode.steps} steps, success {episode.metrics['success']}")
