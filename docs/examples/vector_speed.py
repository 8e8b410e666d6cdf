"""Steps many environments together, and measures control steps per second.

Environment i of a vector that is reset with seed s is bit-for-bit identical to the single environment of seed s + i.

python vector_speed.py
python vector_speed.py --env=kitchen_suite:KitchenSuite/TopDrawer-v1 --num_envs 1 64 1024 --steps=200
"""

import argparse
import time

import gymnasium
import numpy as np
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector.utils import iterate

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument(
    "--env", default="kitchen_suite:KitchenSuite/Kettle-v1", help="id of the environment (default: %(default)s)"
)
parser.add_argument("--num_envs", type=int, nargs="+", default=[1, 16], help="sizes to try (default: 1 16)")
parser.add_argument("--steps", type=int, default=20, help="calls of step for each size (default: %(default)s)")
options = parser.parse_args()

print(options.env)
for num_envs in options.num_envs:
    envs = gymnasium.make_vec(options.env, num_envs=num_envs)  # one process, threads for all processors
    envs.reset(seed=0)
    actions = np.random.default_rng(0).normal(scale=0.03, size=envs.action_space.shape)
    start = time.perf_counter()
    for _ in range(options.steps):
        observations, rewards, terminations, truncations, infos = envs.step(actions)
    seconds = time.perf_counter() - start
    print(f"  {num_envs:5} environments: {num_envs * options.steps / seconds:8.0f} control steps per second")

# The last environment of the vector, played again alone.
single = gymnasium.make(options.env)
single.reset(seed=num_envs - 1)
for _ in range(options.steps):
    observation, *_ = single.step(actions[-1])
*_, last = iterate(envs.observation_space, observations)
print("the last one, played alone, is equal:", data_equivalence(last, observation, exact=True))
