"""Loads tasks as in dm_control's suite, acts at random, and prints specs, observations and returns.

python load_a_task.py
python load_a_task.py --steps=280 --seed=1
"""

import argparse

import numpy as np

from kitchen_suite import suite

TASKS = [("kitchen", "microwave"), ("open_cabinet", "top_drawer"), ("microwave_table", "open")]


def play(domain: str, task: str, *, steps: int, seed: int) -> None:
    """Plays an episode of random actions, or its first steps."""
    environment = suite.load(domain, task, task_kwargs={"random": seed})
    spec, generator = environment.action_spec(), np.random.default_rng(seed)
    timestep, total, step = environment.reset(), 0.0, 0
    print(f"{domain}, {task}: {environment.task.instruction!r}")
    print(f"  action: {spec.shape} numbers, every {environment.control_timestep():.3g} s")
    for name, value in timestep.observation.items():
        print(f"  observation {name}: {value.dtype} {value.shape}")
    while not timestep.last() and step < steps:
        timestep = environment.step(generator.normal(scale=0.03, size=spec.shape))
        total, step = total + timestep.reward, step + 1
    print(f"  {step} steps, return {total:.3f}, last: {timestep.last()}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=25, help="control steps of each episode (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="seed of the environments and actions (default: 0)")
    options = parser.parse_args()
    print(f"the suite has {len(suite.ALL_TASKS)} tasks in {len(suite.DOMAINS)} domains")
    for each in TASKS:
        play(*each, steps=options.steps, seed=options.seed)
