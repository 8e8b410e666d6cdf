"""Paths on which an arm touches nothing, found by trees that grow from both ends towards each other.

This is RRT-Connect: Kuffner and LaValle, RRT-Connect: an efficient approach to single-query path planning, 2000.
"""

from collections.abc import Callable

import numpy as np

from kitchen_suite.types import Array

_STEP = 0.3  # Greatest motion of a joint in a step of a tree [rad].
_ITERATIONS, _SHORTCUTS = 150, 60  # Numbers of samples by which trees grow, and of shortcuts that are tried.

Free = Callable[[Array, Array], bool]
"""Returns whether nothing is touched on the straight motion from one joint position `(n,)` to another [rad]."""

# A tree of joint positions `(7,)`, each with the index of the one before it.
Tree = list[tuple[Array, int]]


def _extend(tree: Tree, sample: Array, free: Free) -> int | None:
    """Grows a tree by a step towards a sample; returns the index of the new node, None if something is in the way."""
    nearest = int(np.argmin([np.abs(node - sample).max() for node, _ in tree]))
    start = tree[nearest][0]
    distance = float(np.abs(sample - start).max())
    end = sample if distance <= _STEP else start + (sample - start) * _STEP / distance
    if not free(start, end):
        return None
    tree.append((end, nearest))
    return len(tree) - 1


def _reach(tree: Tree, target: Array, free: Free) -> int | None:
    """Grows a tree up to a target; returns the index of the node there, None if something is in the way."""
    while (node := _extend(tree, target, free)) is not None:
        if np.array_equal(tree[node][0], target):
            return node
    return None


def _branch(tree: Tree, node: int) -> list[Array]:
    """Returns the nodes from one to the root of its tree."""
    found = []
    while node >= 0:
        joints, node = tree[node]
        found.append(joints)
    return found


def _shortened(path: list[Array], free: Free, generator: np.random.Generator) -> list[Array]:
    """Returns a path without the detours that straight motions between its nodes spare."""
    for _ in range(_SHORTCUTS):
        if len(path) < 3:
            break
        start, end = np.sort(generator.choice(len(path), 2, replace=False)).tolist()
        if end - start > 1 and free(path[start], path[end]):
            path = [*path[: start + 1], *path[end:]]
    return path


def connect(
    first: Array, last: Array, free: Free, bounds: tuple[Array, Array], generator: np.random.Generator
) -> list[Array] | None:
    """Returns the joint positions between two on a path on which nothing is touched; None if none is found.

    Args:
      first: joint positions `(n,)` at its start [rad].
      last: those at its end.
      free: whether nothing is touched on a straight motion.
      bounds: least and greatest joint positions, `(n,)` each.
      generator: of the samples towards which the trees grow, around the middle of both ends.
    """
    if free(first, last):
        return []
    trees: list[Tree] = [[(first, -1)], [(last, -1)]]
    middle = (first + last) / 2
    for _ in range(_ITERATIONS):
        sample = np.clip(middle + generator.normal(0.0, 1.0, first.size), *bounds)
        node = _extend(trees[0], sample, free)
        if node is not None:
            other = _reach(trees[1], trees[0][node][0], free)
            if other is not None:
                path = [*_branch(trees[0], node)[::-1], *_branch(trees[1], other)]
                path = path if np.array_equal(path[0], first) else path[::-1]
                return _shortened(path, free, generator)[1:-1]
        trees.reverse()
    return None
