"""The open_cabinet domain's observation as composer observables, with noise drawn once for all of them."""

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
    """Holds what is seen now; one observable for each part, enabled.

    Attributes:
      by_name: the observables by public key, in the order of the flat vector.
      noise_scale: `(25,)`, greatest noise of each number, in its unit.
    """

    def __init__(self, noise_widths: Mapping[str, float] | None) -> None:
        """Builds the observables; those with noise get a corruptor.

        Args:
          noise_widths: half width of the uniform noise on parts, by their names and in their units; `None` for none.

        Raises:
          TypeError: `noise_widths` is no mapping to numbers.
          ValueError: an unknown part, or a width that is negative or not finite.
        """
        self.noise_scale = _noise_scale(noise_widths)
        self._is_noisy = bool(self.noise_scale.any())
        self._clean = self._noisy = np.zeros(observation.SIZE, np.float32)
        self.by_name: collections.OrderedDict[str, observable.Observable] = collections.OrderedDict()
        for name, place in observation.SLICES.items():
            self.by_name[name] = observable.Generic(functools.partial(self._part, place))
            self.by_name[name].enabled = True
            if self.noise_scale[place].any():
                self.by_name[name].corruptor = functools.partial(self._noisy_part, place)

    def show(self, values: NDArray[np.float64], noise: NDArray[np.float64]) -> None:
        """Makes the observation of what is seen `(25,)`, without and with the noise `(25,)`."""
        self._clean = observation.shown(values)
        # Noise is added before clipping, so that what is shown keeps its range.
        self._noisy = observation.shown(values + noise) if self._is_noisy else self._clean

    def _part(self, place: slice, physics: mjcf.Physics) -> NDArray[np.float32]:
        del physics
        return self._clean[place]

    def _noisy_part(self, place: slice, clean: NDArray, random_state: np.random.RandomState) -> NDArray[np.float32]:
        del clean, random_state
        return self._noisy[place]


def _noise_scale(widths: Mapping[str, float] | None) -> NDArray[np.float64]:
    """Half width of the noise on each of the 25 numbers."""
    if not isinstance(widths, Mapping | None):
        raise TypeError(f"observation_noise must map parts of the observation to widths, got {widths!r}")
    scale = np.zeros(observation.SIZE)
    for name, width in (widths or {}).items():
        part = checks.choice(name, observation.PARTS.keys(), "part of the observation")
        scale[observation.SLICES[part]] = checks.number(width, f"observation_noise of {name!r}")
    return scale
