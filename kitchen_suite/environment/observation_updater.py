"""The updater of observables in a control step."""

import collections

import numpy as np
from dm_control import mjcf
from dm_control.composer import observation
from dm_control.composer.observation import observable

from kitchen_suite.tasks.pictures import Camera as PictureCamera


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

    Attributes:
      needs_each_step: whether an enabled observable is to be updated at some physics steps within a control step.
    """

    needs_each_step = False
    _bypasses_buffers = False

    def reset(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        # composer reads the observation once when it has compiled the model, and again when an episode starts. Only the
        # latter is returned: an environment is built without a GL context, so that a process can build one and fork.
        cameras = [part for part in self._observables.values() if isinstance(part, PictureCamera)]
        for camera in cameras:
            camera.is_covered = self._enabled_structure is None
        super().reset(physics, random_state)
        for camera in cameras:
            camera.is_covered = False
        enabled = [part for part in self._observables.values() if part.enabled]
        self.needs_each_step = not all(map(is_unbuffered, enabled))
        self._bypasses_buffers = (
            self._strip_singleton_buffer_dim
            and not self.needs_each_step
            and not any(part.aggregator for part in enabled)
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
                [(name, np.array(read(), dtype)) for name, read, dtype in self._readers]
            )

    def get_observation(self) -> collections.OrderedDict[str, np.ndarray]:
        return self._observation.copy() if self._bypasses_buffers else super().get_observation()
