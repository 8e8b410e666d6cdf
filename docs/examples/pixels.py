"""Observes images of two cameras instead of the objects' positions, and saves them side by side.

Needs a GL library, but no display.

python pixels.py
python pixels.py --env=kitchen_suite:KitchenSuite/TopDrawer-v1 --cameras overview handle --size=256 --quality=high
"""

import argparse

import gymnasium
import imageio.v3 as imageio
import numpy as np

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument(
    "--env", default="kitchen_suite:KitchenSuite/Microwave-v1", help="id of the environment (default: %(default)s)"
)
parser.add_argument("--cameras", nargs=2, default=["workspace", "franka/hand"], help="two cameras; see observations.md")
parser.add_argument("--size", type=int, default=128, help="height and width [pixels] (default: %(default)s)")
parser.add_argument("--quality", choices=["fast", "high"], default="fast", help="render_quality (default: fast)")
parser.add_argument("--steps", type=int, default=10, help="control steps before the picture (default: %(default)s)")
parser.add_argument("--output", default="pixels.png", help="picture to write (default: %(default)s)")
options = parser.parse_args()

env = gymnasium.make(
    options.env,
    obs_type="pixels_agent_pos",
    cameras=options.cameras,
    image_size=(options.size, options.size),
    render_quality=options.quality,
    control_mode="ee_delta_position",  # x, y, z of the hand, and the gripper
)
observation, info = env.reset(seed=0)
for _ in range(options.steps):
    observation, reward, terminated, truncated, info = env.step(np.array([0.5, 0.5, 0.0, -1.0]))  # forward, left, open

print("agent_pos:", observation["agent_pos"].shape, "actions:", env.action_space.shape)
pictures = observation["pixels"]  # by camera, in which franka/hand is franka_hand
for camera, picture in pictures.items():
    print(f"{camera}: {picture.dtype} {picture.shape}, mean {picture.mean():.1f}")
imageio.imwrite(options.output, np.hstack([*pictures.values()]))
print("wrote", options.output)
