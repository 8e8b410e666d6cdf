"""Vectorised environments: rows of what they return, and their inside, which no public name reaches."""

import gymnasium


def many(env_id, count, **settings):
    """Returns environments that are stepped together, as Gymnasium makes them."""
    return gymnasium.make_vec(env_id, count, vectorization_mode="vector_entry_point", **settings)


def batch(env):
    """Returns the simulations of a vectorised environment, with live arrays such as `qvel`."""
    return env.unwrapped._episodes.batch


def part(value, i):
    """Returns the row of environment `i` of nested arrays with a leading axis."""
    return {key: part(inner, i) for key, inner in value.items()} if isinstance(value, dict) else value[i]
