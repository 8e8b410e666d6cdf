"""Episodes: their state between control steps, and the two halves of a control step.

Single and vectorised environments hold one `EpisodeState` each, without leading axes or with one for each episode, and
make their steps with the same `Stepper`.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, Protocol, Self

import numpy as np
import tree
from numpy.typing import NDArray

from kitchen_suite.entities.parameters import Parameter, task_parameter
from kitchen_suite.tasks.extra_observations import ExtraObservations, Measured
from kitchen_suite.tasks.mdp import MDP
from kitchen_suite.tasks.pushes import Push
from kitchen_suite.tasks.quality import Quality, QualityReading
from kitchen_suite.tasks.simulation import Simulation
from kitchen_suite.tasks.terms import Condition, OwnSuccess, Termination
from kitchen_suite.types import Array

ACTION_DELAY = "sensing/action_delay"


def sensing_parameters(noise_parts: Mapping[str, slice]) -> tuple[Parameter, ...]:
    """Returns factors of parts of the observation noise, and whether actions are delayed by a control step, 0 or 1."""
    scales = (task_parameter(f"sensing/{part}", "1", default=1.0) for part in noise_parts)
    return (*scales, task_parameter(ACTION_DELAY, "control steps"))


class Sensing(NamedTuple):
    """Variation of sensing and acting in episodes.

    Attributes:
      noise: `(..., k)`, factors of the draws of the observation noise.
      delay: `(...)`, whether targets reach the actuators one control step late.
      target: `(..., 9)`, targets of the last control step; before the first, the positions at the reset [rad, m].
    """

    noise: Array
    delay: NDArray[np.bool_]
    target: Array

    @classmethod
    def start(cls, values: Mapping[str, Array], mdp: MDP, positions: Array) -> "Sensing | None":
        """Returns the sensing at the start of an episode; None if it does not vary.

        Args:
          values: of the parameters that vary, by name.
          mdp: with the parts of the noise.
          positions: `(9,)`, of the robot's joints at the reset [rad, m].
        """
        if not any(name.startswith("sensing/") for name in values):
            return None
        noise = np.ones(mdp.noise_draws)
        for part, elements in mdp.noise_parts.items():
            noise[elements] = values.get(f"sensing/{part}", 1.0)
        return cls(noise, np.array(values.get(ACTION_DELAY, 0.0) > 0.5), positions)


class EpisodeState(NamedTuple):
    """All that later steps of an episode depend on, beside physics and random state.

    Attributes:
      mdp_state: state of the task's MDP; None before the first reset.
      command: memory of the control mode from earlier actions, such as a commanded pose; None if it has none.
      sensing: variation of sensing in the episode; None if there is none.
      push: push of the episode; None if there is none.
      variation: infos on the variation of the episode; empty if nothing varies.
      measured: the task's extra observations after the last control step, or at the reset; None if there are none.
      terminations: `(...)` by name, whether each of the task's extra terminations ended the episode in that step.
      quality: how well the episode has been done; None if it is not measured.
      own_success: success by the task's `extra_successes`; None if there are none.
    """

    mdp_state: Any = None
    command: Any = None
    sensing: Sensing | None = None
    push: Push | None = None
    variation: Mapping[str, Any] = {}
    measured: Measured | None = None
    terminations: Mapping[str, NDArray[np.bool_]] = {}
    quality: Quality | None = None
    own_success: OwnSuccess | None = None

    def scaled(self, draws: Array) -> Array:
        """Returns the draws `(..., k)` of the observation noise, scaled by the variation of sensing."""
        return draws if self.sensing is None else draws * self.sensing.noise

    def info(self) -> dict[str, NDArray]:
        """Returns infos beside the MDP's, `(...)` each.

        They are which extra terminations ended the episode, which conditions of its own success are true, and its
        quality.
        """
        infos = {f"termination/{name}": np.array(ended) for name, ended in self.terminations.items()}
        if self.own_success is not None:
            infos |= self.own_success.info()
        return infos if self.quality is None else {**infos, **self.quality.info()}

    def mdp_info(self, mdp: MDP) -> dict[str, NDArray]:
        """Returns the infos of the task's MDP, in which a success of the class's own is in place of the MDP's."""
        infos = mdp.info(self.mdp_state)
        if self.own_success is not None:
            reached = {name: np.array(self.own_success.reached) for name in ("is_success", "success_at_any_time")}
            infos |= {name: value for name, value in reached.items() if name in infos or name == "is_success"}
        return infos

    def memory(self) -> dict[str, dict[str, Any]]:
        """Returns what a saved state holds beside the MDP's state: fresh arrays by part and field."""
        return {name: map_arrays(np.array, part._asdict()) for name, part in self._parts.items()}

    def with_memory(self, saved: Mapping[str, Any]) -> Self:
        """Returns the state with what `memory` returned, among which there may be other entries."""
        return self._replace(**{name: part._replace(**saved[name]) for name, part in self._parts.items()})

    @property
    def _parts(self) -> dict[str, Any]:
        """The parts that a saved state holds beside the MDP's state, those that there are."""
        parts = {
            "command": self.command,
            "sensing": self.sensing,
            "push": self.push,
            "measured": self.measured,
            "quality": self.quality,
            "own_success": self.own_success,
        }
        return {name: part for name, part in parts.items() if part is not None}

    def keep_fields(self, names: Sequence[str], before: Any, where: NDArray[np.bool_] | bool) -> Self:
        """Returns the state with some fields of the MDP's earlier state, where a mask `(...)` is True."""
        kept = {name: np.where(where, getattr(before, name), getattr(self.mdp_state, name)) for name in names}
        return self._replace(mdp_state=self.mdp_state._replace(**kept)) if kept else self

    def keep_rows(self, before: Self, where: NDArray[np.bool_]) -> Self:
        """Returns the states of many episodes, in fresh arrays, with those before where a mask `(n,)` is True."""

        def kept(present: NDArray, earlier: NDArray) -> NDArray:
            return np.where(where.reshape(-1, *(1,) * (present.ndim - 1)), earlier, present)

        states: Self = map_arrays(kept, self, before)
        return states

    def repeated(self, count: int) -> Self:
        """Returns the state of one episode for `count` of them: arrays with a new first axis."""
        repeated: Self = map_arrays(lambda each: np.repeat(np.asarray(each)[np.newaxis], count, axis=0), self)
        return repeated

    def arrays(self) -> list[Any]:
        """Returns all arrays of the state, None where it has none, always in the same order."""
        arrays: list[Any] = tree.flatten(self)
        return arrays


