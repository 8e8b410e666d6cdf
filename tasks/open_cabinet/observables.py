"""The open_cabinet domain's observation as composer observables, whose noise the task draws once for all of them."""

import collections
import functools
from collections.abc import Mapping

import numpy as np
from dm_control import mjcf
from dm_control.composer.observation import observable
from numpy.typing import NDArray

from kitchen_suite import checks
from kitchen_suite.tasks.open_cabinet import observation


class OpenCabinetObservables:
    """One enabled observable for each part of the present observation, which the task sets with `update`.

    Attributes:
      by_name: the observables by observation key, in the order of the flat vector.
      noise_scale: `(25,)`, greatest noise of each element, in its unit.
    """

    def __init__(self, noise_widths: Mapping[str, float] | None) -> None:
        """Builds the observables; those with noise have a corruptor, which returns the noisy part.

        Args:
          noise_widths: half widths of the uniform noise by part, in the unit of the part; `None` for none.

        Raises:
          TypeError: `noise_widths` is no mapping to numbers.
          ValueError: an unknown part, or a width that is negative or not finite.
        """
        self.noise_scale = _noise_scale(noise_widths)
        self._is_noisy = bool(self.noise_scale.any())
        self._clean = self._noisy = np.zeros(observation.SIZE, np.float32)
        self.by_name: collections.OrderedDict[str, observable.Observable] = collections.OrderedDict()
        for name, indices in observation.SLICES.items():
            self.by_name[name] = observable.Generic(functools.partial(self._part, indices))
            self.by_name[name].enabled = True
            if self.noise_scale[indices].any():
                self.by_name[name].corruptor = functools.partial(self._noisy_part, indices)

    def update(self, values: NDArray[np.float64], noise: NDArray[np.float64]) -> None:
        """Sets the present observation.

        Args:
          values: `(25,)`, without noise and not yet clipped.
          noise: `(25,)`, added before clipping, so that noisy observations keep the range.
        """
        self._clean = observation.clipped(values)
        self._noisy = observation.clipped(values + noise) if self._is_noisy else self._clean

    def _part(self, indices: slice, physics: mjcf.Physics) -> NDArray[np.float32]:
        del physics
        return self._clean[indices]

    def _noisy_part(self, indices: slice, clean: NDArray, random_state: np.random.RandomState) -> NDArray[np.float32]:
        del clean, random_state
        return self._noisy[indices]


def _noise_scale(widths: Mapping[str, float] | None) -> NDArray[np.float64]:
    """Returns the half width of the noise on each of the 25 elements."""
    if not isinstance(widths, Mapping | None):
        raise TypeError(f"observation_noise must map parts of the observation to widths, got {widths!r}")
    scale = np.zeros(observation.SIZE)
    for name, width in (widths or {}).items():
        part = checks.choice(name, observation.PARTS.keys(), "part of the observation")
        scale[observation.SLICES[part]] = checks.number(width, f"observation_noise of {name!r}")
    return scale
