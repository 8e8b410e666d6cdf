"""The physics of one episode or of many, behind the interface through which tasks read and control them."""

from typing import Literal, Protocol

import numpy as np
from dm_control import mjcf
from mujoco.batch import Batch
from numpy.typing import NDArray

Columns = NDArray[np.int64] | slice


class Simulation(Protocol):
    """Access to the fields of MuJoCo's data; arrays have a leading axis for each of many simulations."""

    def read(self, field: str, columns: Columns, order: Literal["C", "F"] = "C") -> NDArray[np.float64]:
        """Returns columns `(..., k)` of a field: a copy, except for a slice, which is a live view.

        A field of vectors, such as `xpos`, gives `(..., k, 3)`.

        Args:
          field: such as `qpos`.
          columns: indices along the field's first axis, that of joints, bodies or sites.
          order: memory order of a copy; `F` is faster where it is computed with column by column.
        """

    def write(self, field: str, columns: Columns, values: NDArray[np.float64]) -> None:
        """Sets columns `(..., k)` of a field."""


def columns(indices: NDArray[np.int64]) -> Columns:
    """Returns consecutive indices as a slice, which reads several times as fast, and others as they are."""
    start, stop = int(indices[0]), int(indices[-1]) + 1
    return slice(start, stop) if np.array_equal(indices, np.arange(start, stop)) else indices


class PhysicsSimulation:
    """The physics of a composer environment, while its model stays compiled; no leading axis."""

    def __init__(self, physics: mjcf.Physics) -> None:
        self._data = physics.data.ptr

    def read(self, field: str, columns: Columns, order: Literal["C", "F"] = "C") -> NDArray[np.float64]:
        del order
        return getattr(self._data, field)[columns]

    def write(self, field: str, columns: Columns, values: NDArray[np.float64]) -> None:
        getattr(self._data, field)[columns] = values


class BatchSimulation:
    """The simulations of a batch; leading axis `(n,)`."""

    def __init__(self, batch: Batch) -> None:
        self._batch = batch
        self._fields: dict[str, NDArray[np.float64]] = {}

    def read(self, field: str, columns: Columns, order: Literal["C", "F"] = "C") -> NDArray[np.float64]:
        values = self._field(field)
        if isinstance(columns, slice):
            return values[:, columns]
        return values.take(columns, axis=1) if order == "C" else values.T.take(columns, axis=0).T

    def write(self, field: str, columns: Columns, values: NDArray[np.float64]) -> None:
        self._field(field)[:, columns] = values

    def _field(self, name: str) -> NDArray[np.float64]:
        """A field `(n, ...)` over all simulations; a live view."""
        if name not in self._fields:
            self._fields[name] = self._batch.bind(name)
        return self._fields[name]
