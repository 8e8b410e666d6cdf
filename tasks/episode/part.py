"""Optional parts of episodes, such as pushes and quality: what each keeps, and when it acts."""

import copy
from collections.abc import Collection
from typing import Any, ClassVar, Protocol, Self

import mujoco
import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities.parameters import Parameter
from kitchen_suite.tasks.episode.draws import Draws
from kitchen_suite.tasks.simulation import Simulation
from kitchen_suite.tasks.terms import Transition
from kitchen_suite.tasks.variations.randomizer import Values
from kitchen_suite.types import Array


class EpisodePart:
    """An optional part of episodes: it starts at a reset, sees each control step before and after the physics.

    `EpisodeRunner` calls its methods for one episode or for many: the arrays of the part's state have the leading axes
    `(...)` of all others. No method changes a state. A part overrides what it needs; by default it draws, changes,
    observes and reports nothing. At a reset `draw`, `scaled`, `start` and `evaluated` are called in this order, in a
    control step `before`, `refresh`, `scaled` and `after`.

    Attributes:
      name: of the part, under which `EpisodeState.parts` and saved states have its state.
      is_saved: whether saved states have it: a named tuple, or None for a part that keeps nothing.
      suits_any_model: whether one part serves simulations of several models: of the physics it uses no indices but
        those of the robot. Others are refused there unless `vector_env` joins them.
      parameters: those of its own that may vary; a part that has any takes part only where one of them varies.
      stage: stage of MuJoCo's pipeline up to which the state after a control step is evaluated before `after`.
    """

    name: ClassVar[str]
    is_saved: ClassVar[bool] = True
    suits_any_model: ClassVar[bool] = False
    parameters: tuple[Parameter, ...] = ()
    stage: mujoco.mjtStage = mujoco.mjtStage.mjSTAGE_NONE

    def takes_part(self, varied: Collection[str]) -> bool:
        """Whether the part is one of the episodes' in which parameters of some names vary."""
        return not self.parameters or any(each.name in varied for each in self.parameters)

    def bind(self, physics: mjcf.Physics) -> None:
        """Looks up what the part needs in a compiled scene."""

    def draw(self, values: Values, simulation: Simulation, draws: Draws) -> Any:
        """Returns the part's state at a reset, before the MDP has one: what it draws, and what has been drawn for it.

        Args:
          values: of the parameters that vary, by name.
          simulation: the physics of the episode at its start.
          draws: random draws, before those of the noise of the first observation.
        """
        return None

    def start(self, part: Any, simulation: Simulation, mdp_state: Any, draws: Draws) -> Any:
        """Returns the part's state before the first step, given what `draw` returned and the MDP's state."""
        return part

    def evaluated(self, part: Any) -> Any:
        """Returns the part's state once a single physics is evaluated: after a reset, or when a state has been set.

        A part that is not saved finds here anew what it keeps.
        """
        return part

    def before(self, part: Any, simulation: Simulation, mdp_state: Any, ctrl: Array) -> tuple[Any, Array]:
        """Returns the part's state, and the controls `(..., m)` of the actuators, before the physics of a control step.

        It may write to the simulation.
        """
        return part, ctrl

    def refresh(self, physics: mjcf.Physics) -> None:
        """Evaluates a single physics up to `stage`, as a batch does by itself."""

    def scaled(self, part: Any, draws: Array) -> Array:
        """Returns the draws `(..., k)` of the observation noise as the part scales them; at a reset before `start`."""
        return draws

    def after(self, part: Any, simulation: Simulation, step: Transition, draws: Draws) -> Any:
        """Returns the part's state after the physics of a control step, whose reward has not been computed yet."""
        return part

    def terminates(self, part: Any) -> NDArray[np.bool_] | bool:
        """Returns whether `(...)` the part ended the episode in the last step."""
        return False

    def observed(self, part: Any) -> list[Array]:
        """Returns what agents observe of the part, `(..., k)` each, which follows the MDP's own observations."""
        return []

    def corrected(self, part: Any, info: dict[str, NDArray]) -> dict[str, NDArray]:
        """Returns the infos of the MDP, in which the part may replace some."""
        return info

    def succeeds(self, part: Any, success: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Returns whether `(...)` the success holds after the last step, which the part may decide by its own rule."""
        return success

    def info(self, part: Any) -> dict[str, NDArray]:
        """Returns the infos of the part: fresh arrays `(...)` or `(..., k)`."""
        return {}


class Reader(Protocol):
    """Reads values of the physics after a control step.

    Attributes:
      stage: stage of MuJoCo's pipeline up to which the physics is evaluated before.
    """

    stage: mujoco.mjtStage

    def read(self, simulation: Any) -> Any:
        """Returns nested arrays with any leading axes."""


class MeasuringPart(EpisodePart):
    """A part that reads the physics by indices of one compiled model.

    Attributes:
      reader: what `after` reads the physics by: the part itself, or in a batch of several models the parts of all.
    """

    def __init__(self) -> None:
        self.reader: Reader = self

    def read(self, simulation: Simulation) -> Any:
        """Returns values of the last control step, in fresh arrays `(..., k)`."""
        raise NotImplementedError

    def reading_by(self, reader: Reader) -> Self:
        """Returns the part with another reader."""
        part = copy.copy(self)
        part.reader = reader
        return part
