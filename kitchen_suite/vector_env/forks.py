"""Keeps batches of simulations alive in forked processes, where they cannot be destroyed."""

import ctypes
import os
import weakref

from mujoco.batch import Batch

_batches: "weakref.WeakSet[Batch]" = weakref.WeakSet()


def leak_in_forks(batch: Batch) -> None:
    """Leaks a batch in every process forked from now on.

    Its destructor joins its threads, which do not survive a fork: a forked process that destroyed it would never end.
    """
    _batches.add(batch)


def _leak() -> None:
    for batch in _batches:
        # Module globals are destroyed when the interpreter ends, so no Python reference lasts for ever.
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(batch))


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_leak)
