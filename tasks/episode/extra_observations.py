"""Observations that a user's task adds: what they read, their noise, and their values in episodes."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import mujoco
import numpy as np
from dm_control import mjcf
from dm_control.composer.observation import observable

from kitchen_suite import checks
from kitchen_suite.tasks.episode.draws import Draws
from kitchen_suite.tasks.episode.part import EpisodePart
from kitchen_suite.tasks.observables import Computed
from kitchen_suite.tasks.simulation import Simulation
from kitchen_suite.tasks.terms import Observation, Transition, named_errors, read_only
from kitchen_suite.types import Array


class Measured(NamedTuple):
    """Values of the observations in episodes, `(..., k)` by name.

    Attributes:
      values: without noise, also of observations that are not enabled.
      noisy: with noise, those that have any.
    """

    values: dict[str, Array]
    noisy: dict[str, Array]


class ExtraObservations(EpisodePart):
    """The `extra_observations` of a task, in their order.

    Attributes:
      by_name: the observations.
      enabled: names of those that agents observe.
    """

    # As states of 1.0 have it.
    name = "measured"
    suits_any_model = True
    # What a single simulation has after each step.
    stage = mujoco.mjtStage.mjSTAGE_VEL

    def __init__(self, observations: Mapping[str, Observation], owner: str) -> None:
        """Checks the observations; `owner` is the name of the class that has them, for messages.

        Raises a TypeError that names what is no observation.
        """
        for name, observation in observations.items():
            if not isinstance(observation, Observation):
                kind = "must be a kitchen_suite.tasks.Observation"
                raise TypeError(f"extra_observations[{name!r}] of {owner} {kind}, got {checks.shown(observation)}")
        self.by_name = dict(observations)
        self.enabled = tuple(name for name, observation in self.by_name.items() if observation.enabled)
        self._noisy = tuple(name for name, observation in self.by_name.items() if observation.noise)

    def observables(self, measured: Callable[[], Measured]) -> dict[str, observable.Observable]:
        """Returns an enabled composer observable for each that agents observe, given what reads their values."""

        def shown(name: str) -> observable.Observable:
            part = Computed(lambda: self.shown(measured(), name))
            part.enabled = True
            return part

        return {name: shown(name) for name in self.enabled}

    def start(self, part: Any, simulation: Simulation, mdp_state: Any, draws: Draws) -> Measured:
        simulation.evaluate()
        return self._measured(simulation, mdp_state, (), draws)

    def refresh(self, physics: mjcf.Physics) -> None:
        mujoco.mj_step1(physics.model.ptr, physics.data.ptr)

    def after(self, part: Measured, simulation: Simulation, step: Transition, draws: Draws) -> Measured:
        measured = self._measured(simulation, step.after, step.action.shape[:-1], draws)
        step.observations = measured.values
        step.previous_observations = part.values
        return measured

    def _measured(self, simulation: Simulation, mdp_state: Any, axes: tuple[int, ...], draws: Draws) -> Measured:
        values = self.measure(simulation, mdp_state, axes)
        return Measured(values, draws.corrupted({name: values[name] for name in self._noisy}, self._corrupt))

    def measure(self, simulation: Simulation, state: Any, axes: tuple[int, ...]) -> dict[str, Array]:
        """Returns the values `(*axes, k)` after a step, or at a reset, by name.

        Raises a ValueError if a value has another shape.
        """
        values = {}
        given = read_only(state)
        for name, observation in self.by_name.items():
            with named_errors(f"extra_observations[{name!r}]"):
                read = observation.read(simulation, given)
            value = np.asarray(read, np.float64)
            if value.shape[:-1] != axes or value.ndim != len(axes) + 1:
                raise ValueError(
                    f"extra_observations[{name!r}] must have the shape {(*axes, 'k')} where the arrays of the state "
                    f"have the axes {axes}, got {value.shape}: reduce and concatenate along the last axis alone"
                )
            # A view would change with the physics.
            values[name] = value.copy()
        return values

    def _corrupt(self, values: Mapping[str, Array], random_state: np.random.RandomState) -> dict[str, Array]:
        """Returns values of one episode `(k,)` by name with noise, of those that have any."""
        noisy = {}
        for name, value in values.items():
            noise = self.by_name[name].noise
            assert noise is not None
            noisy[name] = np.asarray(noise(value.copy(), random_state=random_state), np.float64)
            if noisy[name].shape != value.shape:
                raise ValueError(
                    f"noise of extra_observations[{name!r}] must keep the shape {value.shape}, got {noisy[name].shape}"
                )
        return noisy

    def shown(self, measured: Measured, name: str) -> Array:
        """Returns what agents observe under a name, `(..., k)`."""
        return measured.noisy.get(name, measured.values[name])

    def observed(self, part: Measured) -> list[Array]:
        return [self.shown(part, name) for name in self.enabled]
