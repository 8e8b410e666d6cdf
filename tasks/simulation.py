"""How tasks read and control the physics, of one episode or of many."""

from typing import Literal, Protocol, Self

import mujoco
import numpy as np
from dm_control import mjcf
from mujoco.batch import Batch
from numpy.typing import NDArray

from kitchen_suite import checks
from kitchen_suite.types import Array

Columns = NDArray[np.int64] | slice

# Stage of MuJoCo's pipeline that computes a field of its data; other fields are the state, or of the last physics step.
_STAGES = {
    **dict.fromkeys(
        (
            *("xpos", "xquat", "xmat", "xipos", "ximat", "xanchor", "xaxis"),
            *("geom_xpos", "geom_xmat", "site_xpos", "site_xmat", "cam_xpos", "cam_xmat", "light_xpos", "light_xdir"),
            *("subtree_com", "cdof", "cinert", "crb", "qM", "ten_length", "ten_J", "actuator_length"),
        ),
        mujoco.mjtStage.mjSTAGE_POS,
    ),
    **dict.fromkeys(
        (
            *("cvel", "cdof_dot", "ten_velocity", "actuator_velocity", "subtree_linvel", "subtree_angmom"),
            *("qfrc_bias", "qfrc_passive", "sensordata"),
        ),
        mujoco.mjtStage.mjSTAGE_VEL,
    ),
}


class Simulation(Protocol):
    """Access to the fields of MuJoCo's data; arrays have a leading axis for each of many simulations."""

    def read(self, field: str, columns: Columns, order: Literal["C", "F"] = "C") -> Array:
        """Returns columns `(..., k)` of a field: a copy, except for a slice, which is a live view.

        Of a field of vectors, such as `xpos`, `(..., k, 3)`.

        Args:
          field: such as `qpos`.
          columns: indices along the field's first axis, that of joints, bodies or sites.
          order: memory order of a copy; `F` is faster where it is computed with column by column.
        """

    def write(self, field: str, columns: Columns, values: Array) -> None:
        """Sets columns `(..., k)` of a field."""

    def named(self, field: str, name: str) -> Array:
        """Returns the elements of a field that belong to a name, in a fresh array with any leading axes.

        As `physics.named.data.<field>[name]` of dm_control: `named("xpos", "mug/")` returns positions `(..., 3)` in the
        world [m], `named("qpos", "microwave/microwave")` angles `(..., 1)` [rad].

        Args:
          field: of MuJoCo's data, such as `xpos`, `qpos` or `sensordata`.
          name: of a body, geom, site, joint, sensor or what else the field is by.

        Raises:
          ValueError: there is no such field, or it has nothing of this name.
        """

    def evaluate(self) -> None:
        """Evaluates what the next physics step takes from positions and velocities, after these have been set."""

    @property
    def unevaluated(self) -> "Simulation":
        """The same simulation, of which only what needs no evaluation can be read."""


def as_columns(indices: NDArray[np.int64]) -> Columns:
    """Returns consecutive indices as a slice, which reads several times as fast, and others as they are."""
    start, stop = int(indices[0]), int(indices[-1]) + 1
    return slice(start, stop) if np.array_equal(indices, np.arange(start, stop)) else indices


class NamedFields:
    """The places of names in the fields of MuJoCo's data, for one compiled model."""

    def __init__(self, physics: mjcf.Physics) -> None:
        self._fields = physics.named.data
        self._places: dict[tuple[str, str], tuple[Columns, bool]] = {}

    def find(self, field: str, name: str) -> tuple[Columns, bool]:
        """Returns the columns of a name in a field, and whether the name has one row of several numbers there.

        Raises a ValueError as `Simulation.named`.
        """
        if (field, name) not in self._places:
            self._places[field, name] = self._find(field, name)
        return self._places[field, name]

    def _find(self, field: str, name: str) -> tuple[Columns, bool]:
        indexer = getattr(self._fields, field, None)
        if indexer is None:
            raise ValueError(f"MuJoCo's data has no field by name {field!r}; such fields are xpos, qpos, sensordata")
        try:
            place = indexer.axes.row.convert_key_item(name)
        except KeyError as error:
            raise ValueError(f"field {field!r} has nothing of the name {name!r}: {checks.shown(error)}") from error
        if isinstance(place, slice):
            return np.arange(place.start, place.stop), False
        return np.atleast_1d(place).astype(np.int64), len(indexer.shape) > 1


class PhysicsSimulation:
    """The physics of a composer environment, while its model stays compiled; no leading axis."""

    def __init__(self, physics: mjcf.Physics) -> None:
        self._model, self._data = physics.model.ptr, physics.data.ptr
        self._names = NamedFields(physics)

    def read(self, field: str, columns: Columns, order: Literal["C", "F"] = "C") -> Array:
        return getattr(self._data, field)[columns]

    def write(self, field: str, columns: Columns, values: Array) -> None:
        getattr(self._data, field)[columns] = values

    def named(self, field: str, name: str) -> Array:
        columns, is_row = self._names.find(field, name)
        values = self.read(field, columns)
        return values[0] if is_row else values

    def evaluate(self) -> None:
        mujoco.mj_step1(self._model, self._data)

    @property
    def unevaluated(self) -> Self:
        """The simulation itself: its physics is evaluated whenever it is read."""
        return self


class BatchSimulation:
    """The simulations of a batch; leading axis `(n,)`."""

    def __init__(self, batch: Batch, physics: mjcf.Physics, stage: mujoco.mjtStage) -> None:
        """Stores a batch.

        Args:
          batch: the simulations.
          physics: of the same model, which knows its names.
          stage: stage of MuJoCo's pipeline up to which the batch is evaluated after each step.
        """
        self._batch = batch
        self._physics = physics
        self._stage = stage
        self._fields: dict[str, Array] = {}
        self._names = NamedFields(physics)

    def read(self, field: str, columns: Columns, order: Literal["C", "F"] = "C") -> Array:
        values = self._field(field)
        if isinstance(columns, slice):
            return values[:, columns]
        return values.take(columns, axis=1) if order == "C" else values.T.take(columns, axis=0).T

    def write(self, field: str, columns: Columns, values: Array) -> None:
        self._field(field)[:, columns] = values

    def named(self, field: str, name: str) -> Array:
        columns, is_row = self._names.find(field, name)
        values = self.read(field, columns)
        return values[:, 0] if is_row else values

    def evaluate(self) -> None:
        """Does nothing: a batch evaluates everything in its step."""

    @property
    def unevaluated(self) -> Self:
        return type(self)(self._batch, self._physics, mujoco.mjtStage.mjSTAGE_NONE)

    def _field(self, name: str) -> Array:
        """A field `(n, ...)` over all simulations; a live view.

        Raises a ValueError for a field that the batch has not evaluated, which would be that of an earlier state.
        """
        if name not in self._fields:
            needed = _STAGES.get(name, mujoco.mjtStage.mjSTAGE_NONE)
            if int(needed) > int(self._stage):
                raise ValueError(
                    f"vectorised environments have not evaluated {name!r} where it is read here: read it by the "
                    f"sensors of the MDP, with the stage {needed.name}, and keep it in its state, or by "
                    "extra_observations of the task"
                )
            self._fields[name] = self._batch.bind(name)
        return self._fields[name]
