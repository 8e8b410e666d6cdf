"""Relabels an episode with the goal that it reached, as hindsight experience replay (HER) does.

The hand pulls the microwave's door open, but not as far as desired: no reward. With the angle that was reached as the
goal, `compute_reward` pays for the same steps. It takes the goals and infos of many steps at once.

python relabel_goals.py
python relabel_goals.py --goal=-0.3
"""

import argparse

import gymnasium
import numpy as np

# Speeds of the hand (x, y, z, rotation vector) and the gripper, and for how many control steps.
MOVES = [
    ((0.8, 0.66, -0.48, 0, 0, 0, -1), 16),  # to the handle
    ((0.8, 0, 0, 0, 0, 0, -1), 7),  # around it
    ((0, 0, 0, 0, 0, 0, 1), 4),  # close the gripper
    ((-0.9, 0.25, 0, 0, 0, -0.4, 1), 19),  # pull
]

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--goal", type=float, default=-1.5, help="desired angle of the door [rad] (default: %(default)s)")
options = parser.parse_args()

env = gymnasium.make(
    "kitchen_suite:KitchenSuite/Microwave-v1",
    control_mode="ee_delta_pose",
    goals={"microwave": [options.goal]},
    goal_format="flat",  # one array for all goals, as replay buffers expect
    info_format="arrays",  # infos of fixed shape
    terminate_on_tasks_completed=False,
)
observation, info = env.reset(seed=0)
achieved, infos, rewards = [], [], []
for action in (action for action, steps in MOVES for _ in range(steps)):
    observation, reward, terminated, truncated, info = env.step(np.array(action, np.float32))
    achieved.append(observation["achieved_goal"])
    infos.append(info)
    rewards.append(reward)

for name, goal in (("desired", observation["desired_goal"]), ("reached", achieved[-1])):
    goals = np.broadcast_to(goal, np.shape(achieved))
    computed = env.unwrapped.compute_reward(np.array(achieved), goals, infos)
    print(f"{name} goal {goal.round(2)} rad: rewards in steps {np.flatnonzero(computed).tolist()}")
    assert name == "reached" or np.array_equal(computed, rewards)
