"""Copies of environments in the middle of an episode."""

import copy
import pickle


def played(environment, actions):
    """Returns an environment after actions in a new episode."""
    environment.reset()
    for action in actions:
        environment.step(action)
    return environment


def copies_of(environment, other):
    """Returns copies of an environment by how they were made; `other` has played an episode of its own."""
    other.set_state(environment.get_state())
    return {
        "deepcopy": copy.deepcopy(environment),
        "pickle": pickle.loads(pickle.dumps(environment)),
        "set_state": other,
    }
