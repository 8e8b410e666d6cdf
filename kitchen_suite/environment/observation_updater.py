"""An observation updater without buffers, for observables whose buffers would hold one value per control step."""

import collections
from collections.abc import Mapping

import numpy as np
from dm_control import mjcf
from dm_control.composer import observation
from dm_control.composer.observation import observable


def is_unbuffered(part: observable.Observable) -> bool:
    """Whether an observable is updated at every physics step, without delay or buffer."""
    return (
        part.update_interval == observation.updater.DEFAULT_UPDATE_INTERVAL
        and not part.delay
        and part.buffer_size in (None, observation.updater.DEFAULT_BUFFER_SIZE)
    )


class UnbufferedUpdater(observation.Updater):
    """composer's updater, which bypasses the buffers if no enabled observable needs one.

    It then reads each observable once per control step. Observations and the draws of corruptors are the same.
    """

    def __init__(
        self,
        observables: Mapping[str, observable.Observable],
        physics_steps_per_control_step: int,
        strip_singleton_buffer_dim: bool,
        pad_with_initial_value: bool,
    ) -> None:
        """Builds the updater; arguments as of composer's, with the observables in a single dict."""
        super().__init__(
            observables, physics_steps_per_control_step, strip_singleton_buffer_dim, pad_with_initial_value
        )
        self._bypasses_buffers = False

    def reset(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        super().reset(physics, random_state)
        enabled = [part for part in self._observables.values() if part.enabled]
        self._bypasses_buffers = self._strip_singleton_buffer_dim and all(
            is_unbuffered(part) and not part.aggregator for part in enabled
        )
        self._readers = [
            (name, buffered.observation_callable, buffered.buffer.dtype)
            for name, buffered in self._enabled_structure.items()
        ]
        self._observation: collections.OrderedDict[str, np.ndarray] = super().get_observation()

    def skip(self, steps: int) -> None:
        """Counts physics steps of the present control step without updating the observables."""
        self._step_counter += steps

    def prepare_for_next_control_step(self) -> None:
        if not self._bypasses_buffers:
            super().prepare_for_next_control_step()

    def update(self) -> None:
        if not self._bypasses_buffers:
            super().update()
            return
        self._step_counter += 1
        if self._step_counter % self._physics_steps_per_control_step == 0:
            self._observation = collections.OrderedDict(
                (name, np.array(read(), dtype)) for name, read, dtype in self._readers
            )

    def get_observation(self) -> collections.OrderedDict[str, np.ndarray]:
        return self._observation.copy() if self._bypasses_buffers else super().get_observation()
