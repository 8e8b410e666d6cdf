"""The order of a reset and of a control step, for one episode or for many.

Single and vectorised environments, and dm_env, run these functions.
"""

import dataclasses
import functools
from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol

import mujoco
import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.tasks.control_modes.action_mode import MEDIAN
from kitchen_suite.tasks.episode.draws import Draws, SingleDraws
from kitchen_suite.tasks.episode.part import EpisodePart
from kitchen_suite.tasks.episode.state import EpisodeState, map_arrays
from kitchen_suite.tasks.mdp import MDP
from kitchen_suite.tasks.requests import Requests, Reset
from kitchen_suite.tasks.sensors import Sensors
from kitchen_suite.tasks.simulation import Simulation
from kitchen_suite.tasks.variations.variations import Variations
from kitchen_suite.types import Array


class Resettable(Protocol):
    """A task whose episodes a runner starts.

    Attributes:
      requests: draws what an episode asks for.
      variations: draws the parameters that vary.
    """

    requests: Requests
    variations: Variations

    def reset_physics(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        """Moves robot and objects to the start of an episode."""

    def initial_state(self, draws: Array) -> Any:
        """Returns the MDP's state before the first step, given draws of the observation noise."""


class Acting(NamedTuple):
    """A control step before its physics.

    Attributes:
      action: `(..., k)`.
      target: `(..., m)`, targets of the actuators that follow from it, each in its unit.
      command: that of `EpisodeState` after the step.
      parts: those of `EpisodeState`, as they are before the physics.
    """

    action: Array
    target: Array
    command: Any
    parts: Mapping[str, Any]


@dataclasses.dataclass(frozen=True)
class EpisodeRunner:
    """Runs the episodes of a task.

    Attributes:
      mdp: the task's settings and mathematics.
      simulation: the physics of one episode or of many.
      sensors: those of the MDP; in a batch of several models those of all of them.
      parts: the optional parts of the episodes by name, in their order.
    """

    mdp: MDP
    simulation: Simulation
    sensors: Sensors[Any]
    parts: Mapping[str, EpisodePart]

    def reset(
        self,
        task: Resettable,
        physics: mjcf.Physics,
        random_state: np.random.RandomState,
        reset: Reset,
        before: EpisodeState,
    ) -> EpisodeState:
        """Starts an episode of a single physics; returns its state before the first step.

        Random numbers are drawn in this order: the tasks that the episode asks for, the start pose, each parameter that
        varies in the order of the domain's table, one integer if layouts vary, what parts draw, the observation noise,
        and the noise of a user's observations.

        Args:
          task: of the episode.
          physics: its physics, at MuJoCo's initial state.
          random_state: that is drawn from.
          reset: what the reset asks for.
          before: state after the last control step of the episode before.
        """
        task.requests.draw(random_state, reset.request)
        task.reset_physics(physics, random_state)
        task.variations.draw(physics, random_state, reset.variation)
        return self.start(task, physics, SingleDraws(random_state), before)

    def start(self, task: Resettable, physics: mjcf.Physics, draws: Draws, before: EpisodeState) -> EpisodeState:
        """Returns the state of an episode that starts from the present physics; the later half of `reset`."""
        mdp, simulation = self.mdp, self.simulation
        self.sensors.refresh(physics)
        values = dict(task.variations.randomizer.values)
        parts = {name: part.draw(values, simulation, draws) for name, part in self.parts.items()}
        mdp_state = task.initial_state(self._scaled(parts, draws.noise(mdp.noise_draws)))
        for name, part in self.parts.items():
            parts[name] = part.start(parts[name], simulation, mdp_state, draws)
        if mdp.action_mode.reads_derived:
            mujoco.mj_kinematics(physics.model.ptr, physics.data.ptr)
        command = mdp.action_mode.start(simulation)
        state = EpisodeState(mdp_state, command, task.variations.info, parts)
        if before.mdp_state is not None:
            state = state.keep_fields(mdp.persistent, before.mdp_state, True)
        return state

    def act(self, state: EpisodeState, action: Array, draws: Draws) -> Acting:
        """Begins a control step: sets the controls of the actuators, and draws a number if the control mode needs one.

        Args:
          state: after the last control step.
          action: `(..., k)`.
          draws: random draws of the episodes that make the step.
        """
        mode = self.mdp.action_mode
        draw = draws.uniform() if mode.draws else MEDIAN
        target, command = mode.control(self.simulation, state.mdp_state, state.command, action, draw)
        ctrl = target
        parts = {}
        for name, part in self.parts.items():
            parts[name], ctrl = part.before(state.parts[name], self.simulation, state.mdp_state, ctrl)
        self.simulation.write("ctrl", self.mdp.sensors.ctrl, ctrl)
        return Acting(action, target, command, parts)

    def refresh(self, physics: mjcf.Physics) -> None:
        """Evaluates a single physics after its steps, as a batch does by itself up to the stage that is read."""
        self.sensors.refresh(physics)
        for part in self.parts.values():
            part.refresh(physics)

    def advance(self, state: EpisodeState, acting: Acting, draws: Draws) -> EpisodeState:
        """Ends a control step: reads the physics, draws the whole observation noise, and returns the state after it.

        Args:
          state: after the last control step.
          acting: as `act` returned it.
          draws: random draws of the episodes that have made the step.
        """
        reading = self.sensors.read(self.simulation)
        noise = self._scaled(acting.parts, draws.noise(self.mdp.noise_draws))
        step = self.mdp.transition(
            state.mdp_state, action=acting.action, target=acting.target, reading=reading, draws=noise
        )
        parts = dict(acting.parts)
        for name, part in self.parts.items():
            parts[name] = part.after(parts[name], self.simulation, step, draws)
        return EpisodeState(self.mdp.rewarded(step), acting.command, state.variation, parts)

    def _scaled(self, parts: Mapping[str, Any], draws: Array) -> Array:
        """Returns the draws `(..., k)` of the observation noise as the parts scale them."""
        for name, part in self.parts.items():
            draws = part.scaled(parts[name], draws)
        return draws

    def evaluated(self, state: EpisodeState) -> EpisodeState:
        """Returns the state once a single physics is evaluated: after a reset, or when a state has been set."""
        if not self.parts:
            return state
        return state._replace(parts={name: part.evaluated(state.parts[name]) for name, part in self.parts.items()})

    def terminates(self, state: EpisodeState) -> NDArray[np.bool_]:
        """Returns whether `(...)` the last step terminated the episode."""
        ended = self.mdp.terminates(state.mdp_state)
        for name, part in self.parts.items():
            ended = ended | part.terminates(state.parts[name])
        return ended

    def succeeds(self, state: EpisodeState) -> NDArray[np.bool_]:
        """Returns whether `(...)` all that the episode asks for holds after the last step, not only once before."""
        success = self.mdp.succeeds(state.mdp_state)
        for name, part in self.parts.items():
            success = part.succeeds(state.parts[name], success)
        return success

    def observation(self, state: EpisodeState) -> NDArray:
        """Returns the flat observation `(..., m)`: the MDP's own, then what parts observe; a fresh array."""
        flat = self.mdp.observation(self._observed_simulation, state.mdp_state)
        others = [array for name, part in self.parts.items() for array in part.observed(state.parts[name])]
        if not others:
            return flat
        return np.concatenate([flat, *others], axis=-1, dtype=flat.dtype, casting="same_kind")

    @functools.cached_property
    def _observed_simulation(self) -> Simulation:
        """The simulation that observations read; of many episodes, some may have started and not been evaluated yet."""
        return self.simulation.unevaluated

    def mdp_info(self, state: EpisodeState) -> dict[str, NDArray]:
        """Returns the infos of the MDP as the parts correct them: fresh arrays `(...)` or `(..., k)`."""
        info = self.mdp.info(state.mdp_state)
        for name, part in self.parts.items():
            info = part.corrected(state.parts[name], info)
        return info

    def info(self, state: EpisodeState) -> dict[str, NDArray]:
        """Returns the infos of the parts, beside those of the MDP: fresh arrays `(...)` or `(..., k)`."""
        return {key: value for name, part in self.parts.items() for key, value in part.info(state.parts[name]).items()}

    def saved(self, state: EpisodeState) -> dict[str, dict[str, Any]]:
        """Returns what a saved state holds beside the MDP's state: fresh arrays by part and field."""
        command = {} if state.command is None else {"command": state.command}
        kept = {name: state.parts[name] for name, part in self.parts.items() if part.is_saved}
        parts = {**command, **{name: part for name, part in kept.items() if part is not None}}
        return {name: map_arrays(np.array, part._asdict()) for name, part in parts.items()}

    def restored(self, state: EpisodeState, saved: Mapping[str, Any]) -> EpisodeState:
        """Returns the state with what `saved` returned, among which there may be other entries."""
        parts = {
            name: state.parts[name]._replace(**saved[name]) if part.is_saved and name in saved else state.parts[name]
            for name, part in self.parts.items()
        }
        command = None if state.command is None else state.command._replace(**saved["command"])
        return state._replace(command=command, parts=parts)
