"""An episode of an environment of `suite.load`, from one seed."""

import numpy as np


def play(environment, build_policy, seed):
    """Plays an episode; returns its actions. The task's `episode_metrics` are then those of the episode."""
    environment.random_state = seed
    policy = build_policy(environment, np.random.default_rng((seed, 1)))
    timestep, actions = environment.reset(), []
    while not timestep.last():
        actions.append(policy(timestep))
        timestep = environment.step(actions[-1])
    return np.array(actions)
