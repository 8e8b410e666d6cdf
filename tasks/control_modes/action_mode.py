"""Control modes: how an action becomes targets of the robot's actuators."""

import abc
import functools
from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import mujoco
import numpy as np
from dm_control import mjcf
from dm_env import specs
from numpy.typing import NDArray

from kitchen_suite import signatures
from kitchen_suite.entities.robot import Robot
from kitchen_suite.tasks.simulation import Simulation
from kitchen_suite.types import Array

MEDIAN = 0.5  # Draw of an action mode that draws nothing: the median of U(0, 1).


class ActionMode(abc.ABC):
    """Meaning of the action.

    A mode may remember a command from one control step to the next: a named tuple of arrays `(..., k)`; None otherwise.

    Attributes:
      name: of the mode, as the argument `control_mode` takes it.
      formula: how targets `ctrl` follow from the action, in words that other programs can follow.
      suits_any_robot: whether it moves other arms than the Franka as well.
      draws: whether a number is drawn from U(0, 1) for each action; `MEDIAN` stands for it otherwise.
      stage: stage of MuJoCo's pipeline up to which the state before a control step must be evaluated.
    """

    name: ClassVar[str]
    formula: ClassVar[str]
    suits_any_robot: ClassVar[bool] = False
    draws: bool = False
    stage: ClassVar[mujoco.mjtStage] = mujoco.mjtStage.mjSTAGE_NONE

    @property
    def settings(self) -> dict[str, Any]:
        """Arguments of the class, which modes keep as attributes of the same names."""
        return {argument: getattr(self, argument) for argument in signatures.names(type(self))}

    @functools.cached_property
    def reads_derived(self) -> bool:
        """Whether control reads what MuJoCo derives from positions and velocities."""
        return self.stage != mujoco.mjtStage.mjSTAGE_NONE

    @abc.abstractmethod
    def spec(self, robot: Robot) -> specs.Array:
        """Returns the action's spec."""

    def bind(self, physics: mjcf.Physics, robot: Robot, timestep: float) -> None:  # noqa: B027
        """Looks up what control reads of a robot in a compiled scene; `timestep` is the control step's [s]."""

    def check(self, action: Array) -> None:  # noqa: B027
        """Raises a ValueError if one of finite actions `(..., k)` has no meaning; most modes accept all."""

    def conversion(self, mode: str) -> Callable[[NDArray, NDArray], Array] | None:
        """Returns how actions of another control mode, with its defaults, become actions of this one.

        A function of the observed state `(n,)` and the other mode's action, with the same targets of the robot's
        actuators; None if there is none.
        """
        return None

    def start(self, simulation: Simulation) -> Any:
        """Returns the command at the start of an episode, which is the present state; None if there is none."""
        return None

    @abc.abstractmethod
    def control(
        self, simulation: Simulation, state: Any, command: Any, action: Array, draw: Array | float
    ) -> tuple[Array, Any]:
        """Returns targets of the robot's actuators, and the command for the next control step.

        Args:
          simulation: the physics.
          state: state of the MDP.
          command: the command that the last control step, or `start`, returned.
          action: `(..., k)`.
          draw: `(...)`, from U(0, 1), or `MEDIAN`.

        Returns:
          Targets `(..., 9)` [rad, m], and the command.
        """


def unit_spec(names: Sequence[str]) -> specs.BoundedArray:
    """Returns the spec of an action with named elements in [-1, 1]."""
    ones = np.ones(len(names))
    return specs.BoundedArray(ones.shape, ones.dtype, minimum=-ones, maximum=ones, name="\t".join(names))
