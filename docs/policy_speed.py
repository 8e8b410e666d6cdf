"""Measures how long the policies that come with the package take for an action.

`python docs/policy_speed.py` prints the milliseconds of processor time of an action: the median of 2,000, all threads
together.
"""

import statistics
import time

import numpy as np
from tabulate import tabulate

from kitchen_suite import suite
from kitchen_suite.policies import load_policy
from kitchen_suite.policies.trained import SHIPPED

ACTIONS = 2_000


def milliseconds(name: str) -> float:
    """Returns the median time of an action of a policy [ms]."""
    policy = load_policy(SHIPPED / f"{name}.npz")
    metadata, times = policy.metadata, []
    kwargs = {**metadata["task_kwargs"], "visuals": False}
    with suite.load(metadata["domain_name"], metadata["task_name"], kwargs) as environment:
        act = policy.episode(environment.task, np.random.default_rng(0))
        timestep = environment.reset()
        for _ in range(ACTIONS):
            started = time.process_time()
            action = act(timestep)
            times.append(time.process_time() - started)
            timestep = environment.step(action)
            if timestep.last():
                timestep = environment.reset()
    return 1000 * statistics.median(times)


def main() -> None:
    """Prints the table."""
    rows = [(path.stem, f"{milliseconds(path.stem):.3f}") for path in sorted(SHIPPED.glob("*.npz"))]
    print(tabulate(rows, headers=("policy", "milliseconds of an action")))


if __name__ == "__main__":
    main()