def map_arrays(function: Callable[..., Any], *nested: Any) -> Any:
    """Returns nested tuples and dicts of arrays with a function applied to each array; None stays None."""
    return tree.map_structure(lambda *parts: None if parts[0] is None else function(*parts), *nested)


class QualityReader(Protocol):
    """Reads what the quality of episodes is measured by."""

    def read(self, simulation: Any) -> QualityReading:
        """Returns the values of the last control step."""


class PushMaker(Protocol):
    """Makes the pushes of episodes."""

    def push(self, simulation: Any, push: Push, state: Any) -> Push:
        """Makes the pushes that are due before a control step from a state of the MDP; returns the push after it."""


class Acting(NamedTuple):
    """Action, targets and controls of a control step, with the memories that follow from it.

    Attributes:
      action: `(..., k)`.
      target: `(..., m)`, targets of the actuators that follow from it, each in its unit.
      ctrl: `(..., m)`, controls of the actuators: the targets, or with a delay those of the step before.
      command: that of `EpisodeState` after the step.
      sensing: that of `EpisodeState` after the step.
      push: that of `EpisodeState` after the step.
    """

    action: Array
    target: Array
    ctrl: Array
    command: Any
    sensing: Sensing | None
    push: Push | None


@dataclasses.dataclass(frozen=True)
class Stepper:
    """The control steps of a task's episodes.

    Attributes:
      mdp: the task's settings and mathematics.
      simulation: the physics of one episode or of many.
      pusher: makes the pushes of episodes that have any.
      observations: what the task observes beside its own.
      terminations: further reasons of the task to terminate an episode, by name; they return fresh arrays.
      successes: conditions of the success of the task's class, by name; they return fresh arrays.
      meter: reads what their quality is measured by; None if it is not measured.
    """

    mdp: MDP
    simulation: Simulation
    pusher: PushMaker
    observations: ExtraObservations
    terminations: Mapping[str, Termination]
    successes: Mapping[str, Condition]
    meter: QualityReader | None = None

    def act(self, state: EpisodeState, action: Array, draw: Array | float) -> Acting:
        """Returns targets and controls for an action, and the memories that follow.

        Args:
          state: after the last control step.
          action: `(..., k)`.
          draw: `(...)`, from U(0, 1), or `MEDIAN`, for the control mode.
        """
        target, command = self.mdp.action_mode.control(self.simulation, state.mdp_state, state.command, action, draw)
        sensing, ctrl = state.sensing, target
        if sensing is not None:
            ctrl = np.where(sensing.delay[..., np.newaxis], sensing.target, target)
            sensing = sensing._replace(target=target)
        push = state.push
        if push is not None:
            # After control has read the physics: only a single simulation is evaluated anew, a batch as it steps.
            push = self.pusher.push(self.simulation, push, state.mdp_state)
        return Acting(action, target, ctrl, command, sensing, push)

    def advance(self, state: EpisodeState, acting: Acting, reading: Any, draws: Array) -> EpisodeState:
        """Returns the state after the physics of the control step; extra observations have no noise yet.

        Args:
          state: after the last control step.
          acting: as `act` returned it.
          reading: values of the task's sensors.
          draws: `(..., noise_draws)`, from U(-1, 1).
        """
        mdp = self.mdp
        measured = state.measured
        terminations = state.terminations
        step = mdp.transition(
            state.mdp_state, action=acting.action, target=acting.target, reading=reading, draws=state.scaled(draws)
        )
        if measured is not None:
            values = self.observations.measure(self.simulation, step.after, acting.action.shape[:-1])
            step.observations = values
            step.previous_observations = measured.values
            measured = Measured(values, self.observations.noise_buffers(values))
        if self.terminations:
            terminations = {name: termination(step) for name, termination in self.terminations.items()}
        own_success = state.own_success
        if own_success is not None:
            own_success = own_success.after({name: condition(step) for name, condition in self.successes.items()})
        quality = state.quality
        if quality is not None:
            assert self.meter is not None, "the quality of episodes is measured"
            quality = quality.after(self.meter.read(self.simulation))
        after = mdp.rewarded(step)
        # `_replace` takes twice as long.
        return EpisodeState(
            after,
            acting.command,
            acting.sensing,
            acting.push,
            state.variation,
            measured,
            terminations,
            quality,
            own_success,
        )

    def terminates(self, state: EpisodeState) -> NDArray[np.bool_]:
        """Returns whether `(...)` the last step terminated the episode."""
        ended = self.mdp.terminates(state.mdp_state)
        if not state.terminations:
            return ended
        for extra in state.terminations.values():
            ended = ended | extra
        return ended
