"""Observations without composer's buffers, where those would hold nothing but the last control step."""

import collections
from collections.abc import Mapping

import numpy as np
from dm_control import mjcf
from dm_control.composer import observation
from dm_control.composer.observation import observable


def is_unbuffered(shown: observable.Observable) -> bool:
    """Whether an observable is updated at every physics step, without delay or buffer."""
    return (
        shown.update_interval == observation.updater.DEFAULT_UPDATE_INTERVAL
        and not shown.delay
        and shown.buffer_size in (None, observation.updater.DEFAULT_BUFFER_SIZE)
    )


class UnbufferedUpdater(observation.Updater):
    """composer's updater, which reads observables once a control step and keeps no buffers if all of them are plain.

    What is observed, and what corruptors draw, is the same.
    """

    def __init__(
        self,
        observables: Mapping[str, observable.Observable],
        physics_steps_per_control_step: int,
        strip_singleton_buffer_dim: bool,
        pad_with_initial_value: bool,
    ) -> None:
        """Builds the updater; arguments as composer's, but for observables in one dict."""
        super().__init__(
            observables, physics_steps_per_control_step, strip_singleton_buffer_dim, pad_with_initial_value
        )
        self._is_lean = False

    def reset(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        super().reset(physics, random_state)
        enabled = [shown for shown in self._observables.values() if shown.enabled]
        self._is_lean = self._strip_singleton_buffer_dim and all(
            is_unbuffered(shown) and not shown.aggregator for shown in enabled
        )
        self._readers = [
            (name, buffered.observation_callable, buffered.buffer.dtype)
            for name, buffered in self._enabled_structure.items()
        ]
        self._seen: collections.OrderedDict[str, np.ndarray] = super().get_observation()

    def skip(self, steps: int) -> None:
        """Counts physics steps of the present control step whose observations nobody reads."""
        self._step_counter += steps

    def prepare_for_next_control_step(self) -> None:
        if not self._is_lean:
            super().prepare_for_next_control_step()

    def update(self) -> None:
        if not self._is_lean:
            super().update()
            return
        self._step_counter += 1
        if self._step_counter % self._physics_steps_per_control_step == 0:
            self._seen = collections.OrderedDict((name, np.array(read(), dtype)) for name, read, dtype in self._readers)

    def get_observation(self) -> collections.OrderedDict[str, np.ndarray]:
        return self._seen.copy() if self._is_lean else super().get_observation()
