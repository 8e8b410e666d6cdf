"""States of many episodes: the nested named tuples and dicts of one, with one more axis on every array."""

from typing import Any

import numpy as np


def repeated(state: Any, count: int) -> Any:
    """The state of one episode `count` times, along a new first axis of every array."""
    if isinstance(state, dict):
        return {name: repeated(part, count) for name, part in state.items()}
    if isinstance(state, tuple):
        return type(state)(*(repeated(part, count) for part in state))
    return np.repeat(np.asarray(state)[np.newaxis], count, axis=0)


def put(states: Any, i: int, state: Any) -> None:
    """Writes the state of one episode over number `i` of many."""
    if isinstance(states, np.ndarray):
        states[i] = state
        return
    if isinstance(states, dict):
        states, state = states.values(), state.values()
    for many, one in zip(states, state, strict=True):
        put(many, i, one)
