"""Control steps per second of Stable-Baselines3 with this suite's adapter and with its own `DummyVecEnv`.

python docs/stable_baselines3_speed.py [number of environments]

Both make the same steps with random actions, alternately, on one thread. Prints a table of medians and their ratio.
"""

import functools
import statistics
import sys
import time

import numpy as np
from stable_baselines3.common.env_util import make_vec_env
from tabulate import tabulate

from kitchen_suite.bridges import stable_baselines3

CASES = {
    "KitchenSuite/FrankaKitchen-v1": {"goal_format": "flat"},
    "KitchenSuite/FrankaOpenCabinet-v1": {"action_limit": 0.02},
}
STEPS, ROUNDS = 100, 5


def rate(environments, actions):
    """Control steps per second, over all environments."""
    environments.reset()
    started = time.perf_counter()
    for action in actions:
        environments.step(action)
    return len(actions) * environments.num_envs / (time.perf_counter() - started)


def row(name, settings, num_envs):
    """Name, median rates of both and the median of their ratios, in a row of the table."""
    env_id = f"kitchen_suite.gymnasium_env:{name}"
    make_fast = functools.partial(stable_baselines3.make_vec_env, env_id, num_envs, num_threads=1, **settings)
    plain, fast = make_vec_env(env_id, num_envs, env_kwargs=settings), make_fast()
    space = plain.action_space
    actions = np.random.default_rng(0).uniform(space.low, space.high, (STEPS, num_envs, *space.shape))
    rates = [(rate(plain, actions), rate(fast, actions)) for _ in range(ROUNDS)]
    ratio = statistics.median(one / other for other, one in rates)
    return name, *(statistics.median(column) for column in zip(*rates, strict=True)), ratio


if __name__ == "__main__":
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 16
    headers = [f"{count} environments", "DummyVecEnv", "SuiteVecEnv", "ratio"]
    rows = [row(name, settings, count) for name, settings in CASES.items()]
    print(tabulate(rows, headers, "github", floatfmt=(None, ",.0f", ",.0f", ".2f")))
